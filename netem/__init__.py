"""Emulation of imperfect one-way links, usable on its own.

A :class:`Link` carries messages from one node to another and decides what
becomes of each: delivered at some instant, or lost. It has no clock, socket or
thread; whoever owns the clock calls :meth:`Link.send` and :meth:`Link.deliver`
with integer nanoseconds, so the same link serves virtual time and wall time.

This package imports nothing of the rest of the project.
"""

from netem.actions import Change, Cut, Heal
from netem.corrupt import Corrupt
from netem.delay import ConstantDelay, RandomDelay, TraceDelay, UniformDelay
from netem.duplicate import Duplicate
from netem.link import (
    CORRUPTED,
    DELIVERED,
    DUPLICATED,
    IN_FLIGHT,
    LOST_BURST,
    LOST_CUT,
    LOST_LATE,
    LOST_QUEUE,
    LOST_RANDOM,
    LOST_TRACE,
    Impairment,
    Link,
    Transit,
)
from netem.loss import EveryNthLoss, PredicateLoss, RandomLoss, TraceLoss
from netem.markov import FourState, GilbertElliott
from netem.order import KeepOrder
from netem.playout import Playout
from netem.queue import QueueEntry, QueueExit, QueueLimit
from netem.ramp import Ramp
from netem.rate import Rate
from netem.reorder import Reorder
from netem.settings import LinkOverrides, LinkSettings
from netem.shared import Shared
from netem.slots import Slots
from netem.streams import stream
from netem.timeline import Timeline

__all__ = [
    "CORRUPTED",
    "DELIVERED",
    "DUPLICATED",
    "IN_FLIGHT",
    "LOST_BURST",
    "LOST_CUT",
    "LOST_LATE",
    "LOST_QUEUE",
    "LOST_RANDOM",
    "LOST_TRACE",
    "Change",
    "ConstantDelay",
    "Corrupt",
    "Cut",
    "Duplicate",
    "EveryNthLoss",
    "FourState",
    "GilbertElliott",
    "Heal",
    "Impairment",
    "KeepOrder",
    "Link",
    "LinkOverrides",
    "LinkSettings",
    "Playout",
    "PredicateLoss",
    "QueueEntry",
    "QueueExit",
    "QueueLimit",
    "Ramp",
    "RandomDelay",
    "RandomLoss",
    "Rate",
    "Reorder",
    "Shared",
    "Slots",
    "Timeline",
    "TraceDelay",
    "TraceLoss",
    "Transit",
    "UniformDelay",
    "stream",
]
