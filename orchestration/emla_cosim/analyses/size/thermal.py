"""Winding temperature over a cycle that repeats, for the thermal body of the plant (`emla_fmu.thermal`)."""

import math

import numpy as np

from ...base.arrays import Vector


def heat(time: Vector, load: Vector, permitted_rise: float, tau_th: float, start: float = 0.0) -> Vector:
    """Return the temperature rise in K over a cycle.

    The solution of d rise / dt = (load * permitted_rise - rise) / tau_th is exact for a load that is linear
    between its values.

    Args:
        time: Times in s, shape (rows,).
        load: Copper loss relative to that of the rated current, shape (rows,).
        permitted_rise: Final rise in K at the rated current.
        tau_th: Thermal time constant in s.
        start: Rise in K at the first time.

    Returns:
        The rise in K at each time, shape (rows,).
    """
    steps = np.diff(time) / tau_th
    kept, gained = np.exp(-steps), -np.expm1(-steps)
    # integral of exp(s - step) times the share of the second value, by series for short steps
    share = np.where(steps > 1e-4, 1.0 - gained / np.maximum(steps, 1e-300), 0.5 * steps - steps**2 / 6.0)
    targets = permitted_rise * load
    added = (gained - share) * targets[:-1] + share * targets[1:]
    found, rise = [start], start
    for part, more in zip(kept.tolist(), added.tolist(), strict=True):
        rise = part * rise + more
        found.append(rise)
    return np.array(found)


def repeat_cycle(time: Vector, load: Vector, permitted_rise: float, tau_th: float) -> Vector:
    """Return the temperature rise in K over a cycle that has repeated for ever: it ends as it begins.

    The rise at the end is linear in that at the start, so the start follows in closed form.
    """
    cold = heat(time, load, permitted_rise, tau_th)[-1]
    start = float(cold) / -math.expm1(-(time[-1] - time[0]) / tau_th)
    return heat(time, load, permitted_rise, tau_th, start)


def cycles_until_warm(period: float, tau_th: float, fraction: float = 0.95) -> int:
    """Return the number of cycles after which a cold motor has this fraction of its final rise."""
    return max(math.ceil(-math.log1p(-fraction) * tau_th / period), 1)


def time_until_rise(time: Vector, rise: Vector, tau_th: float, threshold: float) -> float:
    """Return the time in s from cold after which a repeated cycle exceeds a rise; infinity if it never does.

    A cold motor differs from a warm one by the rise at the start, which decays.

    Args:
        time: Times in s, shape (rows,).
        rise: Rise in K of the warm motor, as of `repeat_cycle`, shape (rows,).
        tau_th: Thermal time constant in s.
        threshold: Rise in K.
    """
    rows = rise > threshold
    if not rows.any():
        return math.inf
    phase, period = (time - time[0])[rows], time[-1] - time[0]
    decayed = tau_th * np.log(rise[0] / (rise[rows] - threshold))
    cycles = np.maximum(np.ceil((decayed - phase) / period), 0.0)
    return float((phase + cycles * period).min())
