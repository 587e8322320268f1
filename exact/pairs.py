"""Sums and products to twice the precision: a number as the unevaluated sum of two doubles.

The error of a sum (Knuth) and of a product (Dekker, without a fused multiply-add) is itself a
double: T. J. Dekker, Numerische Mathematik 18 (1971) 224-242.
"""

from typing import Final

Pair = tuple[float, float]
"""A number as a double and what is left of it, which is smaller than half its last place."""

_SPLIT: Final = 134217729.0  # 2²⁷ + 1


def add(a: float, b: float) -> Pair:
    """a + b exactly, where it does not overflow."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def multiply(a: float, b: float) -> Pair:
    """a · b exactly, where a, b and their product are between 2⁻⁹⁰⁰ and 2⁹⁰⁰ in size, or 0."""
    product = a * b
    c = _SPLIT * a
    a_high = c - (c - a)
    a_low = a - a_high
    c = _SPLIT * b
    b_high = c - (c - b)
    b_low = b - b_high
    error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, error


def divide(a: float, a_low: float, b: float, b_low: float) -> Pair:
    """(a + a_low) / (b + b_low), relative error below 2⁻¹⁰⁰; in size as for :func:`multiply`."""
    quotient = a / b
    product, error = multiply(quotient, b)
    return quotient, (((a - product) - error) + a_low - quotient * b_low) / b
