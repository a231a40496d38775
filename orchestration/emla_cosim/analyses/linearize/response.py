"""Linear models from a run: frequency responses, stability margins and state matrices."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...base.extras import require_extra

Complex = NDArray[np.complex128]

_MAX_REMAINDER = 1e-3
"""Largest remainder of a response at its end, relative to its peak."""

_END_PARTS = 20
"""The last 1/20 of a response is its end."""


@dataclass(frozen=True)
class FrequencyResponse:
    """Frequency response of the sampled system: inputs hold their value during a step.

    Attributes:
        name: Name of the response.
        frequency: Frequencies in Hz, up to half the sample rate.
        value: Complex values, shape (frequencies,).
        error: Estimated relative error by nonlinearity and rounding, shape (frequencies,).
        step: Sample time in s.
        unit: Unit of the values.
    """

    name: str
    frequency: Vector
    value: Complex
    error: Vector
    step: float
    unit: str = ""

    @property
    def gain_dB(self) -> Vector:
        """Gain in dB."""
        return 20.0 * np.log10(np.maximum(np.abs(self.value), 1e-300))

    @property
    def phase_deg(self) -> Vector:
        """Phase in degrees, without jumps."""
        return np.degrees(np.unwrap(np.angle(self.value)))

    def to_control(self) -> Any:
        """Return the response as `control.FrequencyResponseData`.

        Raises:
            CommandError: python-control is not installed.
        """
        return import_control().frd(self.value, 2.0 * np.pi * self.frequency, self.step)


def import_control() -> Any:
    """Return the module of python-control; CommandError if it is not installed."""
    require_extra("control", "python-control's form of a system")
    import control  # type: ignore[import-not-found]

    return control


def count_integrators(samples: Vector) -> int | None:
    """Return how often a response must be differenced until it decays; None if that is more than twice."""
    end = max(len(samples) // _END_PARTS, 1)
    for order in range(3):
        sizes = np.abs(_compute_difference(samples, order))
        if sizes[-end:].max() <= _MAX_REMAINDER * sizes.max():
            return order
    return None


def transform_response(samples: Vector, integrators: int, frequency: Vector, step: float) -> Complex:
    """Return sum_k y_k z^-k at z = exp(j 2 pi f T), the z-transform on the unit circle.

    Differences of the samples have the transform (1 - z^-1)^n times that of the samples. They make the sum
    finite if the response has integrators.
    """
    delays: Complex = np.exp(-2j * np.pi * frequency * step)  # z^-1
    differences, k = _compute_difference(samples, integrators), np.arange(len(samples))
    # frequency by frequency: all at once would need a matrix of samples by frequencies
    sums: Complex = np.array([delay**k @ differences for delay in delays], dtype=np.complex128)
    return sums / (1.0 - delays) ** integrators


def _compute_difference(samples: Vector, order: int) -> Vector:
    return np.diff(samples, n=order, prepend=np.zeros(order)) if order else samples


def is_growing(samples: Vector) -> bool:
    """Return whether a response is larger in its last quarter than before."""
    last = 3 * len(samples) // 4
    return bool(np.abs(samples[last:]).max() > 1.5 * np.abs(samples[:last]).max())


def relative_norm(difference: Sequence[float] | Vector, of: Vector) -> float:
    """Return the norm of a difference relative to that of `of`; infinite if that is 0."""
    size = float(np.linalg.norm(of))
    return float(np.linalg.norm(difference)) / size if size else float("inf")


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


@dataclass(frozen=True)
class StateSpace:
    """State matrices of a system at an operating point.

    All values are differences from the operating point, in the units of the variables.

    Attributes:
        states: Full names of the states.
        inputs: Full names of the inputs.
        outputs: Full names of the outputs.
        units: Units by name.
        A: Derivatives by states, shape (states, states).
        B: Derivatives by inputs, shape (states, inputs).
        C: Outputs by states, shape (outputs, states).
        D: Outputs by inputs, shape (outputs, inputs).
        at_states: States at the operating point.
        at_inputs: Inputs at the operating point.
        at_outputs: Outputs at the operating point.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str]
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    at_states: Vector
    at_inputs: Vector
    at_outputs: Vector

    @property
    def poles(self) -> Complex:
        """Poles in 1/s, slow ones first."""
        poles = np.linalg.eigvals(self.A).astype(np.complex128)
        return poles[np.lexsort((poles.imag, np.abs(poles).round(12)))]

    @property
    def damping(self) -> Vector:
        """Damping ratio of each pole: 1 without oscillation, 0 or less if it does not decay."""
        size = np.abs(self.poles)
        return np.where(size > 0.0, -self.poles.real / np.maximum(size, 1e-300), 0.0)

    @property
    def record(self) -> dict[str, Any]:
        """Content for `linearize.json`."""
        return {
            **{
                kind: [
                    {"name": n, "unit": self.units[n], "value": float(x)}
                    for n, x in zip(getattr(self, kind), getattr(self, f"at_{kind}"), strict=True)
                ]
                for kind in ("states", "inputs", "outputs")
            },
            **{name: getattr(self, name).tolist() for name in "ABCD"},
            "poles": [
                {"real": float(p.real), "imag": float(p.imag), "damping": float(d)}
                for p, d in zip(self.poles, self.damping, strict=True)
            ],
        }

    def to_control(self) -> Any:
        """Return the matrices as `control.StateSpace`, with the names of states, inputs and outputs.

        Raises:
            CommandError: python-control is not installed.
        """
        names = {
            kind: [n.replace(".", "_") for n in getattr(self, kind)]
            for kind in ("states", "inputs", "outputs")
        }
        return import_control().ss(self.A, self.B, self.C, self.D, **names)

    def to_scipy(self) -> Any:
        """Return the matrices as `scipy.signal.StateSpace`."""
        from scipy.signal import StateSpace as ScipyStateSpace  # slow to import

        return ScipyStateSpace(self.A, self.B, self.C, self.D)
