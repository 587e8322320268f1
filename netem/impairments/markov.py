"""Loss in bursts: the two Markov models of tc-netem, with its names."""

from random import Random

from formnet.netem.core.checks import probability as checked
from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import LOST_BURST, LOST_RANDOM, Transit


class GilbertElliott:
    """Good and bad stretches (tc-netem's ``gemodel p r 1-h 1-k``).

    Good turns bad with ``p``, bad good with ``r`` (default 1 − p); a message is
    lost with ``loss_in_bad`` (1 − h) or ``loss_in_good`` (1 − k). It begins good;
    the loss goes by the state before the transition. Mean loss is
    (r · loss_in_good + p · loss_in_bad) / (p + r).
    """

    name = "loss"

    def __init__(
        self,
        p: float,
        r: float | None = None,
        loss_in_bad: float = 1.0,
        loss_in_good: float = 0.0,
    ) -> None:
        self._p = checked("p", p)
        self._r = 1.0 - p if r is None else checked("r", r)
        self._loss_in_bad = checked("loss_in_bad", loss_in_bad)
        self._loss_in_good = checked("loss_in_good", loss_in_good)
        self._bad = False

    def twin(self) -> "GilbertElliott":
        return GilbertElliott(self._p, self._r, self._loss_in_bad, self._loss_in_good)

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, GilbertElliott):
            self._bad = before._bad

    def apply(self, copy: Transit, random: Random) -> None:
        was_bad = self._bad
        moves = random.random() < (self._r if was_bad else self._p)
        self._bad = was_bad != moves
        lost = random.random() < (self._loss_in_bad if was_bad else self._loss_in_good)
        if lost and not copy.lost:
            copy.fate = LOST_BURST if was_bad else LOST_RANDOM


class FourState:
    """tc-netem's ``state p13 p31 p32 p23 p14``: bursts with gaps inside, and single losses.

    States: 1 received in a gap, 2 received in a burst, 3 lost in a burst, 4 lost
    alone. What happens to a message is decided by the state that it leads to.
    Defaults: p31 = 1 − p13, p32 = 0, p23 = 1, p14 = 0. With a = p13 / p31, mean
    loss is (a + p14) / (1 + p14 + a (1 + p32 / p23)).

    Raises:
        ValueError: a probability outside [0, 1], p13 + p14 > 1 or p31 + p32 > 1.
    """

    name = "loss"

    def __init__(
        self,
        p13: float,
        p31: float | None = None,
        p32: float = 0.0,
        p23: float = 1.0,
        p14: float = 0.0,
    ) -> None:
        self._p13 = checked("p13", p13)
        self._p31 = 1.0 - p13 if p31 is None else checked("p31", p31)
        self._p32 = checked("p32", p32)
        self._p23 = checked("p23", p23)
        self._p14 = checked("p14", p14)
        if p13 + p14 > 1.0 or self._p31 + p32 > 1.0:
            raise ValueError(
                f"need p13 + p14 <= 1 and p31 + p32 <= 1, got {p13 + p14} and {self._p31 + p32}"
            )
        self._state = 1

    def twin(self) -> "FourState":
        return FourState(self._p13, self._p31, self._p32, self._p23, self._p14)

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, FourState):
            self._state = before._state

    def apply(self, copy: Transit, random: Random) -> None:
        self._state = self._next(random.random())
        if not copy.lost:
            if self._state == 3:
                copy.fate = LOST_BURST
            elif self._state == 4:
                copy.fate = LOST_RANDOM

    def _next(self, u: float) -> int:
        state = self._state
        if state == 1:
            return 4 if u < self._p14 else 3 if u < self._p14 + self._p13 else 1
        if state == 2:
            return 3 if u < self._p23 else 2
        if state == 3:
            return 1 if u < self._p31 else 2 if u < self._p31 + self._p32 else 3
        return 1
