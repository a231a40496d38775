"""Signals beside their references, as rows of a page with plots."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Vector
from ..base.colors import BLUE, GREY, RED
from ..base.tolerances import Comparison
from .page import Plots
from .panels import Band, Line, Plot, mask_undrawable

_OPEN_PLOTS = 3
"""Most signals outside their tubes whose plots are open at first."""


@dataclass(frozen=True)
class ComparedSignal:
    """A signal beside its reference, its plots, and whether they are open at first."""

    comparison: Comparison
    plots: tuple[str, str]
    open: bool

    @property
    def share(self) -> float | None:
        """Largest deviation relative to half the tube's height; None if it is not finite."""
        return _find_share(self.comparison)


def build_comparison_rows(comparisons: Sequence[Comparison], plots: Plots) -> list[ComparedSignal]:
    """Return rows for the macro `comparisons`, the largest deviations first."""

    def urgency(comparison: Comparison) -> tuple[bool, float]:
        # what left its tube, by the time at which it did; then the rest, by its distance from the edge
        left_at = comparison.left_at
        return left_at is None, -(_find_share(comparison) or 0.0) if left_at is None else left_at

    ordered = sorted(comparisons, key=urgency)
    outside = sum(not comparison.inside for comparison in ordered)
    return [
        ComparedSignal(comparison, _add_plots(comparison, plots), k < max(1, min(outside, _OPEN_PLOTS)))
        for k, comparison in enumerate(ordered)
    ]


def _find_share(comparison: Comparison) -> float | None:
    half_height = comparison.tube.value
    share = abs(comparison.worst) / half_height if half_height > 0 else math.nan
    return share if math.isfinite(share) else None


def _add_plots(comparison: Comparison, plots: Plots) -> tuple[str, str]:
    """Add a plot of the values and one of the deviations, which shows also a thin tube. Return their ids."""
    time, base = comparison.time, _interpolate(comparison)
    color = BLUE if comparison.inside else RED
    # beside the values themselves, a thin tube would not be visible
    deviations = [
        mask_undrawable(curve) - base for curve in (comparison.values, comparison.lower, comparison.upper)
    ]
    subject = plots.new_subject()
    mark = comparison.worst_at, "worst"
    since = None if comparison.left_at is None else (comparison.left_at, "left the tube")
    reference = Line("reference", comparison.reference_time, comparison.reference, GREY, dashed=True)
    values = Plot(
        comparison.unit,
        (Line("result", time, comparison.values, color), reference),
        Band("tube", time, comparison.lower, comparison.upper),
        mark,
        since,
        column=subject,
    )
    deviation = Plot(
        f"deviation / {comparison.unit}" if comparison.unit else "deviation",
        (Line("result", time, deviations[0], color),),
        Band("tube", time, *deviations[1:]),
        mark,
        since,
        shows_all=True,
        column=subject,
    )
    return plots.add(values), plots.add(deviation)


def _interpolate(comparison: Comparison) -> Vector:
    """Return the reference at the times of the result."""
    if not len(comparison.reference_time):
        return np.full(len(comparison.time), np.nan)
    return np.interp(comparison.time, comparison.reference_time, mask_undrawable(comparison.reference))
