"""A filter that removes a frequency from a motion: functions of its lags, as a list of `ORDER` values.

With L = 1 / (1 + s / omega) and g = 2 (1 - zeta), the filter is (1 - g L + g L^2)^2, which is
((s^2 + 2 zeta omega s + omega^2) / (s + omega)^2)^2. The double zeros at the poles of the swing leave no
swing at the frequency, and little near it, like the shapers of N. C. Singer and W. P. Seering, Preshaping
command inputs to reduce system vibration, J. Dyn. Syst. Meas. Control 112 (1990). Unlike a shaper, it needs
no stored past, and so no fixed step. Its gain is at most 1, and 1 at rest.
"""

import math
from typing import Any

from fmublock import where

ORDER = 4
"""Number of lags: as many as poles."""


def derivatives(p: Any, x: Any, frequency: Any) -> list[Any]:
    """Return the rates of the lags in m/s; 0 for a frequency of 0.

    Args:
        p: The lags in m; each follows the one before.
        x: The position to filter in m.
        frequency: In Hz.
    """
    return _rates(p, x, 2.0 * math.pi * frequency)


def outputs(p: Any, motion: tuple[Any, Any, Any], frequency: Any, zeta: Any) -> tuple[Any, Any, Any]:
    """Return the filtered position, speed and acceleration; the motion itself for a frequency of 0.

    Args:
        p: The lags in m.
        motion: Position in m, speed in m/s and acceleration in m/s2 to filter.
        frequency: In Hz.
        zeta: The damping ratio of the swing.
    """
    x, speed, acceleration = motion
    omega = 2.0 * math.pi * frequency
    rates = _rates(p, x, omega)
    g, is_on = 2.0 * (1.0 - zeta), frequency > 0.0
    signals = ((x, p), (speed, rates), (acceleration, _rates(rates, speed, omega)))
    filtered = (
        u - 2.0 * g * q[0] + (2.0 * g + g * g) * q[1] - 2.0 * g * g * q[2] + g * g * q[3] for u, q in signals
    )
    x_s, v_s, a_s = (where(is_on, new, old) for new, old in zip(filtered, motion, strict=True))
    return x_s, v_s, a_s


def _rates(p: Any, x: Any, omega: Any) -> list[Any]:
    return [omega * (before - lag) for before, lag in zip([x, *p[:-1]], p, strict=True)]
