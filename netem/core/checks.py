"""The rules that many impairments share."""


def probability(name: str, value: float) -> float:
    """``value``, which must be a probability.

    Raises:
        ValueError: it is not in [0, 1].
    """
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"{name} must be in [0, 1], got {value}")
    return value


def correlation(value: float) -> float:
    """``value``, which must be a lag-1 correlation that can be had.

    Raises:
        ValueError: it is not in [0, 1).
    """
    if not 0.0 <= value < 1.0:
        raise ValueError(f"correlation must be in [0, 1), got {value}")
    return value
