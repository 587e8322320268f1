"""Elementary functions whose bits do not depend on the processor, the libc or the Python.

Made of +, −, ×, ÷, √, comparisons and what is exact (``%`` of positive numbers, ``ldexp``,
``frexp``, ``floor``, ``copysign``, rounding), all of which IEEE 754 fixes for doubles, in a
stated order and without fused multiply-adds. The same source runs in Python and compiles with
mypyc and Numba, so only scalars, tuples and loops are used.

Whatever enters a trajectory's hash, a message's fate or an event calls these rather than ``math``
or NumPy. How exact they are is measured in docs/arithmetic.md.
"""

from typing import Final

ARITHMETIC_VERSION: Final = 2
"""Goes up whenever a run's bits change. Version 1 called the C library's functions."""
