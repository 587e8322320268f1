"""Emulation of imperfect one-way links, usable on its own.

A :class:`Link` carries messages from one node to another and decides what
becomes of each: delivered at some instant, or lost. It has no clock, socket or
thread; whoever owns the clock calls :meth:`Link.send` and :meth:`Link.deliver`
with integer nanoseconds, so the same link serves virtual time and wall time.

This package imports nothing of the rest of the project.
"""

from formnet.netem.core.duplicate import Duplicate
from formnet.netem.core.link import Impairment, Link
from formnet.netem.core.shared import Shared
from formnet.netem.core.streams import stream
from formnet.netem.core.transit import (
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
    Transit,
)
from formnet.netem.delays.delay import ConstantDelay, RandomDelay, TraceDelay, UniformDelay
from formnet.netem.impairments.corrupt import Corrupt
from formnet.netem.impairments.loss import EveryNthLoss, PredicateLoss, RandomLoss, TraceLoss
from formnet.netem.impairments.markov import FourState, GilbertElliott
from formnet.netem.impairments.order import KeepOrder
from formnet.netem.impairments.playout import Playout
from formnet.netem.impairments.queue import QueueEntry, QueueExit, QueueLimit
from formnet.netem.impairments.rate import Rate
from formnet.netem.impairments.reorder import Reorder
from formnet.netem.impairments.slots import Slots
from formnet.netem.settings.actions import Change, Cut, Heal
from formnet.netem.settings.links import LinkOverrides, LinkSettings
from formnet.netem.settings.ramp import Ramp
from formnet.netem.settings.timeline import Timeline

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
