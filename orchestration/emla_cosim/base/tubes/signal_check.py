"""Compare signals with their references."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..arrays import Vector
from .tolerance import Tolerance, Tube


@dataclass(frozen=True)
class Comparison:
    """One signal with its reference and the tube around it.

    Attributes:
        signal: full name.
        unit: unit of the values.
        time: times of the signal in s, shape (n,).
        values: values of the signal, shape (n,).
        reference_time: times of the reference in s, shape (m,).
        reference: values of the reference, shape (m,).
        lower: lower edge of the tube at `time`, shape (n,).
        upper: upper edge of the tube at `time`, shape (n,).
        worst: largest difference that no shift in time within the tube explains.
        worst_at: its time in s.
        left_at: first time outside of the tube in s; None if the signal stays inside.
        tube: size of the tube.
    """

    signal: str
    unit: str
    time: Vector
    values: Vector
    reference_time: Vector
    reference: Vector
    lower: Vector
    upper: Vector
    tube: Tube
    worst: float
    worst_at: float
    left_at: float | None

    @property
    def inside(self) -> bool:
        """Whether the signal stays in its tube."""
        return self.left_at is None


def compare_signal(
    signal: str,
    unit: str,
    time: Vector,
    values: Vector,
    reference_time: Vector,
    reference: Vector,
    tolerance: Tolerance,
    is_held: bool = False,
) -> Comparison:
    """Compare a signal with its reference, over the time that both cover.

    Values of the reference that are not finite are ignored; such values of the signal are outside the tube.

    Args:
        signal: Name of the signal.
        unit: Unit of both.
        time: Times of the signal in s, shape (n,) with n > 0.
        values: The signal, shape (n,).
        reference_time: Times of the reference in s, shape (m,) with m > 0.
        reference: The reference, shape (m,).
        tolerance: Allowed deviations.
        is_held: Whether the reference holds between its points, as that of discrete variables does; otherwise
            it is linear.
    """
    finite = np.isfinite(reference)
    if not finite.any():
        finite, reference = np.ones_like(finite), np.zeros_like(reference)
    reference_time, reference = reference_time[finite], reference[finite]
    if is_held:  # two points at each time but the first
        reference_time, reference = np.repeat(reference_time, 2)[1:], np.repeat(reference, 2)[:-1]
    tube = tolerance.tube(reference_time, reference)
    low, high = reference_time[0] - tube.time, reference_time[-1] + tube.time
    common = (time >= low) & (time <= high)
    time, values = time[common], values[common]
    lower, upper = tube.edges(time, reference_time, reference)
    off: Vector = np.fmax(np.fmax(lower - values, values - upper), 0.0)
    off[~np.isfinite(values)] = np.inf
    outside = off > tube.value
    k = int(np.argmax(off)) if len(off) else 0
    return Comparison(
        signal=signal,
        unit=unit,
        time=time,
        values=values,
        reference_time=reference_time,
        reference=reference,
        lower=lower - tube.value,
        upper=upper + tube.value,
        tube=tube,
        worst=float(off[k]) if len(off) else 0.0,
        worst_at=float(time[k]) if len(off) else float(reference_time[0]),
        left_at=float(time[np.argmax(outside)]) if outside.any() else None,
    )


def select_outside(comparisons: Iterable[Comparison]) -> list[Comparison]:
    """Return the signals that leave their tubes, in the order of time."""
    return sorted((c for c in comparisons if c.left_at is not None), key=lambda c: c.left_at or 0.0)


def describe_departure(comparison: Comparison) -> str:
    """Return when a signal left its tube, and its largest deviation, as part of a message."""
    unit = f" {comparison.unit}" if comparison.unit else ""
    return (
        f"{comparison.signal} left its tube at t = {comparison.left_at:.9g} s; it is off by up to "
        f"{comparison.worst:.3g}{unit}, at t = {comparison.worst_at:.9g} s, where "
        f"{comparison.tube.value:.3g}{unit} are allowed"
    )
