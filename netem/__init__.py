"""Emulation of imperfect one-way links, usable on its own.

A :class:`Link` carries messages from one node to another and decides what
becomes of each: delivered at some instant, or lost. It has no clock, socket or
thread; whoever owns the clock calls :meth:`Link.send` and :meth:`Link.deliver`
with integer nanoseconds, so the same link serves virtual time and wall time.

This package imports nothing of the rest of the project.
"""

from netem.delay import ConstantDelay, UniformDelay
from netem.link import DELIVERED, LOST_RANDOM, Impairment, Link, Transit
from netem.loss import RandomLoss
from netem.settings import LinkOverrides, LinkSettings
from netem.streams import stream

__all__ = [
    "DELIVERED",
    "LOST_RANDOM",
    "ConstantDelay",
    "Impairment",
    "Link",
    "LinkOverrides",
    "LinkSettings",
    "RandomLoss",
    "Transit",
    "UniformDelay",
    "stream",
]
