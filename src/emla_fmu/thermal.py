"""The motor's load over time: functions of the plant's values `v`."""

from typing import Any

from fmublock import where


def load(v: Any) -> Any:
    """Copper loss relative to that of the rated current, (i_q^2 + i_d^2) / i_N^2; 0 where i_N is 0."""
    i_N = where(v.i_N > 0.0, v.i_N, 1.0)
    return where(v.i_N > 0.0, (v.i_q * v.i_q + v.i_d * v.i_d) / (i_N * i_N), 0.0)


def heating(v: Any) -> Any:
    """Time derivative of the winding's temperature rise in K/s: one body that loses what it gains.

    Its thermal resistance is such that the rated current ends at the permitted rise. R_s does not
    change with temperature.
    """
    return (load(v) * v.permitted_rise - v.temperature_rise) / v.tau_th
