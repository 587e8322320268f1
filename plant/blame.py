"""On whom a run in lockstep waits: worked out from what robots say, as far as that can be."""

from collections.abc import Collection, Mapping, Sequence

from formnet.formation.wire.messages import Waiting


def culprits(
    awaited: list[int],
    waiting: Mapping[int, Waiting],
    tick: int,
    up: Collection[int],
    hears: Mapping[int, Sequence[int]],
) -> list[int]:
    """Those of ``awaited``, or of whom they wait for, on whom tick ``tick`` waits; ascending.

    ``awaited`` have not answered ``tick`` and are not empty, ``waiting`` is what each robot has
    said last of whom it waits for, ``up`` who takes part, and ``hears`` whose broadcasts each
    robot needs. Who says nothing is to blame. Otherwise those whose broadcasts are missing: not
    where another robot has heard them, which has answered or waits for somebody else only; so one
    robot alone can accuse nobody who is heard by a second.
    """
    accounts = {
        robot: waiting[robot].neighbours
        for robot in awaited
        if robot in waiting and waiting[robot].tick == tick
    }
    silent = [robot for robot in awaited if robot not in accounts]
    if silent:
        return silent
    heard: set[int] = set()
    missed: set[int] = set()
    for robot in up:
        for source in hears[robot]:
            (missed if source in accounts.get(robot, ()) else heard).add(source)
    unheard = (missed - heard).intersection(up)
    return sorted(unheard.difference(accounts)) or sorted(unheard) or awaited
