"""A filter that removes a frequency from a motion: functions of its lags, as a list of `ORDER` values.

With L = 1 / (1 + s / omega) and g = 2 (1 - zeta), the filter is (1 - g L + g L^2)^2, which is
((s^2 + 2 zeta omega s + omega^2) / (s + omega)^2)^2. The double zeros at the poles of the swing leave no
swing at the frequency, and little near it, like the shapers of N. C. Singer and W. P. Seering, Preshaping
command inputs to reduce system vibration, J. Dyn. Syst. Meas. Control 112 (1990). Unlike a shaper, it needs
no stored past, and so no fixed step. Its gain is at most 1, and 1 at rest. A position that only rises is
never exceeded.
"""

import math
from typing import Any

from fmublock import where

ORDER = 4
"""Number of lags: as many as poles."""


def rates(p: Any, x: Any, frequency: Any) -> list[Any]:
    """Return the rates of the lags in m/s; 0 for a frequency of 0.

    Args:
        p: The lags in m; each follows the one before.
        x: The position to filter in m.
        frequency: In Hz.
    """
    omega = 2.0 * math.pi * frequency
    return [omega * (before - lag) for before, lag in zip([x, *p[:-1]], p, strict=True)]


def filtered(p: Any, x: Any, frequency: Any, zeta: Any) -> Any:
    """Return the filtered position in m; the position itself for a frequency of 0.

    The filter is linear: rates of the lags and a speed give the filtered speed.

    Args:
        p: The lags in m.
        x: The position to filter in m.
        frequency: In Hz.
        zeta: The damping ratio of the swing.
    """
    g = 2.0 * (1.0 - zeta)
    new = x - 2.0 * g * p[0] + (2.0 * g + g * g) * p[1] - 2.0 * g * g * p[2] + g * g * p[3]
    return where(frequency > 0.0, new, x)
