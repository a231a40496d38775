"""Pseudo-random numbers that every flavour of an FMU draws alike.

A Lehmer generator (Park and Miller, CACM 31, 1988) is a discrete state of the block:
x <- 16807 x mod (2^31 - 1) stays below 2^46, so it is exact in doubles on every machine.
"""

import math
from typing import Any

from .functions import cos, floor, log, sqrt

MULTIPLIER = 16807.0
MODULUS = 2147483647.0


def lehmer(x: Any) -> Any:
    """The generator's next state, a whole number between 1 and 2^31 - 2.

    The product is no multiple of the modulus, a prime, so that its quotient is farther from a whole number
    (4.7e-10) than rounding brings it (1.8e-12): the remainder by `floor` is that of `mod`, and cheaper.
    """
    product = MULTIPLIER * x
    return product - MODULUS * floor(product / MODULUS)


def uniform(x: Any) -> Any:
    """The generator's state as a number strictly between 0 and 1."""
    return x / MODULUS


def normal(x1: Any, x2: Any) -> Any:
    """Two generator states as one draw from N(0, 1) (Box and Muller, 1958)."""
    return sqrt(-2.0 * log(uniform(x1))) * cos(2.0 * math.pi * uniform(x2))
