"""Figures of a run, drawn with matplotlib.

A new figure is one module here with ``FIGURES``, a dict of names and functions that make a
``matplotlib.figure.Figure`` of a :class:`~formnet.lab.runs.recording.Collected` run, or None where
there is nothing to draw. It is drawn after the others, and stands below them in the page under its
name: ``energy-of-robots`` as "Energy of robots".
"""
