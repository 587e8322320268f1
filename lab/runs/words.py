"""Facts about a run in words, for the terminal and the page of a run."""


def times(factor: float) -> str:
    """How many times as fast as real time."""
    return f"{factor:.2g} ×" if factor < 10.0 else f"{factor:.0f} ×"
