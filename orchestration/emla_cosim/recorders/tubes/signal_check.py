"""Signals held against their references."""

from collections.abc import Iterable

import numpy as np

from ...base.arrays import Vector
from .signal_comparison import Comparison
from .tolerance import Tolerance


def compare_signal(
    signal: str,
    unit: str,
    time: Vector,
    values: Vector,
    reference_time: Vector,
    reference: Vector,
    tolerance: Tolerance,
) -> Comparison:
    """A signal against its reference, over the time in s that both cover.

    Both have one value at least. Where the reference is not finite it says nothing; where the signal is
    not, it is outside.
    """
    said = np.isfinite(reference)
    if not said.any():
        said, reference = np.ones_like(said), np.zeros_like(reference)
    reference_time, reference = reference_time[said], reference[said]
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
    """Those outside of their tubes, the first one first."""
    return sorted((c for c in comparisons if c.left_at is not None), key=lambda c: c.left_at or 0.0)


def describe_departure(comparison: Comparison) -> str:
    """When a signal left its tube, and how far off it was at worst, as the end of a sentence."""
    unit = f" {comparison.unit}" if comparison.unit else ""
    return (
        f"{comparison.signal} left its tube at t = {comparison.left_at:.9g} s; it is off by up to "
        f"{comparison.worst:.3g}{unit}, at t = {comparison.worst_at:.9g} s, where "
        f"{comparison.tube.value:.3g}{unit} are allowed"
    )
