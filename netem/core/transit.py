"""A copy of a message on its way through a link, and what can become of it."""

from dataclasses import dataclass
from typing import Any

DELIVERED = "delivered"
DUPLICATED = "duplicated"
CORRUPTED = "corrupted"
LOST_RANDOM = "lost: random"
LOST_BURST = "lost: burst"
LOST_TRACE = "lost: trace"
LOST_QUEUE = "lost: queue"
LOST_LATE = "lost: late"
LOST_CUT = "lost: cut"
LOST_DOWN = "lost: receiver down"
IN_FLIGHT = "in flight"
FATES = frozenset(
    {
        DELIVERED,
        DUPLICATED,
        CORRUPTED,
        LOST_RANDOM,
        LOST_BURST,
        LOST_TRACE,
        LOST_QUEUE,
        LOST_LATE,
        LOST_CUT,
        LOST_DOWN,
        IN_FLIGHT,
    }
)
"""All that can become of a copy."""


@dataclass(slots=True)
class Transit:
    """One copy of a message on its way through a link.

    Impairments change ``due_ns``, ``payload``, ``fate``, ``hurried`` and ``left_ns``;
    what was sent (``sequence``, ``sent_ns``, the sender's ``note``) stays. ``fate`` is
    DELIVERED, DUPLICATED (a second copy, delivered), CORRUPTED (delivered damaged) or one
    of the LOST kinds; ``hurried`` says that the copy overtakes delay and rate; ``left_ns``
    is when it left the line, where the receiver then held or refused it, else None;
    ``cut`` says that it was sent while the link was cut.
    """

    sequence: int
    sent_ns: int
    due_ns: int
    payload: bytes
    fate: str = DELIVERED
    hurried: bool = False
    note: Any = None
    left_ns: int | None = None
    cut: bool = False

    @property
    def lost(self) -> bool:
        """Whether the copy never arrives."""
        return self.fate.startswith("lost")

    @property
    def absent(self) -> bool:
        """Whether the copy takes no room and no time: lost, or sent while the link was cut."""
        return self.cut or self.lost

    @property
    def leaves_ns(self) -> int:
        """When the copy has left the line, whatever the receiver then does with it."""
        return self.due_ns if self.left_ns is None else self.left_ns
