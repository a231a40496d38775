"""Fewer pictures of a run: all are drawn alike, and each takes as long as the run."""

import pytest

import emla_cosim.loading  # noqa: F401  # registers those of the study
from emla_cosim.results.plotting import FIGURES

DRAWN = 2


def draw_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs draw the first pictures only."""
    for name in list(FIGURES)[DRAWN:]:
        monkeypatch.delitem(FIGURES, name)
