"""The words for what is proved of a scenario (:mod:`formation.paper.proof` applies them)."""

from typing import Final, Literal

Status = Literal["proved", "proved with compensation", "not covered"]
PROVED: Final = "proved"
"""With the law as the scenario sets it."""
WITH_COMPENSATION: Final = "proved with compensation"
"""Not with the printed cross term, which the scenario has; it would be with the compensated one."""
NOT_COVERED: Final = "not covered"
"""No theorem applies."""
