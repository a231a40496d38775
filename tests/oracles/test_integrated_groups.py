"""Model Exchange FMUs that are connected with each other and integrated together.

Each has x' = u - x, y = x + gain u, a bouncing ball h, and a stair that rises by 1 each 0.1 s.
"""

import dataclasses
import json
import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from tests.oracles.test_integration import bouncing
from tests.support.hand_written_fmus import build_integrated_fmu

STOP = 2.0
SWAPPED = ["a.x -> b.u", "b.x -> a.u"]
Build = Callable[..., Path]


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    def get(**options: Any) -> Path:
        return build_integrated_fmu(tmp_path_factory.mktemp("group") / "Integrated.fmu", **options)

    return get


@pytest.fixture(scope="session")
def fmu(build: Build) -> Path:
    return build()


def run(system: ec.System, **options: Any) -> ec.Result:
    run_options = {"step_size": 0.1, "stop_time": STOP, "output_interval": 0.1, **options}
    with ec.load(system, **run_options).prepare() as simulation:
        return simulation.run()


def pair(fmu: Path, connections: list[str], **values: float) -> ec.System:
    start = {name.replace("__", "."): value for name, value in values.items()}
    return ec.System.of({"a": fmu, "b": fmu}, connections, set={"b.x": 0.0, **start})


def rotating(fmu: Path) -> ec.System:
    """a' = -a - b, b' = a - b, so that a = exp(-t) cos(t) and b = exp(-t) sin(t)."""
    system = pair(fmu, SWAPPED)
    first, second = system.connections
    second = dataclasses.replace(second, transformation=ec.LinearTransformation(-1.0))
    return dataclasses.replace(system, connections=(first, second))


@pytest.mark.parametrize(("start", "step"), [(0.0, 0.1), (5.0, 0.01)])
def test_error_shrinks_with_the_tolerance_at_any_step(fmu: Path, start: float, step: float) -> None:
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        options = {"step_size": step, "output_interval": step, "fmi_tolerance": tolerance}
        result = run(rotating(fmu), start_time=start, stop_time=start + STOP, **options)
        t = result["time"] - start
        a = np.abs(result["a.x"] - np.exp(-t) * np.cos(t)).max()
        b = np.abs(result["b.x"] - np.exp(-t) * np.sin(t)).max()
        errors.append(max(a, b))
        assert errors[-1] < 10.0 * tolerance
        assert result["b.h"] == pytest.approx(bouncing(t), abs=10.0 * tolerance)
    assert errors[2] < 0.1 * errors[1] < 0.01 * errors[0]


def test_error_of_separate_integration_depends_on_the_step(fmu: Path) -> None:
    result = run(rotating(fmu), integrate_together=False, fmi_tolerance=1e-8)
    assert np.abs(result["a.x"] - np.exp(-result["time"]) * np.cos(result["time"])).max() > 1e-3
    assert "integrated_together" not in result.record["stepping"]


@pytest.mark.parametrize("gain", [0.5, -3.0])
def test_loops_without_delay_are_solved(fmu: Path, gain: float) -> None:
    """y = x + gain times the other y: the sum of both y is the sum of x / (1 - gain)."""
    system = pair(fmu, ["a.y -> b.u", "b.y -> a.u"], a__gain=gain, b__gain=gain)
    result = run(system, fmi_tolerance=1e-8)
    t = result["time"]
    total = np.exp(t * (1.0 / (1.0 - gain) - 1.0))
    difference = np.exp(-t * (1.0 / (1.0 + gain) + 1.0))
    assert result["a.x"] == pytest.approx((total + difference) / 2.0, rel=1e-6)
    assert result["a.y"] == pytest.approx((total / (1.0 - gain) + difference / (1.0 + gain)) / 2.0, rel=1e-6)


def test_loop_without_a_solution_is_reported(fmu: Path) -> None:
    system = pair(fmu, ["a.y -> b.u", "b.y -> a.u"], a__gain=1.0, b__gain=1.0)
    with pytest.raises(RunError, match="have no solution: the gain around the loop is 1"):
        run(system)


def test_event_of_one_component_is_an_event_of_its_group(fmu: Path) -> None:
    """The other one integrates the height of the bouncing ball."""
    result = run(pair(fmu, ["a.h -> b.u"]), fmi_tolerance=1e-8)
    fine = np.linspace(0.0, STOP, 40_001)
    height = bouncing(fine)
    weights = np.exp(fine) * height
    integral = np.concatenate([[0.0], np.cumsum((weights[1:] + weights[:-1]) / 2.0) * (fine[1] - fine[0])])
    exact = np.interp(result["time"], fine, np.exp(-fine) * integral)
    assert result["b.x"] == pytest.approx(exact, abs=1e-6)
    assert result["a.h"] == pytest.approx(bouncing(result["time"]), abs=1e-6)


def test_discrete_values_pass_in_events(fmu: Path) -> None:
    """The stair of a drives b, which is in its group because of b.x -> a.u."""
    result = run(pair(fmu, ["a.stair -> b.u", "b.x -> a.u"]), step_size=0.25, output_interval=0.25)
    assert result.record["stepping"]["integrated_together"] == [["a", "b"]]
    steps = [0.1 * k for k in range(1, 20)]
    exact = [sum(1.0 - math.exp(at - t) for at in steps if at < t) for t in result["time"]]
    assert result["b.x"] == pytest.approx(exact, abs=1e-4)


def test_discrete_inputs_sample_continuous_outputs(build: Build) -> None:
    """They take their values at communication points, as without a group; b.x -> a.u is continuous."""
    components = {"a": build(), "b": build(input="discrete")}
    step = 0.25
    result = run(ec.System.of(components, SWAPPED, set={"b.x": 0.0}), step_size=step, output_interval=step)
    assert result.record["stepping"]["integrated_together"] == [["a", "b"]]
    over = expm(step * np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 0.0]]))
    a, b = 1.0, 0.0
    for k in range(len(result["time"])):
        assert (result["a.x"][k], result["b.x"][k]) == pytest.approx((a, b), abs=1e-4)
        a, b, _ = over @ [a, b, a]


def test_repeated_resumed_and_fresh_runs_are_equal(fmu: Path, tmp_path: Path) -> None:
    system = rotating(fmu)
    with ec.load(system, step_size=0.1, output_interval=0.1, stop_time=STOP).prepare() as simulation:
        first, second = simulation.run(), simulation.run()
        simulation.run(fmi_tolerance=1e-3, integrator="adams")
        third = simulation.run(fresh=True)
    uninterrupted = run(system, checkpoint=tmp_path / "whole.npz")
    run(system, stop_time=1.0, checkpoint=tmp_path / "half.npz")
    rest = run(system, resume=tmp_path / "half.npz")
    for name in first.names:
        assert np.array_equal(first[name], second[name]), name
        assert np.array_equal(first[name], third[name]), name
        assert np.array_equal(uninterrupted[name][-len(rest[name]) :], rest[name]), name
    assert uninterrupted["a.x"] == pytest.approx(first["a.x"], abs=1e-5)


@pytest.mark.slow
def test_strong_coupling_repeats_steps_of_a_group(fmu: Path) -> None:
    """a and b are a group, and strong coupling repeats its steps, because c is isolated."""
    ring = ec.System.of({"a": fmu, "b": fmu, "c": fmu}, ["a.x -> b.u", "b.x -> c.u", "c.x -> a.u"])
    options = {"isolate": ["c"], "algorithm": "strong", "extrapolation": "master", "fmi_tolerance": 1e-8}
    shift = np.roll(np.eye(3), -1, axis=1) - np.eye(3)
    errors = []
    for step in (0.1, 0.05):
        result = run(
            ring.with_parameters({"b.x": 0.0, "c.x": 0.5}), step_size=step, output_interval=step, **options
        )
        assert result.record["stepping"]["integrated_together"] == [["a", "b"]]
        exact = [expm(t * shift) @ [1.0, 0.0, 0.5] for t in result["time"]]
        errors.append(np.abs(np.array([result[f"{n}.x"] for n in "abc"]).T - exact).max())
    assert errors[0] < 2e-3
    assert errors[1] < 0.4 * errors[0]


def test_free_input_that_changes_restarts_the_integrator(fmu: Path) -> None:
    with ec.load(pair(fmu, ["a.x -> b.u"]), step_size=0.1, stop_time=STOP).prepare() as simulation:
        simulation.advance(1.0)
        simulation["a.u"] = 3.0
        simulation.advance(STOP)
        a, b = simulation["a.x"], simulation["b.x"]
    exact = solve_ivp(
        lambda t, x: [3.0 * (t > 1.0) - x[0], x[0] - x[1]], (0.0, STOP), [1.0, 0.0], rtol=1e-9, max_step=0.01
    )
    assert (a, b) == pytest.approx(exact.y[:, -1], abs=1e-4)


def test_instance_without_states_is_refused_by_name(build: Build) -> None:
    system = ec.System.of({"a": build(), "b": build(rollback=False)}, SWAPPED)
    assert run(system)["b.x"][-1] > 0.0
    for options in ({"error_tolerance": 1e-4}, {"checkpoint": Path("never.npz")}):
        with pytest.raises(CommandError, match=r"a\+b cannot do it"):
            run(system, **options)


def test_failures_name_the_component(fmu: Path) -> None:
    with pytest.raises(RunError, match=r"a\+b cannot be integrated at t = "):
        run(pair(fmu, SWAPPED).with_parameters({"b.fails": 0.5}))


def test_member_may_end_the_run(fmu: Path) -> None:
    ended = run(pair(fmu, SWAPPED).with_parameters({"b.end": 3.0}))
    assert ended.problem is None
    assert "b asked to end the simulation during newDiscreteStates at t = 0.3" in ended.remarks[0]


def test_options_name_components_of_a_group(fmu: Path) -> None:
    three = ec.System.of(
        {"a": fmu, "c": fmu, "b": fmu}, ["a.x -> b.u", "b.x -> a.u", "b.stair -> c.u"], set={"b.x": 0.0}
    )
    first = run(three)
    assert first.record["stepping"]["order"] == ["a+b", "c"]
    assert first.names == run(three, order=["c", "a", "b"]).names
    with pytest.raises(CommandError, match="missing: c"):
        run(three, order=["a", "b"])
    with pytest.raises(CommandError, match="integrated together with other components"):
        run(three, step_multiples={"a": 2})
    json.dumps(first.record)


def test_component_that_samples_is_not_in_a_group(fmu: Path) -> None:
    system = pair(fmu, SWAPPED)
    sampling = system.with_component(dataclasses.replace(system.component("b"), samples=True))
    assert "integrated_together" not in run(sampling).record["stepping"]


def test_connection_of_a_component_with_itself(fmu: Path) -> None:
    result = run(ec.System.of({"a": fmu}, ["a.x -> a.u"]), fmi_tolerance=1e-6)
    assert result["a.x"] == pytest.approx(1.0, abs=1e-6)


def test_package_results_match_the_system(fmu: Path, tmp_path: Path) -> None:
    system = rotating(fmu)
    options = {"step_size": 0.1, "output_interval": 0.1, "stop_time": STOP}
    package = ec.load(system, **options).export(tmp_path / "pair.ssp")
    with ec.load(package, output_interval=0.1).prepare() as simulation:
        result = simulation.run()
    direct = run(system)
    assert result.record["stepping"]["integrated_together"] == [["a", "b"]]
    for name in direct.names:
        assert np.array_equal(result[name], direct[name]), name
    assert ec.info(package).notes[-1] == "a and b: Model Exchange, integrated together by CVode"
    assert (
        ec.info(package, integrate_together=False).notes[-1] == "a and b: Model Exchange, integrated by CVode"
    )


@pytest.mark.parametrize(("kinds", "tag"), [("me me", "VariableStepSolver"), ("me cs", "FixedStepMaster")])
def test_omsimulator_integrates_a_package_of_model_exchange_alone(
    kinds: str, tag: str, fmu: Path, fmu_folder: Path, tmp_path: Path
) -> None:
    plant = fmu_folder / "EmlaPlant" / "EmlaPlant.fmu"
    system = rotating(fmu) if kinds == "me me" else ec.System.of({"a": fmu, "b": plant}, [])
    package = ec.load(system, step_size=0.125, stop_time=STOP).export(tmp_path / "pair.ssp")
    with zipfile.ZipFile(package) as archive:
        root = ElementTree.fromstring(archive.read("SystemStructure.ssd"))
    (settings,) = (e for e in root.iter() if e.tag.endswith("SimulationInformation"))
    (stepping,) = settings
    assert stepping.tag.rpartition("}")[2] == tag
    if tag == "VariableStepSolver":
        assert stepping.attrib["description"] == "cvode"
        assert float(stepping.attrib["maximumStepSize"]) == 0.125
    assert ec.load(package).options.step_size == 0.125
