"""FMUs that run as Model Exchange, integrated between communication points."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from tests.support.hand_written_fmus import build_integrated_fmu

STEP, STOP = 0.01, 2.0
TOLERANCES = [1e-4, 1e-6, 1e-8]


@pytest.fixture(scope="session")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_integrated_fmu(tmp_path_factory.mktemp("me") / "Integrated.fmu")


@pytest.fixture(scope="session")
def stateless(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same FMU, without getting and setting its state."""
    return build_integrated_fmu(tmp_path_factory.mktemp("me") / "Stateless.fmu", rollback=False)


def run(source: Any, **options: Any) -> ec.Result:
    defaults = (
        {}
        if isinstance(source, str)
        else {"step_size": STEP, "output_interval": options.get("step_size", STEP)}
    )
    run_options = {"stop_time": STOP, "integrate_together": False, **defaults, **options}
    with ec.load(source, **run_options).prepare() as simulation:
        return simulation.run()


def bouncing(times: np.ndarray) -> np.ndarray:
    """Height of a ball that falls from 1 m and keeps 0.7 of its speed."""
    g, at, speed, heights = 9.81, math.sqrt(2.0 / 9.81), 0.0, []
    hits, speeds = [0.0], [0.0]
    speed = g * at
    while at < times[-1]:
        speed *= 0.7
        hits.append(at)
        speeds.append(speed)
        at += 2.0 * speed / g
    for t in times:
        k = int(np.searchsorted(hits, t, side="right")) - 1
        s = t - hits[k]
        heights.append((1.0 if k == 0 else 0.0) + speeds[k] * s - 0.5 * g * s**2)
    return np.array(heights)


def chain(fmu: Path, **options: Any) -> ec.System:
    """Two of them: the input of the second is x of the first."""
    return ec.System.of({"a": fmu, "b": fmu}, ["a.x -> b.u"], set={"b.x": 0.0, **options})


def test_error_shrinks_with_the_tolerance(fmu: Path) -> None:
    errors, start = [], 5.0
    for tolerance in TOLERANCES:
        result = run(fmu, start_time=start, stop_time=start + STOP, fmi_tolerance=tolerance)
        since = result["time"] - start
        x = np.abs(result["Integrated.x"] - np.exp(-since)).max()
        h = np.abs(result["Integrated.h"] - bouncing(since)).max()
        errors.append(max(x, h))
        assert errors[-1] < 10.0 * tolerance
        stair = result["Integrated.stair"]
        assert stair[-1] == pytest.approx(round(since[-1] / 0.1), abs=1)
        assert set(np.diff(stair)) == {0.0, 1.0}
    assert errors[2] < 0.1 * errors[1] < 0.01 * errors[0]


def assert_is_that_of_fmpy(result: ec.Result, fmu: Path, step: float, stop: float) -> None:
    """Compare x and h with those of FMPy's own run of the FMU."""
    expected = simulate_fmu(
        str(fmu),
        fmi_type="ModelExchange",
        stop_time=stop,
        output_interval=step,
        relative_tolerance=1e-10,
        record_events=False,
    )
    for name in ("x", "h"):
        assert result[f"Integrated.{name}"] == pytest.approx(expected[name], abs=1e-6)


@pytest.mark.parametrize("integrator", ["bdf", "adams"])
def test_agrees_with_fmpy(fmu: Path, integrator: str) -> None:
    # FMPy cannot start its solver at events that are within rounding of an output
    step, stop = 0.017, 90 * 0.017
    options = {"step_size": step, "stop_time": stop, "integrator": integrator, "integrator_step": 1e-3}
    result = run(fmu, fmi_tolerance=1e-7, **options)
    assert_is_that_of_fmpy(result, fmu, step, stop)


def test_step_events_reset_a_state(fmu: Path) -> None:
    result = run(fmu, set={"Integrated.limit": 0.5, "Integrated.u": 2.0, "Integrated.x": 0.0})
    # x = 2 (1 - exp(-t)) reaches 0.5 after 0.288 s; the reset comes at most one communication step later
    assert result["Integrated.resets"][-1] in (6.0, 7.0)
    assert result["Integrated.x"].max() <= 0.5


@pytest.mark.parametrize(("extrapolation", "order"), [("none", 1), ("master", 2), ("fmu", 2)])
def test_inputs_are_held_or_extrapolated(fmu: Path, extrapolation: str, order: int) -> None:
    errors = []
    for step in (0.02, 0.01):
        result = run(
            chain(fmu), step_size=step, algorithm="jacobi", extrapolation=extrapolation, fmi_tolerance=1e-9
        )
        exact = result["time"] * np.exp(-result["time"])
        errors.append(np.abs(result["b.x"] - exact).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


def test_strong_coupling_repeats_steps(fmu: Path) -> None:
    """Two in a loop: x' = u - x with each other's output; the sum decays as exp(0 t), the difference as 2."""
    loop = ec.System.of({"a": fmu, "b": fmu}, ["a.x -> b.u", "b.x -> a.u"], set={"a.x": 1.0, "b.x": 0.0})
    errors = []
    for step in (0.02, 0.01):
        result = run(loop, step_size=step, algorithm="strong", fmi_tolerance=1e-9, extrapolation="master")
        exact = 0.5 + 0.5 * np.exp(-2.0 * result["time"])
        errors.append(np.abs(result["a.x"] - exact).max())
    assert errors[1] < 1e-3
    assert errors[1] < 0.6 * errors[0]


def test_error_control_holds_its_tolerance(fmu: Path) -> None:
    result = run(chain(fmu), error_tolerance=1e-4, extrapolation="fmu", fmi_tolerance=1e-8)
    assert result["b.x"] == pytest.approx(result["time"] * np.exp(-result["time"]), abs=1e-3)


def test_without_states_strong_and_error_control_are_refused(stateless: Path) -> None:
    loop = ec.System.of({"a": stateless, "b": stateless}, ["a.x -> b.u", "b.x -> a.u"])
    with pytest.raises(CommandError, match="canGetAndSetFMUstate"):
        run(loop, error_tolerance=1e-4)
    with pytest.raises(CommandError, match="canSerializeFMUstate"):
        run(stateless, checkpoint=Path("never.npz"))


def test_resumes_bit_for_bit(fmu: Path, tmp_path: Path) -> None:
    uninterrupted = run(chain(fmu), checkpoint=tmp_path / "whole.npz")
    run(chain(fmu), stop_time=1.0, checkpoint=tmp_path / "half.npz")
    rest = run(chain(fmu), resume=tmp_path / "half.npz")
    for name in uninterrupted.names:
        assert np.array_equal(uninterrupted[name][-len(rest[name]) :], rest[name]), name
    plain = run(chain(fmu))
    assert uninterrupted["a.h"] == pytest.approx(plain["a.h"], abs=1e-4)


def test_end_and_failure_are_reported(fmu: Path) -> None:
    ended = run(fmu, set={"Integrated.end": 3.0})
    assert "asked to end the simulation during newDiscreteStates at t = 0.3" in ended.remarks[0]
    with pytest.raises(RunError, match="cannot be integrated at t = "):
        run(fmu, set={"Integrated.fails": 0.5})
    with pytest.raises(RunError, match=r"newDiscreteStates at t = 0 s with nextEventTime = NaN"):
        run(fmu, set={"Integrated.end": -1.0})


def test_kind_is_chosen_and_recorded(fmu: Path) -> None:
    exchanged = run("study", stop_time=0.01, kind={"*.plant": "me"})
    kinds = {name: of["kind"] for name, of in exchanged.record["components"].items()}
    assert {k for n, k in kinds.items() if n.endswith(".plant")} == {"ModelExchange"}
    assert "CoSimulation" in kinds.values()
    json.dumps(exchanged.record)
    by_default = run("study", stop_time=0.01)
    name = next(n for n in exchanged.names if n.endswith("plant.x_L"))
    assert exchanged[name] == pytest.approx(by_default[name], rel=1e-5)
    with pytest.raises(CommandError, match="no FMU has CoSimulation"):
        run(fmu, kind={"*": "cs"})
    with pytest.raises(CommandError, match="no component matches"):
        run(fmu, kind={"other": "me"})
