"""What formnet's runtime costs, as ratios to what it could cost at best and elsewhere.

``python -m benchmarks``, from the top of the repository, prints one table from
one run. Absolute times mean little on a shared machine, so the things compared
take turns in several short rounds, and what counts is the median of the ratios
within each round:

- ``a``, :mod:`benchmarks.exchange`: a lockstep tick against the bare Zenoh exchange of
  the same messages (:mod:`benchmarks.bare`) and against HELICS (:mod:`benchmarks.helics_fed`);
- ``b``, :mod:`benchmarks.inline_speed`: an inline run over real time;
- ``c``, :mod:`benchmarks.scaling`: a lockstep tick with 5, 10, 20 and 40 robots.

Nothing here is imported by formnet itself.
"""
