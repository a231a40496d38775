"""Load and temperature of the motor: functions of the plant's values `v`."""

from typing import Any

from fmublock import where


def load(v: Any) -> Any:
    """Return the copper loss relative to the rated one: (i_q^2 + i_d^2) / i_N^2, or 0 if i_N = 0."""
    i_N = where(v.i_N > 0.0, v.i_N, 1.0)
    return where(v.i_N > 0.0, (v.i_q * v.i_q + v.i_d * v.i_d) / (i_N * i_N), 0.0)


def heating(v: Any) -> Any:
    """Return the time derivative of the winding's temperature rise in K/s, for one thermal body.

    Its thermal resistance is such that the rated current leads to the permitted rise.
    """
    return (load(v) * v.permitted_rise - v.temperature_rise) / v.tau_th


def resistance(v: Any) -> Any:
    """Return the stator resistance in Ohm at the temperature of the winding (IEC 60034-1 for copper)."""
    return v.R_s * (1.0 + v.alpha_R * v.temperature_rise)
