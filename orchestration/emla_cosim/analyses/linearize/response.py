"""Frequency responses of sampled signals, from their response to a pulse."""

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
        sizes = np.abs(_difference(samples, order))
        if sizes[-end:].max() <= _MAX_REMAINDER * sizes.max():
            return order
    return None


def transform_response(samples: Vector, integrators: int, frequency: Vector, step: float) -> Complex:
    """Return sum_k y_k z^-k at z = exp(j 2 pi f T), the z-transform on the unit circle.

    Differences of the samples have the transform (1 - z^-1)^n times that of the samples. They make the sum
    finite if the response has integrators.
    """
    delays: Complex = np.exp(-2j * np.pi * frequency * step)  # z^-1
    differences, k = _difference(samples, integrators), np.arange(len(samples))
    # frequency by frequency: all at once would need a matrix of samples by frequencies
    sums: Complex = np.array([delay**k @ differences for delay in delays], dtype=np.complex128)
    return sums / (1.0 - delays) ** integrators


def _difference(samples: Vector, order: int) -> Vector:
    return np.diff(samples, n=order, prepend=np.zeros(order)) if order else samples


def is_growing(samples: Vector) -> bool:
    """Return whether a response is larger in its last quarter than before."""
    last = 3 * len(samples) // 4
    return bool(np.abs(samples[last:]).max() > 1.5 * np.abs(samples[:last]).max())


def relative_norm(difference: Sequence[float] | Vector, of: Vector) -> float:
    """Return the norm of a difference relative to that of `of`; infinite if that is 0."""
    size = float(np.linalg.norm(of))
    return float(np.linalg.norm(difference)) / size if size else float("inf")
