"""Pictures of sweeps show what NumPy computes, and can be drawn for unusual sweeps."""

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.analyses.sweep import charts as bands_module
from emla_cosim.analyses.sweep.charts import PERCENTILES, compute_bands
from emla_cosim.analyses.sweep.columns import label_with_unit, shorten_text, wrap_text
from emla_cosim.analyses.sweep.report import draw_pictures
from emla_cosim.analyses.sweep.result import SweepResult
from emla_cosim.base.errors import CommandError
from emla_cosim.recorders.metrics import MetricDisplay
from tests.support.sweep_results import series, swept
from tests.support.tiers import mostly_slow

pytestmark = pytest.mark.filterwarnings("error")

NASTY = "a$b_{c}<d>[e]&\\frac{1}{2}." * 3 + "x" * 10
JOINTS = ("lift", "tilt", "telescope")
NAMES = ("plant.motor.R_s", "plant.screw.friction.viscous", "controller.gains.k_1", "disturbance.F_L")
GRID = {"a": np.repeat(np.geomspace(0.01, 10, 5), 4), "b": np.tile(["w", "x", "y", "z"], 5)}


def wide(sampling: str = "random", count: int = 100) -> SweepResult:
    """3 joints with 5 figures each, 12 factors with long names; some diverged, some did not converge."""
    rng = np.random.default_rng(0)
    factors = {f"{j}.{name}": rng.random(count) for j in JOINTS for name in NAMES}
    x = np.array(list(factors.values()))
    status = np.where(x[0] > 0.95, "diverged", "done").tolist()
    figures, displays = {}, {}
    for i, j in enumerate(JOINTS):
        figures[f"{j}.held"] = x[1 + i] < 0.9
        displays[f"{j}.held"] = MetricDisplay("held", "held")
        for k in range(4):
            figures[f"{j}.observer_error_{k}_m_s"] = 1e-6 * 10 ** (3 * x[k + i] + x[k])
            displays[f"{j}.observer_error_{k}_m_s"] = MetricDisplay(
                f"observer_error_{k}_m_s", f"observer speed error {k}", 1e3, "mm/s"
            )
    signals = [f"{j}.plant.{s}" for j in JOINTS for s in ("x_L", "v_L", "i_q")]
    times = [np.linspace(0, 1, 30)[: 30 if s == "done" else 9] for s in status]
    return swept(
        factors,
        figures,
        sampling,
        status,
        signals=signals,
        series=series({s: lambda i, t: np.sin(6 * t) + x[0, i] for s in signals}, times),
        units=dict.fromkeys([*factors, *signals], "N.m.s/rad"),
        displays=displays,
    )


def texts(figure: Any) -> list[Any]:
    """Everything that is written in a figure and to be seen."""
    from matplotlib.text import Text

    visible = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip()]
    hidden = [axes for axes in figure.axes if not axes.get_visible()]
    in_panels = [t for t in visible if t.axes not in hidden]
    ticks = {id(label) for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) for label in outside(axis)}
    return [t for t in in_panels if id(t) not in ticks]


def outside(axis: Any) -> list[Any]:
    """Labels of ticks beyond the limits of an axis, which are invisible."""
    low, high = sorted(axis.get_view_interval())
    margin = 1e-9 * (high - low)
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    off = [t for t in ticks if not low - margin <= t.get_loc() <= high + margin]
    return [label for t in off for label in (t.label1, t.label2)]


def overlapping(figure: Any) -> list[tuple[str, str]]:
    """Pairs of texts of which one lies over the other."""
    figure.draw_without_rendering()
    boxes = [(t.get_text(), t.get_window_extent().padded(-1)) for t in texts(figure)]
    return [(a, b) for (a, box), (b, second_box) in combinations(boxes, 2) if box.overlaps(second_box)]


KINDS = ["bands", "figures", "sobol", "tornado", "map"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", mostly_slow(KINDS, ["tornado", "map"]))
def test_labels_do_not_overlap_and_no_panel_is_empty(kind: str) -> None:
    samplings = {"sobol": ("saltelli", 14 * 20), "tornado": ("one-at-a-time", 25)}
    sampling, count = samplings.get(kind, ("random", 100))
    names = ["tilt.held", "lift.observer_error_1_m_s"] if kind == "figures" else []
    figure = wide(sampling, count).plot(kind, *names)
    assert overlapping(figure) == []
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert len(panels) == {"bands": 9, "figures": 12, "sobol": 12, "tornado": 12, "map": 2}[kind]
    assert all(axes.has_data() for axes in panels)
    width, height = figure.canvas.get_width_height()
    for text in texts(figure):
        box = text.get_window_extent()
        assert box.x0 >= -1 and box.y0 >= -1 and box.x1 <= width + 1 and box.y1 <= height + 1, text


def test_bands_are_percentiles_of_running_variants() -> None:
    t = np.linspace(0, 2, 11)
    values = np.random.default_rng(1).normal(size=(40, 11))
    lengths = [11 if i % 3 else 4 for i in range(40)]
    signals = series({"s": lambda i, times: values[i, : len(times)]}, [t[:n] for n in lengths])
    bands = compute_bands(swept({"a": range(40)}, {}, signals=["s"], series=signals), "s")
    assert np.array_equal(bands.times, t)
    running = [[values[i, k] for i in range(40) if k < lengths[i]] for k in range(11)]
    expected = np.transpose([np.percentile(column, PERCENTILES) for column in running])
    assert np.allclose(bands.values, expected, rtol=1e-12)


def test_bands_of_variants_with_other_times_are_interpolated() -> None:
    times = [np.linspace(0, 1, 5 + 2 * i) for i in range(7)]
    signals = series({"s": lambda i, t: i * t}, times)
    bands = compute_bands(swept({"a": range(7)}, {}, signals=["s"], series=signals), "s")
    assert np.array_equal(bands.times, times[-1])
    assert np.allclose(bands.values, np.outer(np.percentile(range(7), PERCENTILES), times[-1]))


def test_bands_of_many_rows_are_the_same_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.linspace(0, 1, 1001)
    signals = series({"s": lambda i, times: np.sin(times + i)}, [t] * 50)
    result = swept({"a": range(50)}, {}, signals=["s"], series=signals.reverse())  # parts come in any order
    bands = compute_bands(result, "s")
    monkeypatch.setattr(bands_module, "_MAX_ROWS", 3500)
    parts = compute_bands(result, "s")
    assert len(bands.times) == 400
    assert bands.times[[0, -1]].tolist() == [0.0, 1.0]
    assert np.array_equal(bands.values, parts.values)
    assert np.allclose(bands.values[2], np.median([np.sin(bands.times + i) for i in range(50)], axis=0))


def test_bands_ignore_invalid_numbers() -> None:
    signals = series({"s": lambda i, t: [1.0, np.nan, np.inf, 1e200][i] + 0 * t}, [np.arange(3.0)] * 4)
    bands = compute_bands(swept({"a": range(4)}, {}, signals=["s"], series=signals), "s")
    assert np.array_equal(bands.values, np.ones((5, 3)))


def test_map_of_a_grid_has_a_cell_for_each_variant() -> None:
    error = np.arange(20.0) + 1
    is_held = np.arange(20) % 7 != 3
    status = ["done"] * 18 + ["diverged"] * 2
    figures = {"x.held": is_held, "x.error": error}
    displays = {"x.error": MetricDisplay("error", "error", 2.0)}
    figure: Any = swept(GRID, figures, "grid", status, displays=displays).plot("map")
    shades = figure.axes[0].collections[-1].get_array()
    expected = np.where(is_held & (np.arange(20) < 18), 2 * error, np.nan).reshape(5, 4).T
    assert np.array_equal(shades.filled(np.nan), expected, equal_nan=True)
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == ["held (15)", "not held (3)", "diverged (2)"]
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == ["w", "x", "y", "z"]
    assert figure.axes[1].get_ylabel() == "x error"


def test_map_of_other_sweeps_has_the_decisive_factors() -> None:
    rng = np.random.default_rng(3)
    factors = {name: rng.random(200) for name in "abcd"}
    status = np.where(factors["b"] + factors["d"] > 1.2, "diverged", "done").tolist()
    axes = swept(factors, {"f": rng.random(200)}, status=status).plot("map").axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("b", "d")


def test_figures_are_plotted_over_the_strongest_factors() -> None:
    rng = np.random.default_rng(3)
    factors: dict[str, Any] = {f"p{i}": rng.random(400) for i in range(8)}
    factors["same"] = [1.0] * 400
    factors["wide"] = np.geomspace(1, 1e3, 400)
    f = sum((i + 1) * factors[f"p{i}"] for i in range(8))
    figure: Any = swept(factors, {"same_figure": [2.0] * 400, "f": f}, seed=1).plot("figures")
    assert [axes.get_xlabel() for axes in figure.axes] == ["p7", "p6", "p5", "p4", "p3", "p2"]
    assert figure.axes[0].get_ylabel() == "f"
    x, y = figure.axes[0].lines[0].get_data()
    assert np.array_equal(x, factors["p7"])
    assert np.array_equal(y, f)
    note = figure.legends[0].get_title().get_text().replace("\n", " ")
    assert "Omitted for smaller rank correlations: p1, wide and p0." in note
    assert "Factors with one value only: 1." in note
    figure = swept({"wide": factors["wide"]}, {"f": f}).plot("figures")
    assert (figure.axes[0].get_xscale(), figure.axes[0].get_yscale()) == ("log", "linear")


def test_tornado_has_bars_from_the_nominal_value() -> None:
    values = [10.0, 9.0, 14.0, 10.5, None]
    figure: Any = swept({"a": range(5), "b": range(5)}, {"f": values}, "one-at-a-time").plot("tornado")
    bars = [(p.get_x(), p.get_x() + p.get_width()) for p in figure.axes[0].patches]
    assert bars == [(10.0, 9.0), (10.0, 14.0), (10.0, 10.5)]
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["a", "b"]


def nasty() -> dict[str, tuple[SweepResult, list[str]]]:
    """Sweeps, and the pictures that they give."""
    n = 24
    names = swept(
        {NASTY + "1": range(n), NASTY + "2": ["$x_1$", "[b]", "c" * 50] * 8, "__a": [[1, 2], [3]] * 12},
        {
            NASTY + "f": np.geomspace(1e-6, 1e6, n),
            "_$g$": [True, False] * 12,
            "[red]": [1e308, *range(n - 1)],
        },
        status=["done"] * 20 + ["odd $_$"] * 4,
        signals=[NASTY, "_$t"],
        series=series(
            {NASTY: lambda i, t: i * t, "_$t": lambda i, t: 10 ** (300 * t)}, [np.linspace(0, 1, 9)] * n
        ),
        units={NASTY + "1": "m$_$"},
        name=NASTY,
    )
    flat = {"signals": ["s"], "series": series({"s": lambda i, t: 0 * t}, [np.arange(3.0)] * 20)}
    no_values = {"signals": ["s"], "series": series({"s": lambda i, t: np.nan * t}, [np.arange(3.0)] * 20)}
    two = {"a": range(20), "b": np.sin(range(20))}
    failed, none = ["diverged"] * 9 + ["died"] * 11, {"f": [None] * 20}
    return {
        "names": (names, ["bands", "figures", "map"]),
        "one variant": (swept({"a": [1.0]}, {"f": [2.0]}), []),
        "one factor": (swept({"a": range(9)}, {"f": np.arange(9.0) ** 2}), ["figures"]),
        "one cell": (swept({"a": [1.0], "b": ["x"]}, {"f": [2.0]}, "grid"), []),
        "all failed": (swept(two, none, status=failed, **flat), ["bands", "map"]),
        "all failed in a grid": (swept(GRID, none, "grid", failed), ["map"]),
        "all NaN": (swept(two, {"f": [np.nan] * 20}, **no_values), []),
        "constant": (swept(two, {"f": [1.0] * 20}, **flat), ["bands"]),
        "constant, saltelli": (swept(two, {"f": [1.0] * 20}, "saltelli"), []),
        "constant, one at a time": (swept(two, {"f": [1.0] * 20}, "one-at-a-time"), []),
        "nominal failed": (swept({"a": range(3)}, {"f": [None, 1.0, 2.0]}, "one-at-a-time"), []),
        "cut short": (swept(two, {"f": [1.0, 2.0, 3.0, None] * 5}, "saltelli"), ["figures", "map"]),
        "no figures": (swept(two, {}), []),
        "no variants": (swept({"a": []}, {"f": []}), []),
    }


@pytest.mark.parametrize("case", nasty())
def test_unusual_sweeps_can_be_drawn(case: str, tmp_path: Path) -> None:
    result, expected = nasty()[case]
    pictures = dict(draw_pictures(result))
    assert list(pictures) == [f"{name}.png" for name in expected]
    for name, figure in pictures.items():
        path = tmp_path / name
        figure.savefig(path)
        assert path.read_bytes().endswith(b"IEND\xaeB`\x82")


def test_names_are_not_parsed_as_formulas() -> None:
    result = nasty()["names"][0]
    for kind in ("bands", "figures", "map"):
        figure = result.plot(kind)
        figure.draw_without_rendering()
        with_symbols = [t for t in texts(figure) if set(t.get_text()) & set("ax$<[")]
        assert with_symbols
        assert not any(t.get_parse_math() for t in with_symbols if "mathdefault" not in t.get_text())


def test_impossible_pictures_give_one_message() -> None:
    result = swept({"a": range(9)}, {"error": range(9)}, name="mine")
    for kind, names, sentence in (
        ("bands", (), "the sweep 'mine' stored no signals over time"),
        ("figures", ("eror",), r"no figure 'eror'; did you mean error\?"),
        ("tornado", (), "has the sampling random; local sensitivities need the sampling one-at-a-time"),
        ("sobol", (), "has the sampling random; Sobol indices need the sampling saltelli"),
        ("map", (), "a map needs two factors that vary; the sweep 'mine' has 1"),
        ("map", ("error", "error"), "a map shows one figure, not 2"),
        ("maps", (), "there is no picture 'maps'; choose from bands, figures, tornado, sobol and map"),
    ):
        with pytest.raises(CommandError, match=sentence):
            result.plot(kind, *names)
    one_variant = swept({"a": [1]}, {}, signals=["s"], series=series({"s": lambda i, t: t}, [np.arange(2.0)]))
    with pytest.raises(CommandError, match="there is no stored signal 'x'; choose from s"):
        one_variant.plot("bands", "x")


def test_long_texts_are_shortened_and_wrapped() -> None:
    assert shorten_text("lift.plant.motor.R_s", 20) == "lift.plant.motor.R_s"
    assert shorten_text("lift.plant.motor.R_s", 19) == "lift.plan…motor.R_s"
    assert shorten_text("a\nb\tc", 9) == "a b c"
    assert wrap_text("lift.plant.motor.R_s / Ohm", 20) == "lift.plant.motor.\nR_s / Ohm"
    assert wrap_text("torque / (N m)", 9) == "torque /\n(N m)"
    assert max(map(len, wrap_text("x" * 500, 30).split("\n"))) == 30
    assert [label_with_unit("v", unit) for unit in ("", "m", "m/s")] == ["v", "v / m", "v / (m/s)"]
