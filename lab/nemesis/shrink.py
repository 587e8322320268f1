"""Making a failing schedule small."""

from collections.abc import Callable, Sequence
from typing import TypeVar

Item = TypeVar("Item")


def shrunk(
    items: Sequence[Item],
    fails: Callable[[Sequence[Item]], bool],
    simpler: Callable[[Item], Item | None] = lambda _: None,
) -> list[Item]:
    """A part of ``items`` that still fails and fails no more if anything is left out of it.

    Each item of it was then replaced by what ``simpler`` makes of it, again and again, as long
    as that still fails. ``fails`` holds for ``items``. Delta debugging (Zeller and
    Hildebrandt, *Simplifying and Isolating Failure-Inducing Input*, IEEE Transactions on
    Software Engineering 28(2), 2002): chunks first, then smaller ones.
    """
    left = list(items)
    size = max(1, len(left) // 2)
    while True:
        shorter = next(
            (
                rest
                for begin in range(0, len(left), size)
                if fails(rest := left[:begin] + left[begin + size :])
            ),
            None,
        )
        if shorter is not None:
            left = shorter
            size = max(1, min(size, len(left) // 2))
        elif size > 1:
            size = max(1, size // 2)
        else:
            break
    for place in range(len(left)):
        while (item := simpler(left[place])) is not None:
            changed = [*left[:place], item, *left[place + 1 :]]
            if not fails(changed):
                break
            left = changed
    return left
