"""What a claim is: runs, and how each must end for the paper to be right."""

from collections.abc import Mapping
from dataclasses import dataclass

from formnet.formation.scenario.expect import CENTROID, ERRORS, LYAPUNOV

ALL_HOLD: Mapping[str, bool] = dict.fromkeys(ERRORS, True)
"""Eqs. 3, 4 and 5 hold."""
NOT_HOME: Mapping[str, bool] = {**ALL_HOLD, CENTROID.name: False}
"""Eqs. 3 and 4 hold, Eq. 5 does not."""
APART: Mapping[str, bool] = dict.fromkeys(ERRORS, False)
"""None of them holds."""
NEVER_RISES: Mapping[str, bool] = {LYAPUNOV.name: True}
"""V never rises beyond its budget."""


@dataclass(frozen=True)
class Case:
    """One run of a claim.

    ``scenario`` is a file below ``configs``, ``overrides`` what ``--set`` changes in it.
    ``expected`` maps the names of some criteria (:mod:`formation.scenario.expect`) to whether
    they shall be met; empty where the paper says nothing.
    ``diverges``: the run ends because the state leaves the finite numbers.
    """

    name: str
    scenario: str
    overrides: tuple[str, ...] = ()
    expected: Mapping[str, bool] | None = None
    diverges: bool = False

    @property
    def asked(self) -> Mapping[str, bool]:
        """What is expected of the run; nothing where nothing is claimed."""
        return self.expected or {}

    @property
    def all_overrides(self) -> tuple[str, ...]:
        """The overrides, with what is expected as the scenario's ``[expect]``."""
        stated = (f"expect.{claim}={str(self.asked[claim]).lower()}" for claim in self.asked)
        return ("expect={}", *stated, *self.overrides)


@dataclass(frozen=True)
class Claim:
    """One row: what is said, where, and the runs that show it.

    ``key`` names it on the command line; ``where`` is the place in the paper. ``should`` says
    in words how the runs end.
    """

    key: str
    says: str
    where: str
    should: str
    cases: tuple[Case, ...]

    @property
    def claimed(self) -> bool:
        """Whether anybody says how the runs end; if not, it is only reported how they do."""
        return any(case.expected is not None for case in self.cases)
