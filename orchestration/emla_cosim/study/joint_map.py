"""A picture of all joints of a run with many: how large their errors are, and which are not held."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Vector
from ..recorders.metrics import HELD, MetricDisplay
from ..run.result import Result
from ..views.formatting import format_headline
from ..views.plots.pictures import MOST_COLUMNS, Drawing
from ..views.plots.style import BLUE, RED, new_figure, tidy_axes
from .criteria import TOO_SHORT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KIND = "joints"
_SHOWN = (
    MetricDisplay("position_error_m", "position error", 1e6, "µm"),
    MetricDisplay("settling_time_s", "settling time", 1e3, "ms"),
    MetricDisplay("torque_peak_N_m", "torque peak", 1.0, "N m"),
)

_MOST_NAMES = 80
"""Most names on the axis; of more joints only every n-th has its name."""

_WIDE = 30.0
"""Ratio of the largest to the smallest value from which on the scale is logarithmic."""


class JointMap(Drawing):
    """The metrics of all joints, if these are more than the other plots show."""

    def signals(self, result: Result) -> Iterable[str]:
        """Return nothing: it shows metrics."""
        return ()

    def drawn(self, result: Result, data: Mapping[str, Vector]) -> "Figure | None":
        """Draw one panel for each metric, with a point for each joint."""
        joints = result.metrics.get(_KIND, {})
        if len(joints) <= MOST_COLUMNS:
            return None
        names = list(joints)
        judged = np.array([one["reason"] != f"{TOO_SHORT}." for one in joints.values()])
        lost = judged & np.array([not one[HELD] for one in joints.values()])
        width = float(np.clip(0.14 * len(names), 6.0, 12.0))
        figure, grid = new_figure(len(_SHOWN), 1, width, 1.7)
        for axes, metric in zip(grid[:, 0], _SHOWN, strict=True):
            _draw(axes, metric, np.array([metric.factor * one[metric.name] for one in joints.values()]), lost)
        _name_joints(grid[-1, 0], names)
        verdict = "all are held" if judged.all() else "the run is too short to judge them"
        if lost.any():
            verdict = f"{int(lost.sum())} not held, in red"
        figure.suptitle(f"All {len(names)} joints: {verdict}", fontsize=12, fontweight="bold")
        grid[0, 0].set_title(format_headline(result), fontsize=9, parse_math=False)
        return figure


def _draw(axes: "Axes", metric: MetricDisplay, values: Vector, lost: Any) -> None:
    """Draw the values that exist, those of joints that are not held in red."""
    places = np.arange(len(values))
    for which, color in ((~lost, BLUE), (lost, RED)):
        axes.plot(places[which], values[which], "o", color=color, markersize=4.0)
    known = values[np.isfinite(values) & (values > 0.0)]
    if len(known) and known.max() > _WIDE * known.min() and not (values <= 0.0).any():
        axes.set_yscale("log")
    axes.set_ylabel(f"{metric.label} / {metric.unit}".replace("N m", "(N m)"))
    tidy_axes(axes)


def _name_joints(axes: "Axes", names: Sequence[str]) -> None:
    every = math.ceil(len(names) / _MOST_NAMES)
    axes.set_xticks(range(0, len(names), every), names[::every], rotation=90, fontsize=7)
    for label in axes.get_xticklabels():
        label.set_parse_math(False)
