"""The estimated coupling error against solutions of the whole, and when there is none."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import emla_cosim as ec
from emla_cosim.fmu.file import FmuFile
from emla_cosim.master.assembly import Assembly
from emla_cosim.run import execution
from emla_cosim.run.coupling_summary import LARGEST_ERROR
from emla_cosim.study.loading import load
from tests.support.coupled_systems import (
    DRIVE_WIRES,
    DigitalController,
    Motor,
    Rotor,
    chain,
    drive,
    rigid_load,
    systems,
)
from tests.support.hand_written_fmus import build_faulty_fmu, build_forgetful_fmu
from tests.support.tiers import mostly_slow

CASES = [
    ("undamped pair", "strong", "fmu", (400, 1600, 12800)),
    ("lightly damped pair", "jacobi", "fmu", (1300, 3200, 25600)),
    ("damped pair", "jacobi", "none", (400, 3200, 102400)),
    ("damped pair", "strong", "none", (150, 800, 25600)),
    ("chain of three", "jacobi", "fmu", (1600, 6400, 51200)),
    ("drive", "gauss-seidel", "none", (400, 3200, 102400)),
    ("drive", "strong", "fmu", (200, 800, 6400)),
    ("heat", "gauss-seidel", "none", (70, 400, 12800)),
    ("heat", "jacobi", "fmu", (160, 600, 4000)),
    ("rigid load", "strong", "fmu", (100, 400, 1600)),
]


def is_remark(text: str) -> bool:
    return text.startswith("Coupling error: ")


def run(system: ec.System, folder: Path, step: float, stop: float, **options: Any) -> ec.Result:
    with ec.load(system, step_size=step, stop_time=stop, **options).prepare(fmus=folder) as simulation:
        return simulation.run()


IN_SHORT = [case for case in CASES if case[0] in ("lightly damped pair", "damped pair", "chain of three")]
IN_SHORT += [("drive", "strong", "fmu", (200, 800, 6400)), ("heat", "gauss-seidel", "none", (70, 400, 12800))]
"""Each algorithm, each extrapolation, and each kind of system that is quick."""


@pytest.mark.parametrize(("name", "algorithm", "extrapolation", "steps"), mostly_slow(CASES, IN_SHORT))
def test_size_of_the_error(
    fmu_folder: Path,
    name: str,
    algorithm: str,
    extrapolation: str,
    steps: Sequence[int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At steps where the error is about 30 %, 3 % and 0.1 %."""
    monkeypatch.setattr(execution, "ALLOWANCE", 1.0)  # s; a busy machine gets through less of it in time
    case, how = systems()[name], {"algorithm": algorithm, "extrapolation": extrapolation}
    for count, low, high in zip(steps, (0.15, 0.015, 0.0003), (0.6, 0.06, 0.002), strict=True):
        result = run(case.system, fmu_folder, case.stop / count, case.stop, **how)
        error, estimated = case.error(result), result.record["coupling"]["estimated_error"]
        assert low < error < high
        assert estimated < LARGEST_ERROR if error < LARGEST_ERROR else error / 3.0 < estimated < 3.0 * error
        assert [is_remark(text) for text in result.remarks] == [True] * (error > LARGEST_ERROR)


def test_chain_whose_fmus_take_no_derivatives(fmu_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    has_capability = FmuFile.has_capability
    monkeypatch.setattr(
        FmuFile, "has_capability", lambda f, c: c != "canInterpolateInputs" and has_capability(f, c)
    )
    case = chain(3, 0.1)
    result = run(case.system, fmu_folder, 1e-3, 10.0, algorithm="strong", extrapolation="fmu")
    assert result.remarks[0].startswith(
        "--extrapolation fmu: m0, m1, m2, s1 and s2 cannot interpolate inputs"
    )
    result = run(case.system, fmu_folder, 1e-3, 10.0, algorithm="strong")
    error = case.error(result)
    assert error > 0.15
    assert result.record["coupling"]["order"] == 1
    assert error / 3.0 < result.record["coupling"]["estimated_error"] < 3.0 * error
    assert is_remark(result.remarks[0]) and "order 1" in result.remarks[0]
    assert "--extrapolation" not in result.remarks[0]


def test_heavy_load(fmu_folder: Path) -> None:
    """A load of 3000 times the mass, which was 17 % wrong without a remark."""
    case = rigid_load(3000.0)
    how: dict[str, Any] = {"algorithm": "strong", "extrapolation": "fmu"}
    result = run(case.system, fmu_folder, 6.5e-3, 307 * 6.5e-3, **how)
    assert case.error(result) > 0.05
    assert is_remark(result.remarks[0])


@pytest.mark.parametrize(
    ("name", "stop"),
    [
        ("lift", 0.1),
        ("prototype", 0.5),
        ("hdrm-replay", 0.5),
        ("hdrm-coupled", 0.1),
        pytest.param("study", None, marks=pytest.mark.slow),
        pytest.param("study-drive", None, marks=pytest.mark.slow),
        pytest.param("published-true-states", None, marks=pytest.mark.slow),
        pytest.param("hdrm-replay", None, marks=pytest.mark.slow),
        pytest.param("hdrm-coupled", None, marks=pytest.mark.slow),
        pytest.param("hdrm-merged", None, marks=pytest.mark.slow),
    ],
)
def test_built_in_scenarios_have_no_remark(fmu_folder: Path, name: str, stop: float | None) -> None:
    options = {} if stop is None else {"stop_time": stop}
    with load(name, fmus=fmu_folder, **options).prepare() as simulation:
        result = simulation.attempt(recorders=[])
    assert not any(is_remark(text) for text in result.remarks)


def test_explicit_coupling_that_is_unstable(fmu_folder: Path) -> None:
    result = run(rigid_load(3.0).system, fmu_folder, 1e-3, 0.05)
    assert any(text.endswith("Use --algorithm strong.") for text in result.remarks)


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel", "strong"])
def test_controller_keeps_its_sampling_times(fmu_folder: Path, algorithm: str) -> None:
    """The solution between samples is a matrix exponential: only motor and rotor have a coupling error.

    With Jacobi, a voltage acts one step after the speed from which it was computed. The other algorithms step
    the controller between rotor and motor, so that it knows the speed at the end of the step.
    """
    h, count, is_late = 0.005, 200, algorithm == "jacobi"
    parts = {"controller": DigitalController, "motor": Motor, "rotor": Rotor}
    result = run(ec.System.of(parts, DRIVE_WIRES), fmu_folder, h, h * count, algorithm=algorithm)
    rates = np.array([[-100.0, -10.0, 100.0], [100.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    onward, y, z, speeds = expm(h * rates), np.array([0.0, 0.0, 5.0]), 0.0, [0.0]
    for _ in range(count):
        free = onward @ [y[0], y[1], 0.0]
        if is_late:
            sampled_speed, voltage = y[1], y[2]
        else:  # u = 0.5 (10 - w) + 0.05 (z + 10 - w) with w = free_w + onward_wu u
            voltage = (0.55 * (10.0 - free[1]) + 0.05 * z) / (1.0 + 0.55 * onward[1, 2])
            sampled_speed = free[1] + onward[1, 2] * voltage
        z += 10.0 - sampled_speed
        y = onward @ [y[0], y[1], voltage]
        y[2] = 0.5 * (10.0 - sampled_speed) + 0.05 * z
        speeds.append(y[1])
    error = np.abs(result["rotor.w"] - speeds).max() / np.ptp(speeds)
    record = result.record["coupling"]
    assert set(record["connections"]) == {"rotor.w -> motor.w", "motor.tau -> rotor.tau"}
    assert error > 0.01
    assert error / 2.0 < result.coupling["rotor.w -> motor.w"]["estimated_error"] < 2.0 * error


def test_estimate_changes_no_bits(fmu_folder: Path) -> None:
    case = drive()
    results = [
        run(case.system, fmu_folder, 1e-3, 0.5, algorithm="strong", estimate_coupling=is_on)
        for is_on in (True, False)
    ]
    for name in results[0].names:
        assert np.array_equal(results[0][name], results[1][name])
    assert results[0].stepping == results[1].stepping
    assert results[1].record["coupling"]["not_estimated"] == "it is switched off"
    assert not results[1].coupling


def test_states_that_are_not_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An equal run has the same remark without an estimate, so that it leaves the instances usable."""
    path, starts, start = build_forgetful_fmu(tmp_path / "Forgetful.fmu"), list[bool](), Assembly.start

    def record(assembly: Assembly, system: ec.System, is_fresh: bool = False, *arguments: Any) -> None:
        starts.append(is_fresh)
        start(assembly, system, is_fresh, *arguments)

    monkeypatch.setattr(Assembly, "start", record)
    system = ec.System.of({"a": path, "b": path}, ["a.x -> b.u", "b.x -> a.u"])
    with ec.load(system, step_size=0.01, stop_time=0.1).prepare(fmus=tmp_path) as simulation:
        starts.clear()
        for _ in range(3):
            assert simulation.run().remarks == [
                "The coupling error is not estimated: a restored state does not lead to the same results."
            ]
    assert starts == [False, True, False]


def test_fmus_that_do_not_show_whether_they_sample(tmp_path: Path) -> None:
    path = build_faulty_fmu(tmp_path)
    system = ec.System.of({"a": path, "b": path}, ["a.z -> b.u", "b.z -> a.u"])
    result = run(system, tmp_path, 0.01, 0.1)
    why = "the model description of a and b does not show whether it samples"
    assert result.record["coupling"]["not_estimated"].startswith(why)
    assert f"Coupling error not estimated: {why}" in str(result)
    assert not result.remarks


def test_fmus_that_cannot_restore_states(fmu_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    has_capability = FmuFile.has_capability
    monkeypatch.setattr(
        FmuFile, "has_capability", lambda f, c: c != "canGetAndSetFMUstate" and has_capability(f, c)
    )
    case = chain(2, 5.0, 1000.0)
    rough, fine = (run(case.system, fmu_folder, step, 10.0) for step in (0.02, 1e-4))
    assert rough.record["coupling"]["repeated"] == "differences of rows"
    assert "because FMUs cannot repeat steps" in rough.remarks[0]
    assert not fine.remarks


def test_inputs_that_are_set_during_a_run(fmu_folder: Path) -> None:
    system = drive().system.without_connections("motor.u")
    with ec.load(system, step_size=0.01, stop_time=0.1).prepare(fmus=fmu_folder) as simulation:
        simulation.advance(0.05)
        simulation["motor.u"] = 5.0
        simulation.advance(0.1)
        result = simulation.finish()
    assert result.record["coupling"]["not_estimated"] == "inputs were set during the run"


def test_runs_of_one_simulation_share_the_cost(fmu_folder: Path) -> None:
    case = drive()
    with ec.load(case.system, step_size=0.01, stop_time=1.0).prepare(fmus=fmu_folder) as simulation:
        first, second, changed = simulation.run(), simulation.run(), simulation.run(set={"motor.i": 0.1})
        shorter = simulation.run(step_size=0.005)
    assert first.coupling == second.coupling
    assert changed.record["coupling"]["not_estimated"] == "an earlier run of this simulation has an estimate"
    assert shorter.record["coupling"]["estimated_error"] < first.record["coupling"]["estimated_error"]
