"""What impairments have in common in which messages take room or time.

Not in :mod:`netem.core.link`, which is compiled: mypyc does not know protocols that are asked for
at run time.
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from formnet.netem.core.transit import Transit


@runtime_checkable
class Shared(Protocol):
    """Of a :class:`netem.core.link.Impairment` in which a message takes room or time from others.

    Its ``twin`` is itself: duplicates share the room.
    """

    def occupy(self, under_way: Sequence[Transit]) -> None:
        """Have ``under_way``, in any order, take room and time here, and nothing else.

        What left before the next message was sent may be among them. It is called where
        this impairment did not see how they came to be what is on the link: when it is
        turned on, after a cut that lost what was in flight, and when the last one that kept
        their order behind it is turned off. Each leaves the line at its ``leaves_ns``.
        """
        ...
