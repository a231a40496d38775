"""Fewer pictures of a run, or empty ones: all are drawn alike, and each takes as long as the run."""

from typing import Any

import pytest

import emla_cosim.study.loading  # registers those of the study
import emla_cosim.views.plots.pictures
from emla_cosim.views.plots.pictures import FIGURES

DRAWN = 2


def draw_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs draw the first pictures only."""
    for name in list(FIGURES)[DRAWN:]:
        monkeypatch.delitem(FIGURES, name)


def draw_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs write the pictures that they would draw, without anything on them."""

    def empty(*_: Any) -> Any:
        from matplotlib.figure import Figure

        return Figure((1.0, 1.0))

    monkeypatch.setattr(emla_cosim.views.plots.pictures, "draw_panels", empty)
