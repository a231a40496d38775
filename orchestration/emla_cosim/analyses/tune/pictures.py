"""The picture of a tuning: the course of the search, and the result on other seeds."""

from typing import TYPE_CHECKING

import numpy as np

from ...views.plots.style import BLUE, GREEN, GREY, ORANGE, new_figure, tidy_axes
from .data import TuneData

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_picture(result: TuneData) -> "Figure":
    """Draw all tried sets on the left, and on the right start and best on both sets of seeds, by case."""
    figure, axes = new_figure(1, 2, 4.6, 3.0, sharex="none")
    _search(axes[0, 0], result)
    _cases(axes[0, 1], result)
    return figure


def _search(axes: "Axes", result: TuneData) -> None:
    tried = result.history
    number = tried["evaluation"].to_numpy()
    objective = tried["objective"].cast(float).to_numpy()
    holds = (tried["violation"] == 0.0).to_numpy()
    axes.plot(number[~holds], objective[~holds], "x", color=GREY, markersize=3, label="not as required")
    axes.plot(number[holds], objective[holds], ".", color=BLUE, markersize=4, label="as required")
    axes.step(number, tried["best"].cast(float).to_numpy(), where="post", color=ORANGE, label="best so far")
    _use_log_scale(axes, objective)
    axes.set_xlabel("sets of gains tried", fontsize=9)
    axes.set_ylabel("objective", fontsize=9)
    axes.set_title(result.objective, fontsize=8, parse_math=False)
    tidy_axes(axes, ["not as required", "as required", "best so far"])


def _cases(axes: "Axes", result: TuneData) -> None:
    cases = list(result.best.training.by_case)
    shown = {
        "start, training": (result.start.training, GREY, "o"),
        "start, validation": (result.start.validation, GREY, "_"),
        "best, training": (result.best.training, GREEN, "o"),
        "best, validation": (result.best.validation, GREEN, "_"),
    }
    labels, everything = list[str](), list[float]()
    for label, (score, color, marker) in shown.items():
        if score is not None:
            values = [score.by_case.get(case, np.nan) for case in cases]
            axes.plot(
                range(len(cases)), values, marker, color=color, markersize=9 if marker == "_" else 5, mew=2
            )
            labels.append(label)
            everything += values
    _use_log_scale(axes, np.array(everything))
    axes.set_xticks(range(len(cases)), cases, rotation=30, ha="right", parse_math=False)
    axes.set_xlim(-0.5, max(len(cases), 1) - 0.5)
    tidy_axes(axes, labels)
    axes.margins(x=0.1)


def _use_log_scale(axes: "Axes", values: np.ndarray) -> None:
    """Use a logarithmic scale if all values are positive."""
    known = values[np.isfinite(values)]
    if known.size and (known > 0).all():
        axes.set_yscale("log")
        axes.tick_params(which="both", labelsize=8)
