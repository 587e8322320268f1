"""Loss, message by message: independent or correlated, by trace, by count, by rule."""

from collections.abc import Callable, Sequence
from random import Random

from formnet.netem.core.checks import correlation as checked_correlation
from formnet.netem.core.checks import probability as checked
from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import LOST_BURST, LOST_RANDOM, LOST_TRACE, Transit


class RandomLoss:
    """Each message is lost with ``probability``; successive losses have lag-1 ``correlation``.

    Correlated, the losses are a two-state Markov chain, begun in equilibrium,
    whose indicator has exactly that rate and that correlation c: after a loss
    the next is lost with p + c (1 − p), else with p (1 − c). (tc-netem's
    correlated loss misses its rate.)
    """

    name = "loss"

    def __init__(self, probability: float, correlation: float = 0.0) -> None:
        self._probability = checked("probability", probability)
        self._correlation = checked_correlation(correlation)
        self._after_loss = probability + correlation * (1.0 - probability)
        self._after_none = probability * (1.0 - correlation)
        self._after: bool | None = None  # whether the message before was lost; None: the first

    def twin(self) -> "RandomLoss":
        return RandomLoss(self._probability, self._correlation)

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, RandomLoss):
            self._after = before._after

    def apply(self, copy: Transit, random: Random) -> None:
        after = self._after
        likely = (
            self._probability if after is None else self._after_loss if after else self._after_none
        )
        self._after = lost = random.random() < likely
        if lost and not copy.lost:
            copy.fate = LOST_BURST if after and self._correlation > 0.0 else LOST_RANDOM


class EveryNthLoss:
    """Every ``n``-th message is lost: the n-th, the 2n-th and so on."""

    name = "loss"

    def __init__(self, n: int) -> None:
        if n < 1:
            raise ValueError(f"n must be >= 1, got {n}")
        self._n = n
        self._count = 0

    def twin(self) -> "EveryNthLoss":
        return EveryNthLoss(self._n)

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, EveryNthLoss):
            self._count = before._count

    def apply(self, copy: Transit, random: Random) -> None:
        self._count += 1
        if self._count % self._n == 0 and not copy.lost:
            copy.fate = LOST_TRACE


class TraceLoss:
    """Loses what ``losses`` says, message by message (true: lost), again and again."""

    name = "loss"

    def __init__(self, losses: Sequence[bool]) -> None:
        if not losses:
            raise ValueError("losses must not be empty")
        self._losses = list(losses)
        self._count = 0

    def twin(self) -> "TraceLoss":
        return TraceLoss(self._losses)

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, TraceLoss):
            self._count = before._count

    def apply(self, copy: Transit, random: Random) -> None:
        lost = self._losses[self._count % len(self._losses)]
        self._count += 1
        if lost and not copy.lost:
            copy.fate = LOST_TRACE


class PredicateLoss:
    """Loses every copy for which ``lost`` says so; for tests."""

    name = "loss"

    def __init__(self, lost: Callable[[Transit], bool]) -> None:
        self._lost = lost

    def twin(self) -> "PredicateLoss":
        return self

    def inherit(self, before: Impairment) -> None:
        """Nothing: no message depends on another."""

    def apply(self, copy: Transit, random: Random) -> None:
        if self._lost(copy) and not copy.lost:
            copy.fate = LOST_TRACE
