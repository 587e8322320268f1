"""Named random streams: one per (seed, source, destination, impairment).

Every impairment of every link draws from a stream of its own, message by message
in sequence order. Adding a link or an impairment therefore changes no draw of
any other, which tc-netem's single generator cannot promise.
"""

import hashlib
from random import Random


def stream(seed: int, source: object, destination: object, impairment: str) -> Random:
    """A generator that depends on its four names and on nothing else.

    Only ``Random.random()`` should be drawn from it: Python documents that
    method's sequence, unlike the others', as stable for a given seed.
    """
    name = f"{seed}\x1f{source}\x1f{destination}\x1f{impairment}"
    return Random(int.from_bytes(hashlib.sha256(name.encode()).digest(), "big"))
