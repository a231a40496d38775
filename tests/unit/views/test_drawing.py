"""Panels as pictures: time axes, limits near curves, constant signals, the worst of many joints."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.pages.panels import Limit, Line, Plot
from emla_cosim.study.criteria import TOO_SHORT
from emla_cosim.study.figures import JOINT_FIGURES, JointMap
from emla_cosim.views.formatting import format_headline
from emla_cosim.views.plots.panel_drawing import draw_panels, has_changes
from emla_cosim.views.plots.pictures import Curve, PanelSpec, Picture, RangeLimit

TIME = np.linspace(0.0, 10.0, 2001)
MOVE = np.minimum(TIME, 1.0)
"""At rest after 1 s."""


def panel(values: np.ndarray, label: str = "x / m", column: str = "lift", **more: Any) -> Plot:
    return Plot(label, (Line("x", TIME, values),), column=column, **more)


@dataclass
class KnownResult:
    """As much of a result as a picture looks at."""

    metrics: dict[str, Any]
    data: dict[str, np.ndarray]
    parameters: dict[str, float] = field(default_factory=dict)
    roles: dict[str, str] = field(default_factory=dict)
    record: dict[str, Any] = field(default_factory=dict)
    name: str = "study"

    @property
    def names(self) -> list[str]:
        return list(self.data)


def resolved(curve: Curve, bound: RangeLimit | None = None, **parameters: float) -> Plot:
    power = {"j.F": 2.0 + TIME, "j.v": np.cos(TIME), "j.other": TIME**2}
    result = KnownResult({"joints": {"j": {}}}, power, {f"j.{name}": x for name, x in parameters.items()})
    picture = Picture("p", (PanelSpec("l", (curve,), bound=bound),), "joints")
    (actual,) = picture.resolve_panels(result, {"time": TIME, **power})  # pyright: ignore[reportArgumentType]
    return actual


@pytest.mark.parametrize(
    ("curve", "expected"),
    [
        (Curve("", "F", less="other", scale=3.0), 3.0 * (2.0 + TIME - TIME**2)),
        (Curve("", "F", times="v"), (2.0 + TIME) * np.cos(TIME)),
        (Curve("", "F", integrated=True), 2.0 * TIME + TIME**2 / 2.0),
        (
            Curve("", "F", times="v", less="other", integrated=True),
            (2.0 + TIME) * np.sin(TIME) + np.cos(TIME) - 1.0 - TIME**3 / 3.0,
        ),
    ],
)
def test_curves_are_differences_products_and_integrals(curve: Curve, expected: np.ndarray) -> None:
    assert resolved(curve).lines[0].values == pytest.approx(expected, abs=2e-4)


def test_limits_are_products_of_parameters() -> None:
    for bound, limits in (
        (RangeLimit("torque", ("N", "Phi"), scale=1.5), (Limit("torque", -3.0, 3.0),)),
        (RangeLimit("stroke", ("N",), ("low",)), (Limit("stroke", -1.0, 4.0),)),
        (RangeLimit("unknown", ("gone",)), ()),
    ):
        assert resolved(Curve("", "F"), bound, N=4.0, Phi=0.5, low=-1.0).limits == limits


def test_time_is_linear_and_shared_by_rows_of_one_part() -> None:
    begin = Plot("x", (Line("", TIME[:100], MOVE[:100]),), column="lift", part="settling")
    rows = [begin, panel(MOVE, part="settled"), panel(MOVE, part="settled")]
    figure = draw_panels(rows, "Tracking", "study")
    first, second, third = figure.axes
    assert [axes.get_xscale() for axes in figure.axes] == ["linear"] * 3
    assert [axes.get_xlabel() for axes in figure.axes] == ["time / s", "", "time / s"]
    assert second.get_xlim() == third.get_xlim() != first.get_xlim()
    assert first.get_xlim()[1] < 1.0 < 9.0 < third.get_xlim()[1]
    tops = [axes.get_position().y1 for axes in figure.axes]
    assert tops == sorted(tops, reverse=True)


def test_a_legend_hides_no_curve() -> None:
    message = Plot("x", (Line("one", TIME, MOVE), Line("two", TIME, -MOVE, dashed=True)), column="a")
    figure = draw_panels([message, Plot("x", (Line("one", TIME, MOVE),), column="b")], "t", "r")
    legends = [axes.get_legend() for axes in figure.axes]
    assert legends[0] is None
    assert [text.get_text() for text in legends[1].get_texts()] == ["one", "two"]
    figure.draw_without_rendering()
    assert legends[1].get_window_extent().x0 >= figure.axes[1].get_window_extent().x1
    assert legends[1].get_window_extent().x1 <= figure.bbox.x1


@pytest.mark.parametrize(("high", "shaded"), [(1.1, 1), (0.9, 1), (5.0, 0)])
def test_limit_near_a_curve_is_shaded(high: float, shaded: int) -> None:
    drawn_panel = panel(MOVE, limits=(Limit("largest", None, high),))
    (axes,) = draw_panels([drawn_panel], "t", "r").axes
    assert len(axes.patches) == shaded
    assert axes.get_ylim()[1] < 1.3  # a limit far away must not flatten the curve
    legend = axes.get_legend()
    labels = [] if legend is None else [text.get_text() for text in legend.get_texts()]
    assert labels == ["beyond the largest"] * shaded


@pytest.mark.parametrize("columns", [1, 3, 8])
def test_long_labels_fit_in_the_figure(columns: int) -> None:
    """A legend widens the figure; long labels of axes and areas have several lines."""
    long = "current limit of the controller of the drive"
    lines = Line("commanded by the controller", TIME, MOVE), Line("actual", TIME, -MOVE)
    label, limits = "acceleration of the piston / (m/s²), settled", (Limit(long, None, 1.0),)
    panels = [Plot(label, lines, column=f"c{i}", limits=limits) for i in range(columns)]
    figure = draw_panels(panels * 2, "t", "r")
    figure.draw_without_rendering()
    widths = {round(axes.get_window_extent().width) for axes in figure.axes}
    assert len(widths) == 1 and widths.pop() > 400
    for axes in figure.axes[::columns]:
        assert axes.yaxis.label.get_window_extent().x0 >= 0
        assert axes.yaxis.label.get_window_extent().height < 1.3 * axes.get_window_extent().height
    for axes in figure.axes[columns - 1 :: columns]:
        legend = axes.get_legend()
        assert legend is not None
        assert legend.get_window_extent().x0 >= axes.get_window_extent().x1
        assert legend.get_window_extent().x1 <= figure.bbox.x1


def test_panel_without_a_signal_says_so() -> None:
    panels = [panel(MOVE), Plot("x / m", (), column="tilt")]
    figure = draw_panels(panels, "t", "r")
    assert [text.get_text() for text in figure.axes[1].texts] == ["no such signal"]
    assert not figure.axes[0].texts


def test_data_of_an_input_are_drawn() -> None:
    """Data replace the load, whether they drive the output of a component or the input of the plant."""
    constant, measured = np.full(2001, 5e4), 5e4 + 1e3 * MOVE
    for signal in ("j.disturbance.F_L", "j.plant.F_L"):
        data = {"j.plant.tau_m": MOVE, "j.disturbance.F_L": constant, f"input.{signal}": measured}
        result: Any = KnownResult({"joints": {"j": {}}}, data)
        torque = JOINT_FIGURES["torque"]
        read = {name: data[name] for name in torque.signals(result)}
        _, load = torque.resolve_panels(result, {"time": TIME, **read})
        np.testing.assert_allclose(load.lines[0].values, measured / 1e3)


@pytest.mark.parametrize(("criteria", "window"), [({}, 1000.0), ({"*.position_window": "2 mm"}, 2000.0)])
def test_errors_show_the_load_beside_the_screw(criteria: dict[str, Any], window: float) -> None:
    data = {"j.plant.x_L": MOVE, "j.reference.x_d": MOVE, "j.plant.load.x": MOVE + 2e-4}
    record = {"settings": {"criteria": criteria}}
    result: Any = KnownResult({"joints": {"j": {}}}, data, record=record)
    panels = JOINT_FIGURES["errors"].resolve_panels(result, {"time": TIME, **data})
    errors = {panel.label: panel for panel in panels}
    load = errors["load position / µm, settled"]
    np.testing.assert_allclose(load.lines[0].values, 200.0, rtol=1e-9)
    for settled in (load, errors["position / µm, settled"]):
        assert settled.limits == (Limit("position window", -window, window),)
    rigid: Any = KnownResult({"joints": {"j": {}}}, {name: data[name] for name in list(data)[:2]})
    panels = JOINT_FIGURES["errors"].resolve_panels(rigid, {"time": TIME, **rigid.data})
    assert [panel.label for panel in panels] == ["position / mm, settling", "position / µm, settled"]


def test_constant_signals_take_no_row() -> None:
    moving = [panel(MOVE, column=c) for c in ("a", "b")]
    constant = [panel(np.full(2001, 57.0), "load force / kN", c) for c in ("a", "b")]
    figure = draw_panels([*moving, *constant], "t", "r")
    assert [axes.get_title() for axes in figure.axes] == ["a   load force 57 kN", "b   load force 57 kN"]
    assert not has_changes(constant[:1])


@pytest.mark.parametrize(
    "values", [np.full(2001, np.nan), np.full(2001, np.inf), 1e308 * MOVE, np.where(TIME > 1.0, np.nan, TIME)]
)
def test_non_finite_values_still_give_a_figure(values: np.ndarray) -> None:
    panels = [panel(values, limits=(Limit("largest", -1.0, 1.0),))]
    assert draw_panels(panels, "t", "r").axes


def test_headline_has_names_of_files_without_folders(tmp_path: Path) -> None:
    data = [{"file": str(tmp_path / name), "signals": {}} for name in ("load.csv", "way.csv")]
    changed = {"set": {"a.b": "30 kN"}, "actuator": {"lift": str(tmp_path / "sheet.toml")}, "input": data}
    result: Any = KnownResult({}, {}, record={"changed": changed})
    message = "Run of study with a.b 30 kN, actuator lift sheet.toml, input load.csv and way.csv"
    assert format_headline(result) == message


@pytest.mark.parametrize(
    ("figures", "begin"),
    [
        ({"evaluated_from_s": 1.2}, 1.2),
        ({"evaluated_from_s": np.nan}, 0.3),
        ({}, 0.3),
        ({"evaluated_from_s": TIME[-1]}, TIME[0]),  # one point does not make a curve
    ],
)
def test_settled_panels_begin_where_errors_count(figures: dict[str, Any], begin: float) -> None:
    power = {"j.F": 2.0 + TIME, "k.F": TIME}
    result: Any = KnownResult({"joints": {"j": figures, "k": {"evaluated_from_s": 0.7}}}, power)
    panels = (PanelSpec("all", (Curve("", "F"),)), PanelSpec("settled", (Curve("", "F"),), "settled"))
    actual = Picture("p", panels, "joints").resolve_panels(result, {"time": TIME, **power})
    starts = {(panel.label, panel.column): panel.lines[0].time[0] for panel in actual}
    assert starts["all", "j"] == starts["all", "k"] == TIME[0]
    assert starts["settled", "j"] == TIME[TIME >= begin][0]
    assert starts["settled", "k"] == TIME[TIME >= 0.7][0]


def many(count: int) -> KnownResult:
    """As many joints, of which the errors grow; the second is not held, and the third has no error."""
    metrics = {
        f"j{i}": {
            "held": i != 1,
            "reason": None if i != 1 else "j1 has not settled.",
            "position_error_m": np.nan if i == 2 else 1e-6 * (i + 1),
            "settling_time_s": 0.01 * (i + 1),
            "torque_peak_N_m": 5.0 + i,
        }
        for i in range(count)
    }
    return KnownResult({"joints": metrics}, {f"j{i}.F": np.sin(TIME + i) for i in range(count)})


WORST = Picture("Forces", (PanelSpec("F / N", (Curve("", "F"),)),), "joints", worst="position_error_m")


@pytest.mark.parametrize(
    ("count", "joints", "title"),
    [
        (8, [f"j{i}" for i in range(8)], "Forces"),
        (60, ["j1", "j2", *(f"j{i}" for i in range(59, 53, -1))], "Forces: the 8 worst of 60 joints"),
    ],
)
def test_worst_of_many_joints_are_drawn(count: int, joints: list[str], title: str) -> None:
    """Those that are not held, then those without an error, then those with the largest one."""
    result: Any = many(count)
    assert list(WORST.signals(result)) == [f"{joint}.F" for joint in joints]
    panels = WORST.resolve_panels(result, {"time": TIME, **result.data})
    assert [panel.column for panel in panels] == joints
    figure = WORST.drawn(result, {"time": TIME, **result.data})
    assert figure is not None and figure.get_suptitle() == title
    assert [axes.get_title() for axes in figure.axes] == joints


def draw_map(result: Any) -> Any:
    return JointMap().drawn(result, {"time": TIME})


def test_map_of_a_short_run_has_no_verdict() -> None:
    result: Any = many(60)
    for figures in result.metrics["joints"].values():
        figures |= {"held": False, "reason": f"{TOO_SHORT}."}
    figure = draw_map(result)
    assert figure.get_suptitle() == "All 60 joints: the run is too short to judge them"
    assert all(len(axes.lines[1].get_xdata()) == 0 for axes in figure.axes)


def test_map_shows_all_joints() -> None:
    result: Any = many(60)
    assert draw_map(many(8)) is None
    figure = draw_map(result)
    assert figure.get_suptitle() == "All 60 joints: 1 not held, in red"
    scales = {"position_error_m": 1e6, "settling_time_s": 1e3, "torque_peak_N_m": 1.0}
    for axes, (name, scale) in zip(figure.axes, scales.items(), strict=True):
        held_line, other_line = axes.lines
        values = np.array([metrics[name] for metrics in result.metrics["joints"].values()]) * scale
        assert list(other_line.get_xdata()) == [1] and other_line.get_ydata()[0] == pytest.approx(values[1])
        np.testing.assert_allclose(held_line.get_ydata(), np.delete(values, 1))
    assert [label.get_text() for label in figure.axes[-1].get_xticklabels()] == list(result.metrics["joints"])
