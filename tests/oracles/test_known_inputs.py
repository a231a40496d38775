"""Data over time are known in advance: against closed forms and SciPy, with every algorithm."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import emla_cosim as ec
import fmublock
from emla_cosim.fmu import tables
from fmublock import Block, DiscreteState, Input, Output, State
from fmublock import table as table_fmus
from tests.support.faulty_systems import faulty, wired
from tests.support.hand_written_fmus import build_all_types_3_fmu, build_faulty_fmu, edit_description

ALGORITHMS = ("jacobi", "gauss-seidel", "strong")
ALL_PAIRS = [
    (algorithm, extrapolation) for algorithm in ALGORITHMS for extrapolation in ("none", "master", "fmu")
]


class Integrator(Block):
    """The integral of its input, which is also an output."""

    u = Input(unit="m/s", description="Rate")
    x = State(0.0, unit="m", description="Integral")
    y = Output(unit="m/s", description="Rate")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.u}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": v.u}


class Loop(Block):
    """A mass that a stiff spring pulls to a command; the force depends on the command directly."""

    u = Input(unit="m", description="Command")
    x = State(0.0, unit="m", description="Position")
    w = State(0.0, unit="m/s", description="Speed")
    F = Output(unit="N", description="Force")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.w, "w": 400.0 * (v.u - v.x) - 8.0 * v.w}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"F": 400.0 * (v.u - v.x)}


class Sampler(Block):
    """It keeps what it has read at its sampling instant."""

    u = Input(unit="m", description="Command")
    last = DiscreteState(0.0, unit="m", description="Last command")
    y = Output(unit="m", description="Last command")

    def update(self, v: Any) -> dict[str, Any]:
        return {"last": v.u}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": v.last}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("known")
    for block in (Integrator, Loop, Sampler):
        fmublock.build(block, folder / f"{block.__name__}.fmu")
    fmublock.build(Loop, folder / "Loop3.fmu", fmi=3)
    build_faulty_fmu(folder, interpolate=False)
    build_faulty_fmu(folder, interpolate=False, rollback=False, name="Stuck")
    build_all_types_3_fmu(folder / "Types.fmu")
    return folder


def driven(fmu: Path, data: dict[str, Any], step: float, stop: float, **options: Any) -> ec.Result:
    """Run one FMU as component `c`, whose input u has these data."""
    settings = {name: options.pop(name) for name in ("interpolation",) if name in options}
    source = ec.Input(data=data, signals={"c.u": "u"}, **settings)
    values = options.pop("values", {})
    system = ec.System.of({"c": str(fmu)}, [], values)
    return ec.load(system, step_size=step, stop_time=stop, input=[source], **options).prepare().run()


@pytest.mark.parametrize(("algorithm", "extrapolation"), ALL_PAIRS)
@pytest.mark.parametrize(("name", "x"), [("Integrator", "c.x"), ("Faulty", "c.z")])
def test_jump_acts_at_its_time(name: str, x: str, algorithm: str, extrapolation: str, fmus: Path) -> None:
    """At a communication point, and between two; also in an FMU that does not interpolate."""
    more = {"algorithm": algorithm, "extrapolation": extrapolation}
    for at in (0.5, 0.53):
        jump = {"time": [0.0, at, at, 2.0], "u": [0.0, 0.0, 1.0, 1.0]}
        stepwise = {"time": [0.0, at, 2.0], "u": [0.0, 1.0, 1.0]}
        for data, way in ((jump, "linear"), (stepwise, "held")):
            result = driven(fmus / f"{name}.fmu", data, 0.1, 1.0, interpolation=way, **more)
            assert result[x] == pytest.approx(np.maximum(result.time - at, 0.0), abs=1e-12)
            got = "line" if name == "Integrator" else "mean of the step"
            assert result.record["stepping"]["known_inputs"] == {"input.c.u -> c.u": got}


def command(time: Any) -> Any:
    return np.sin(7.0 * time) + 0.3 * np.cos(19.0 * time)


ROWS = np.linspace(0.0, 2.0, 2001)
COMMAND = command(ROWS)


def exact(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and force of `Loop` under lines between the rows of the command.

    A matrix exponential is exact from row to row; a solver would try to step over 2000 kinks. All points
    are rows.
    """
    rates = np.array([[0.0, 1.0, 0.0, 0.0], [-400.0, -8.0, 400.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0] * 4])
    onward, y, x = expm((ROWS[1] - ROWS[0]) * rates), np.zeros(2), [0.0]
    for u, slope in zip(COMMAND, np.diff(COMMAND) / np.diff(ROWS), strict=False):
        y = (onward @ [*y, u, slope])[:2]
        x.append(y[0])
    rows = np.rint(points / (ROWS[1] - ROWS[0])).astype(int)
    assert ROWS[rows] == pytest.approx(points)
    return np.array(x)[rows], 400.0 * (COMMAND - x)[rows]


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_lines_are_accurate_to_second_order_without_an_option(algorithm: str, fmus: Path) -> None:
    errors = []
    for step in (0.02, 0.01):
        result = driven(fmus / "Loop.fmu", {"time": ROWS, "u": COMMAND}, step, 2.0, algorithm=algorithm)
        for signal, true in zip(("c.x", "c.F"), exact(result.time), strict=True):
            errors.append(np.abs(result[signal] - true).max() / np.ptp(true))
    assert max(errors) < 0.01
    assert np.array(errors[:2]) / errors[2:] == pytest.approx(4.0, rel=0.15)


def test_outputs_that_an_fmu_keeps_are_reported_as_late(fmus: Path) -> None:
    """FMUs of FMI 3.0 of this project do not interpolate: states get the mean, and outputs are of that."""
    step, data = 0.01, {"time": ROWS, "u": COMMAND}
    result = driven(fmus / "Loop3.fmu", data, step, 2.0)
    x, force = exact(result.time)
    assert np.abs(result["c.x"] - x).max() < 0.003 * np.ptp(x)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(ROWS) * (COMMAND[1:] + COMMAND[:-1]))])
    mean = np.diff(np.interp(result.time, ROWS, integral)) / step
    assert result["c.F"][1:] == pytest.approx(400.0 * (mean - result["c.x"][1:]), abs=0.05)
    for more in (result, driven(fmus / "Loop3.fmu", data, step, 2.0, error_tolerance=1e-2)):
        (remark,) = (r for r in more.remarks if "half a step late" in r)
        assert remark.startswith("outputs of c that depend directly on data")
    assert np.abs(result["c.F"] - force).max() > 0.01 * np.ptp(force)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_recomputed_outputs_have_the_values_of_the_step_end(algorithm: str, fmus: Path) -> None:
    """x' = u, y = u of an FMU that does not interpolate, with a jump at a point and one between two."""
    data = {"time": [0.0, 1.0, 1.0, 1.6, 1.6, 4.0], "u": [0.0, 1.0, -1.0, -1.0, 1.0, 2.0]}
    system = ec.System.of({"c": str(fmus / "Types.fmu")}, [])
    source = ec.Input(data=data, signals={"c.u[1,1]": "u"})
    options = {"step_size": 0.25, "stop_time": 4.0, "algorithm": algorithm}
    result = ec.load(system, input=[source], **options).prepare().run()
    integral = [0.0, *np.cumsum(np.diff(data["time"]) * 0.5 * (np.array(data["u"])[1:] + data["u"][:-1]))]
    part = np.searchsorted(data["time"], result.time, side="right") - 1
    ahead, start = result.time - np.array(data["time"])[part], np.array(data["u"])[part]
    slope = np.array([1.0, 0.0, 0.0, 0.0, 1.0 / 2.4, 0.0])[part]
    u, x = start + slope * ahead, np.array(integral)[part] + ahead * (start + 0.5 * slope * ahead)
    assert result["c.x"] - result["c.x"][0] == pytest.approx(x, abs=1e-12)
    assert result["c.y[1,1]"] == pytest.approx(u, abs=1e-12)
    assert not result.remarks


def test_fmu_that_cannot_copy_its_state_is_not_tried(fmus: Path) -> None:
    """x' = u, y = x + 2 u: the states get the mean, and so does the output."""
    data = {"time": [0.0, 1.0, 1.5, 4.0], "u": [0.0, 1.0, -1.0, 2.0]}
    system = wired([faulty("c", fmus / "Stuck.fmu", a=1.0, b=2.0)])
    source = ec.Input(data=data, signals={"c.u": "u"})
    result = ec.load(system, step_size=0.25, stop_time=4.0, input=[source]).prepare().run()
    u = np.interp(result.time, data["time"], data["u"])
    mean = 0.5 * (u[1:] + u[:-1])
    x = np.concatenate([[0.0], 0.25 * np.cumsum(mean)])
    assert result["c.z"] == pytest.approx(x, abs=1e-12)
    assert result["c.y"][1:] == pytest.approx(x[1:] + 2.0 * mean, abs=1e-12)
    assert any("half a step late" in r for r in result.remarks)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("multiple", [1, 3])
def test_sampled_components_get_the_value_of_their_instant(multiple: int, algorithm: str, fmus: Path) -> None:
    """A digital component samples at the end of its step."""
    parts = {"c": ec.Component("c", fmu=fmus / "Sampler.fmu", samples=True)}
    system = ec.System(tuple(parts.values()), ())
    source = ec.Input(data={"time": [0.0, 3.0], "u": [0.0, 3.0]}, signals={"c.u": "u"})
    options = {"algorithm": algorithm, "step_multiples": {"c": multiple} if multiple > 1 else {}}
    result = ec.load(system, step_size=0.1, stop_time=1.2, input=[source], **options).prepare().run()
    sampled = 0.1 * multiple * np.floor(np.arange(13) / multiple)
    assert result["c.y"] == pytest.approx(sampled, abs=1e-12)


def test_order_of_the_user_does_not_delay_data(fmus: Path) -> None:
    data = {"time": [0.0, 2.0], "u": [0.0, 2.0]}
    result = driven(fmus / "Integrator.fmu", data, 0.1, 1.0, order=["c", "input"])
    assert result["c.x"] == pytest.approx(0.5 * result.time**2, abs=1e-12)
    assert result.record["stepping"]["late_connections"] == []


def test_table_without_spans_is_a_component_like_others(fmus: Path, tmp_path: Path) -> None:
    """Its values are held: with `jacobi`, those of the start of the step."""
    content = table_fmus.TableContent(
        np.array([0.0, 2.0]), [table_fmus.TableColumn(np.array([0.0, 2.0]))], [table_fmus.TableOutput("u", 0)]
    )
    built = table_fmus.build_table(content, tmp_path / "new.fmu")
    old = edit_description(
        built, tmp_path / "old.fmu", "step.begin.u", "a", "step.end.u", "b", "step.mean.u", "c"
    )
    for table, names in ((built, ["d.u -> c.u"]), (old, [])):
        system = ec.System.of({"d": str(table), "c": str(fmus / "Integrator.fmu")}, ["d.u -> c.u"])
        result = ec.load(system, step_size=0.1, stop_time=1.0, algorithm="jacobi").prepare().run()
        assert list(result.record["stepping"].get("known_inputs", {})) == names
        exact = 0.5 * result.time**2
        assert result["c.x"] == pytest.approx(exact if names else exact - 0.05 * result.time, abs=1e-12)


def test_tables_are_recognized_as_they_are_built() -> None:
    assert (table_fmus.MODEL, table_fmus.SPANS) == (tables.MODEL, tables.SPANS)
