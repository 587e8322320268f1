"""``[formation]``: the graph of a formation, and its weights."""

from functools import cached_property
from typing import Annotated

from pydantic import Discriminator, Field, Tag

from formnet.formation.plan.selectors import RobotId
from formnet.netem.files.tables import Positive, Table

MOST_EDGES = 100_000


class Formation(Table):
    """``[formation]``: who hears whom (undirected) and the weights b_ji = b_ij."""

    edges: list[Annotated[tuple[RobotId, RobotId], Field(strict=False)]] = Field(
        max_length=MOST_EDGES,
        description="The communication graph as pairs of robot ids; edges are undirected.",
    )
    coupling: Annotated[
        Annotated[Positive, Tag("number")] | Annotated[dict[str, Positive], Tag("table")],
        Discriminator(lambda value: "table" if isinstance(value, dict) else "number"),
    ] = Field(
        default=1.0,
        description=(
            'The weight b of every edge, or a table with one entry per edge: `{ "1-2" = 2.0, "2-3" '
            "= 0.5 }`."
        ),
        json_schema_extra={"unit": "1/s"},
    )

    @cached_property
    def weights(self) -> dict[tuple[int, int], float]:
        """b of every edge, keyed by the edge with its smaller robot first."""
        table = {
            (min(edge), max(edge)): self.coupling
            if isinstance(self.coupling, float | int)
            else self.coupling.get(
                f"{edge[0]}-{edge[1]}", self.coupling.get(f"{edge[1]}-{edge[0]}")
            )
            for edge in self.edges
        }
        return {edge: float(weight) for edge, weight in table.items() if weight is not None}
