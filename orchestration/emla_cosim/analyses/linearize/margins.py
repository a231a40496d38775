"""Stability margins of a loop, from its frequency response."""

import math
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector
from .response import Complex

LEAST_PHASE_DEG, LEAST_GAIN_DB, LARGEST_MS = 30.0, 6.0, 2.2
"""Conditions on a loop in comparisons and tunings. The gain margin is required both ways."""


@dataclass(frozen=True)
class Margins:
    """Stability margins of a closed loop that is stable.

    The loop gain L has the sign of negative feedback: the loop is at its limit where L = -1.

    Attributes:
        phase_deg: Smallest phase margin in degrees; infinite if |L| never is 1.
        phase_at: Its frequency in Hz.
        gain_up_dB: Increase of the gain in dB until the loop is at its limit; infinite if there is none.
        gain_up_at: Its frequency in Hz.
        gain_down_dB: The same for a decrease, negative.
        gain_down_at: Its frequency in Hz.
        delay_s: Additional delay in s until the loop is at its limit.
        Ms: Largest |1 / (1 + L)|, the inverse of the smallest distance to -1.
        Ms_at: Its frequency in Hz.
    """

    phase_deg: float
    phase_at: float
    gain_up_dB: float
    gain_up_at: float
    gain_down_dB: float
    gain_down_at: float
    delay_s: float
    Ms: float
    Ms_at: float

    @property
    def has_crossover(self) -> bool:
        """Whether the gain of the loop is 1 at any frequency."""
        return math.isfinite(self.phase_deg)


def compute_margins(frequency: Vector, L: Complex) -> Margins:
    """Return the margins of a loop gain at increasing frequencies in Hz.

    Source: Astrom and Murray, Feedback Systems, 2nd edition, section 10.3.
    """
    # logarithms: between two points, gains and frequencies are straighter there
    log_f, log_gain = np.log(frequency), np.log(np.maximum(np.abs(L), 1e-300))
    phase = np.unwrap(np.angle(L))
    crossings = _interpolate_crossings(log_gain, log_f, phase)
    phases = [(math.remainder(p + math.pi, 2.0 * math.pi), f) for f, p in crossings]
    worst, at = min(phases, key=lambda x: abs(x[0]), default=(math.inf, math.nan))
    delays = [((p + math.pi) % (2.0 * math.pi)) / (2.0 * math.pi * math.exp(f)) for f, p in crossings]
    # where L crosses the real axis, also at half the sample rate
    gains = [(x, math.exp(f)) for x, f in _interpolate_crossings(L.imag, L.real, log_f)]
    # a sampled loop is real at half the sample rate, where it may cross without a change of sign
    if abs(L[-1].imag) <= 1e-6 * abs(L[-1]):
        gains.append((float(L[-1].real), math.exp(log_f[-1])))
    up = min(((-20.0 * math.log10(-x), f) for x, f in gains if -1.0 < x < 0.0), default=(math.inf, math.nan))
    down = max(((-20.0 * math.log10(-x), f) for x, f in gains if x < -1.0), default=(-math.inf, math.nan))
    S = 1.0 / np.abs(1.0 + L)
    peak = int(np.argmax(S))
    return Margins(
        phase_deg=math.degrees(abs(worst)),
        phase_at=math.exp(at),
        gain_up_dB=up[0],
        gain_up_at=up[1],
        gain_down_dB=down[0],
        gain_down_at=down[1],
        delay_s=min(delays, default=math.inf),
        Ms=float(S[peak]),
        Ms_at=float(frequency[peak]),
    )


def _interpolate_crossings(values: Vector, *curves: Vector) -> list[tuple[float, ...]]:
    """Return what others are where values cross 0, by straight lines between the points."""
    rows = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    share = values[rows] / (values[rows] - values[rows + 1])
    return [
        tuple(float(o[k] + s * (o[k + 1] - o[k])) for o in curves) for k, s in zip(rows, share, strict=True)
    ]
