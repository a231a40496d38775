"""The picture and the animation of a machine show the run, from results made by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.run.result import Result
from emla_cosim.study.figures import MACHINE_FIGURES
from emla_cosim.study.sketch.machine_picture import INSTANTS, MachineAnimation, MachineFilm, select_instants
from emla_cosim.study.sketch.movement import Movement, list_recorded_signals, read_movement
from emla_cosim.views.plots.pictures import draw_figures
from emla_cosim.views.plots.stacked import BY_UNIT
from emla_cosim.views.plots.style import save
from tests.support.hdrm_runs import replayed, result_of
from tests.support.manipulator_geometry import HDRM, points
from tests.support.tiers import mostly_slow

assert ec.load, "registers what is drawn"


def read_run_movement(result: Result) -> Movement:
    actual = read_movement(result, result.read(["time", *list_recorded_signals(result)]))
    assert actual is not None
    return actual


def drawn(result: Result, folder: Path | None = None) -> set[str]:
    """The pictures of a machine among those that were drawn, which are saved if there is a folder."""
    pictures = {name: figure for name, figure in draw_figures(result) if figure and name not in BY_UNIT}
    for name, figure in pictures.items() if folder is not None else ():
        with (folder / f"{name}.png").open("wb") as stream:
            save(figure, stream)
    return set(pictures)


def film(result: Result) -> MachineFilm:
    actual = MachineAnimation().film(result)
    assert isinstance(actual, MachineFilm)
    return actual


@pytest.mark.parametrize("merged", [False, True])
def test_manipulator_is_drawn(merged: bool, tmp_path: Path) -> None:
    assert drawn(replayed(merged=merged), tmp_path) == {"manipulator"}
    with Image.open(tmp_path / "manipulator.png") as picture:
        assert picture.format == "PNG"
        assert len(picture.convert("RGB").getcolors(10**6) or ()) > 500


FORCES = ("machine.manipulator.F_L[2]", "machine.trajectory.v_d[2]")
MOTION = ("tilt.plant.x_L", "machine.trajectory.a_d[2]")


@pytest.mark.parametrize(("name", "signals"), [("forces", FORCES), ("motion", MOTION)])
def test_joints_are_drawn_as_in_the_paper(name: str, signals: tuple[str, str]) -> None:
    run = replace(replayed(), metrics={"joints": {"tilt": {}}})
    picture = MACHINE_FIGURES[name]
    assert set(signals) <= set(picture.signals(run))
    figure = picture.drawn(run, run.read(["time", *picture.signals(run)]))
    assert figure is not None
    lines = [line for axes in figure.axes for line in axes.lines]
    for signal, scales in zip(signals, ((1e-3, 1.0), (1.0, 1e3)), strict=True):
        late = run[signal][run.time >= 0.3]
        drawn = [np.asarray(line.get_ydata())[-len(late) :] for line in lines]
        assert any(np.allclose(y, scale * late) for y in drawn for scale in scales)


MISSING = [
    ("machine.trajectory", {"manipulator"}),
    ("machine.manipulator.F_L", {"manipulator"}),
    ("lift.plant", {"manipulator"}),
    ("lift.plant machine.m", {"manipulator"}),
    ("machine.trajectory tilt.plant", set()),  # no strokes of tilt
]


@pytest.mark.parametrize(("missing", "pictures"), mostly_slow(MISSING, MISSING[-2:]))
def test_missing_signals_leave_out_their_part(missing: str, pictures: set[str]) -> None:
    assert drawn(replayed(leave_out=tuple(missing.split()))) == pictures


def test_joints_without_a_machine_have_no_machine_pictures() -> None:
    run = replayed()
    columns = {f"lift.{n}.{x}": run["lift.plant.x_L"] for n, x in (("plant", "x_L"), ("reference", "x_d"))}
    single_joint = replace(result_of(run.time, columns, {}, {}), metrics={"joints": {"lift": {}}})
    assert all(not list(picture.signals(single_joint)) for picture in MACHINE_FIGURES.values())
    assert "manipulator" not in drawn(single_joint)


def test_unknown_geometry_is_not_drawn() -> None:
    run = replayed()
    for wrong in ({}, {n: x for n, x in run.parameters.items() if not n.endswith("lift.a")}):
        assert drawn(replace(run, parameters=wrong)) == set()
    with pytest.raises(RunError, match="nothing to animate"):
        film(replace(run, parameters={}))


def test_geometry_is_that_of_the_run() -> None:
    longer = replace(HDRM, reach=2.0, q_UB=(0.5, 0.6, 0.9))
    actual = read_run_movement(replayed(longer))
    assert actual.machine.q_UB == longer.q_UB
    assert complex(*actual.path[7]) == pytest.approx(points(longer, actual.strokes[7])["tip"])


def test_strokes_errors_and_forces_are_those_recorded() -> None:
    run = replayed()
    actual = read_run_movement(run)
    assert np.array_equal(actual.strokes[:, 1], run["tilt.plant.x_L"])
    assert actual.errors is not None and actual.forces is not None
    assert np.array_equal(actual.errors[:, 2], run["telescope.plant.x_L"] - run["machine.trajectory.x_d[3]"])
    assert np.array_equal(actual.forces[:, 0], run["machine.manipulator.F_L[1]"])


def test_payload_is_constant_or_from_its_connection() -> None:
    run = replayed(payload=300.0)
    assert set(read_run_movement(run).payload) == {300.0}
    fault, half = "machine.manipulator_payload_m_fault.y", np.linspace(470.0, 235.0, len(run.time))
    columns = {name: run[name] for name in run.names} | {fault: half}
    dropped = result_of(run.time, columns, run.parameters, {"machine.manipulator": {}})
    assert set(read_run_movement(dropped).payload) == {470.0}
    record = {**dropped.record, "connections": [f"{fault} -> machine.manipulator.payload.m x 1"]}
    assert np.array_equal(read_run_movement(replace(dropped, record=record)).payload, half)


@pytest.mark.parametrize("wrong", [5.0, np.nan])
def test_run_is_drawn_until_its_triangles_open(wrong: float) -> None:
    strokes = np.array(replayed()["lift.plant.x_L"])
    strokes[50:] = wrong
    run = replayed(lift=strokes)
    assert len(read_run_movement(run).time) == len(read_run_movement(run).path) == 50
    assert len(film(run)) == 30


@pytest.mark.filterwarnings("error")
def test_machine_at_rest_is_drawn(tmp_path: Path) -> None:
    still = replayed(lift=0.2, tilt=0.3, telescope=0.4, leave_out=("machine.trajectory",))
    assert np.ptp(read_run_movement(still).path) == np.ptp(read_run_movement(still).path[0])
    assert drawn(still, tmp_path) == {"manipulator"}


def test_instants_are_along_the_path() -> None:
    actual = read_run_movement(replayed())
    rows = select_instants(actual)
    assert len(rows) == INSTANTS
    assert (rows[0], rows[-1]) == (0, len(actual.time) - 1)
    steps = np.hypot(*np.diff(actual.path[rows], axis=0).T)
    assert steps == pytest.approx(steps.mean(), rel=0.1)


def test_frames_show_the_run_at_equal_distances_in_time() -> None:
    actual = film(replayed(duration=8.0, rows=801))
    assert len(actual) == 100
    first, last = actual[0], actual[99]
    assert first.shape == last.shape == (500, 800, 3)
    assert tuple(first[0, 0]) == tuple(last[0, 0]) == (255, 255, 255)
    assert (first != last).any(axis=2).mean() > 0.01
    assert np.array_equal(actual[0], first)  # whatever was drawn in between
    assert len(film(replayed(duration=1000.0))) == 150


def test_frame_shows_the_machine_at_its_time() -> None:
    run = replayed(duration=8.0, rows=801)
    actual = film(run)
    for index in (0, 37):
        actual[index]
        row = round(index / 99 * 800)
        q = [run[f"{joint}.plant.x_L"][row] for joint in ("lift", "tilt", "telescope")]
        drawn = dict(zip(actual.polygons.names, actual.polygons.lines, strict=True))
        payload, *pins = (drawn[n].mean(axis=0) for n in ("payload", "lift first pin", "lift second pin"))
        assert complex(*payload) == pytest.approx(points(HDRM, q)["tip"], abs=1e-4)
        assert np.hypot(*(pins[1] - pins[0])) == pytest.approx(HDRM.lift_L_0 + q[0], abs=1e-4)


def test_missing_manipulator_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="'hdrm-replay' cannot be animated: an animation needs a"):
        replayed(leave_out=("tilt.plant",)).save(tmp_path / "out", animate=True)
    assert not (tmp_path / "out").exists()
