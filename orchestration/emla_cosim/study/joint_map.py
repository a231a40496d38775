"""A picture of all joints of a run with many: how large their errors are, and which are not held."""

import math
from collections.abc import Iterable, Mapping
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
_DISPLAYS = (
    MetricDisplay("position_error_m", "position error", 1e6, "µm"),
    MetricDisplay("settling_time_s", "settling time", 1e3, "ms"),
    MetricDisplay("torque_peak_N_m", "torque peak", 1.0, "N m"),
)

_MOST_NAMES = 80
"""Most names on the axis; of more joints only every n-th has its name."""

_LOGARITHMIC_RATIO = 30.0
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
        has_verdict = np.array([item["reason"] != f"{TOO_SHORT}." for item in joints.values()])
        is_not_held = has_verdict & np.array([not item[HELD] for item in joints.values()])
        # room for the mark of each joint
        width = float(np.clip(0.14 * len(names), 6.0, 12.0))
        figure, grid = new_figure(len(_DISPLAYS), 1, width, 1.7)
        for axes, metric in zip(grid[:, 0], _DISPLAYS, strict=True):
            values = np.array([metric.factor * item[metric.name] for item in joints.values()])
            _draw(axes, metric, values, is_not_held)
        interval = math.ceil(len(names) / _MOST_NAMES)
        grid[-1, 0].set_xticks(range(0, len(names), interval), names[::interval], rotation=90, fontsize=7)
        for label in grid[-1, 0].get_xticklabels():
            label.set_parse_math(False)
        verdict = "all are held" if has_verdict.all() else "the run is too short to judge them"
        if is_not_held.any():
            verdict = f"{int(is_not_held.sum())} not held, in red"
        figure.suptitle(f"All {len(names)} joints: {verdict}", fontsize=12, fontweight="bold")
        grid[0, 0].set_title(format_headline(result), fontsize=9, parse_math=False)
        return figure


def _draw(axes: "Axes", metric: MetricDisplay, values: Vector, is_not_held: Any) -> None:
    """Draw the values that exist, those of joints that are not held in red."""
    numbers = np.arange(len(values))
    for mask, color in ((~is_not_held, BLUE), (is_not_held, RED)):
        axes.plot(numbers[mask], values[mask], "o", color=color, markersize=4.0)
    positive = values[np.isfinite(values) & (values > 0.0)]
    if len(positive) and positive.max() > _LOGARITHMIC_RATIO * positive.min() and not (values <= 0.0).any():
        axes.set_yscale("log")
    axes.set_ylabel(f"{metric.label} / {metric.unit}".replace("N m", "(N m)"))
    tidy_axes(axes)
