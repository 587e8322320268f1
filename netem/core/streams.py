"""Named random streams: one per (seed, source, destination, impairment, kind of message).

Every impairment of every link draws from a stream of its own, message by message
in sequence order. Adding a link, an impairment or a kind of message therefore changes
no draw of any other, which tc-netem's single generator cannot promise.
"""

import hashlib
from random import Random


def stream(
    seed: int, source: object, destination: object, impairment: str, kind: str = ""
) -> Random:
    """A generator that depends on its names and on nothing else.

    ``kind`` is the kind of message that draws from it, where there are several.

    Only ``Random.random()`` should be drawn from it: Python documents that
    method's sequence, unlike the others', as stable for a given seed.
    """
    name = f"{seed}\x1f{source}\x1f{destination}\x1f{impairment}"
    if kind:
        name += f"\x1f{kind}"
    return Random(int.from_bytes(hashlib.sha256(name.encode()).digest(), "big"))
