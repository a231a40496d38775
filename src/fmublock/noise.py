"""Pseudo-random numbers that are the same in every flavour of an FMU.

A Lehmer generator (Park and Miller, CACM 31, 1988) is a discrete state of the block:
x <- 16807 x mod (2^31 - 1) stays below 2^46, so it is exact in doubles on every machine.
"""

import math
from typing import Any

from .functions import cos, floor, log, sqrt

MULTIPLIER = 16807.0
MODULUS = 2147483647.0


def lehmer(x: Any) -> Any:
    """Return the generator's next state, a whole number between 1 and 2^31 - 2.

    `floor` gives the same remainder as `mod` and is cheaper. The modulus is prime and does not divide the
    product, so the quotient is 4.7e-10 or more from a whole number. Rounding changes it by 1.8e-12 at most.
    """
    product = MULTIPLIER * x
    return product - MODULUS * floor(product / MODULUS)


def uniform(x: Any) -> Any:
    """Return the generator's state as a number strictly between 0 and 1."""
    return x / MODULUS


def normal(x1: Any, x2: Any) -> Any:
    """Return a draw from N(0, 1) for two generator states (Box and Muller, 1958)."""
    return sqrt(-2.0 * log(uniform(x1))) * cos(2.0 * math.pi * uniform(x2))
