"""Colours and legend of the outcomes of variants."""

from typing import TYPE_CHECKING

import numpy as np

from ...views.plots.style import BLUE, GREY, ORANGE, PURPLE, RED
from ..columns import NOT_HELD
from ..data import DIED, DIVERGED, DONE, FAILED, REFUSED, TIMED_OUT

if TYPE_CHECKING:
    from matplotlib.artist import Artist

_COLORS = {
    DONE: BLUE,
    NOT_HELD: ORANGE,
    DIVERGED: RED,
    FAILED: PURPLE,
    REFUSED: GREY,
    TIMED_OUT: "#8a6d3b",
    DIED: "#222222",
}


def color_of(outcome: str) -> str:
    """Return the colour of an outcome."""
    return _COLORS.get(outcome, GREY)


def count_outcomes(outcomes: np.ndarray) -> dict[str, int]:
    """Return the number of variants with each outcome, in the order of severity."""
    found = {name: int((outcomes == name).sum()) for name in dict.fromkeys([*_COLORS, *outcomes])}
    return {name: count for name, count in found.items() if count}


def make_legend_handles(outcomes: np.ndarray, done: str) -> "dict[str, Artist]":
    """Return legend handles: each outcome with its number. `done` is the name of the good outcome."""
    from matplotlib.lines import Line2D

    return {
        f"{done if name == DONE else name} ({count:,})": Line2D(
            [], [], color=color_of(name), marker="o", linestyle="", markersize=5
        )
        for name, count in count_outcomes(outcomes).items()
    }
