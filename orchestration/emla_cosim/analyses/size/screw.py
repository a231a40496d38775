"""Life, critical speed and buckling of a screw, as manufacturers' catalogues compute them.

Arguments are in SI units, arrays have shape (rows,); `ends` is the position of the bearings in `ENDS`.
"""

import math

import numpy as np

from ...base.arrays import Vector

YOUNG, DENSITY = 2.06e11, 7850.0
"""Of steel, in Pa and kg/m3, as in catalogues."""

SPEED_SAFETY, BUCKLING_SAFETY = 0.8, 0.5
"""Permissible fractions of critical speed and buckling load, as in the catalogues of THK and MISUMI."""

RATED_TURNS = 1e6
"""Turns for which a dynamic load rating holds (ISO 3408-5)."""

_EIGENVALUES = (1.8751, math.pi, 3.9266, 4.7300)
"""First eigenvalues of a beam, by the bearings of `ENDS`."""

_EULER = (0.25, 1.0, 2.0, 4.0)
"""Factors of Euler's buckling load, by the bearings of `ENDS`."""


def mean_load(force: Vector, speed: Vector, time: Vector) -> float:
    """Return the equivalent mean load in N: the cubic mean of |force| over the travel (ISO 3408-5)."""
    travel = np.trapezoid(np.abs(speed), time)
    if not travel > 0.0:
        return 0.0
    return float(np.cbrt(np.trapezoid(np.abs(force) ** 3 * np.abs(speed), time) / travel))


def life_turns(C_a: float, load: float, f_w: float = 1.0) -> float:
    """Return the nominal life L10 in turns of the screw, infinity without load; `f_w` is for shocks."""
    return RATED_TURNS * (C_a / (f_w * load)) ** 3 if load > 0.0 else math.inf


def critical_speed(d_root: float, length: float, ends: int) -> float:
    """Return the permissible speed in rad/s: `SPEED_SAFETY` of the first resonance of a round shaft."""
    wave = (_EIGENVALUES[ends] / length) ** 2
    return SPEED_SAFETY * wave * 0.25 * d_root * math.sqrt(YOUNG / DENSITY)


def buckling_load(d_root: float, length: float, ends: int) -> float:
    """Return the permissible compressive force in N: `BUCKLING_SAFETY` of Euler's load."""
    inertia = math.pi / 64.0 * d_root**4
    return BUCKLING_SAFETY * _EULER[ends] * math.pi**2 * YOUNG * inertia / length**2
