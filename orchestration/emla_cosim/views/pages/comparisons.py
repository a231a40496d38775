"""Signals beside their references, as rows of a page with a plot each."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...base.colors import BLUE, GREY, RED
from ...recorders.tubes.signal_check import Comparison
from ..panels import Band, Line, Plot
from .page import Plots

_OPEN_PLOTS = 3
"""Most signals outside their tubes whose plots are open at first."""


@dataclass(frozen=True)
class ComparedSignal:
    """A signal beside its reference, its plot, and whether the plot is open at first."""

    comparison: Comparison
    plot: str
    open: bool

    @property
    def share(self) -> float | None:
        """Largest deviation relative to the tube's width; None if it is no number."""
        return _share(self.comparison)


def build_comparison_rows(comparisons: Sequence[Comparison], plots: Plots) -> list[ComparedSignal]:
    """Return rows for the macro of `comparisons.html`, the largest deviations first."""
    ordered = sorted(comparisons, key=_urgency)
    many = sum(not one.inside for one in ordered)
    return [
        ComparedSignal(one, plots.add(_plot(one)), k < max(1, min(many, _OPEN_PLOTS)))
        for k, one in enumerate(ordered)
    ]


def _share(one: Comparison) -> float | None:
    share = abs(one.worst) / one.tube.value if one.tube.value > 0 else math.nan
    return share if math.isfinite(share) else None


def _urgency(one: Comparison) -> tuple[bool, float]:
    """Sort by the time of leaving the tube, then by distance from its edge."""
    if one.left_at is not None:
        return False, one.left_at
    return True, -(_share(one) or 0.0)


def _plot(one: Comparison) -> Plot:
    return Plot(
        one.unit,
        (
            Line("result", one.time, one.values, BLUE if one.inside else RED),
            Line("reference", one.reference_time, one.reference, GREY, dashed=True),
        ),
        Band("tube", one.time, one.lower, one.upper),
        mark=(one.worst_at, "worst"),
        since=None if one.left_at is None else (one.left_at, "left the tube"),
        against=1,
    )
