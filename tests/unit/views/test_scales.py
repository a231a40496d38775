"""Scales of the plots of a run, against those of Matplotlib."""

import re
from io import BytesIO

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import assume, given
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from emla_cosim.views.panels import Line, Plot
from emla_cosim.views.plots.panel_drawing import draw_panels
from emla_cosim.views.plots.scales import PlainAxes, Scales
from emla_cosim.views.plots.style import save, tidy_axes

ENDS = st.floats(-1e9, 1e9, allow_nan=False)


def of_matplotlib(low: float, high: float) -> tuple[list[float], list[str], str]:
    """Places, labels and common text of Matplotlib's ticks between two values."""
    figure = Figure()
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.set_xlim(low, high)
    axes.locator_params(nbins=5)
    figure.draw_without_rendering()
    margin = 1e-10 * (high - low)
    seen = [
        (label.get_position()[0], label.get_text())
        for label in axes.get_xticklabels()
        if low - margin <= label.get_position()[0] <= high + margin
    ]
    return [at for at, _ in seen], [text for _, text in seen], axes.xaxis.get_offset_text().get_text()


@given(low=ENDS, length=st.floats(1e-9, 1e9), exponent=st.integers(-12, 9))
def test_ticks_and_labels_are_those_of_matplotlib(low: float, length: float, exponent: int) -> None:
    low, high = low * 10.0**exponent, (low + length) * 10.0**exponent
    assume(high - low > 1e-9 * max(abs(low), abs(high)) and high - low > 1e-30)
    axes = Figure().subplots(subplot_kw={"axes_class": PlainAxes})
    axes.set_xlim(low, high)
    places, labels, common = Scales(axes).find_ticks(axes.xaxis)
    right_places, right_labels, right_common = of_matplotlib(low, high)
    np.testing.assert_allclose(places, right_places, rtol=1e-12, atol=1e-12 * (high - low))
    assert (labels, common) == (right_labels, right_common)


def panels() -> list[Plot]:
    time = np.linspace(0.0, 2.0, 400)
    values = {"small": 1e-7 * np.sin(9 * time), "large": 1e6 + 3e4 * time, "usual": np.cos(5 * time)}
    rows = [[Plot(f"{n} / m", (Line("", time, v),), column=c) for c in "ab"] for n, v in values.items()]
    return [panel for row in rows for panel in row]


def picture(figure: Figure) -> np.ndarray:
    content = BytesIO()
    save(figure, content)
    return np.asarray(Image.open(content).convert("L")).astype(int)


@pytest.mark.slow
def test_picture_has_the_scales_of_matplotlib(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few pixels differ, and these lie beside each other: labels are moved by less than two pixels."""
    found = picture(draw_panels(panels(), "Title", "run"))

    class Usual:
        """What draws the scales of Matplotlib."""

        def __init__(self, axes: PlainAxes) -> None:
            self.axes = axes
            axes.locator_params(nbins=5)
            tidy_axes(axes)

        def __setattr__(self, name: str, value: object) -> None:
            super().__setattr__(name, value)
            if name == "shows_time":
                self.axes.tick_params(labelbottom=value)

    monkeypatch.setattr("emla_cosim.views.plots.scales.Scales", Usual)
    monkeypatch.setattr("emla_cosim.views.plots.scales.PlainAxes", None)
    right = picture(draw_panels(panels(), "Title", "run"))
    assert found.shape == right.shape
    assert (abs(found - right) > 64).mean() < 0.01
    dark = right < 128
    near = np.zeros_like(dark)
    for down in range(-2, 3):
        for along in range(-2, 3):
            near |= np.roll(dark, (down, along), axis=(0, 1))
    assert ((found < 128) & ~near).mean() < 1e-4
    assert abs((found < 128).sum() / dark.sum() - 1.0) < 0.05


@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_vectors_have_the_labels(form: str) -> None:
    content = BytesIO()
    save(draw_panels(panels(), "Title", "run"), content, form)
    text = content.getvalue()
    assert len(text) > 10_000
    if form == "svg":
        labels = set(re.findall(r"<!-- (.*?) -->", text.decode()))
        assert {"0.5", "1.0", "time / s", "usual / m", "1e−7"} <= labels
