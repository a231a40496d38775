"""Runs that end early or diverge: the reason comes first, and only failures are reported as such."""

from pathlib import Path

import pytest

import emla_cosim as ec
from emla_cosim.base.errors import RunError
from fmublock import Block, Input, Output, Parameter, State
from tests.support.commands import Emla
from tests.support.faulty_systems import Fault
from tests.support.hand_written_fmus import build_integrated_fmu


class Drive(Block):
    """A mass on a spring, driven by the force of a rigid load."""

    F = Input(unit="N", description="Force of the load")
    x = State(0.1, unit="m", description="Position")
    v = State(0.0, unit="m/s", description="Speed")
    a = Output(unit="m/s2", description="Acceleration")

    def derivatives(self, v):
        return {"x": v.v, "v": v.F - 100.0 * v.x}

    def outputs(self, v):
        return {"a": v.F - 100.0 * v.x}


class Load(Block):
    """A rigid load."""

    a = Input(unit="m/s2", description="Acceleration")
    m = Parameter(1.0, unit="kg", description="Mass")
    F = Output(unit="N", description="Force")

    def outputs(self, v):
        return {"F": -v.m * v.a}


@pytest.fixture(scope="module")
def pair() -> ec.System:
    return ec.System.of({"drive": Drive, "load": Load}, ["drive.a -> load.a", "load.F -> drive.F"])


@pytest.mark.parametrize(("mass", "diverges"), [(300.0, True), (0.1, False)])
def test_growth_without_bound_is_reported_first(pair: ec.System, mass: float, diverges: bool) -> None:
    options = {"step_size": 1e-2, "stop_time": 2.0, "algorithm": "jacobi"}
    with ec.load(pair, **options, set={"load.m": mass}).prepare() as simulation:
        result = simulation.run()
    assert result.problem is None
    assert any(remark.startswith("Diverged: ") for remark in result.remarks[:1]) == diverges
    if diverges:
        assert "reached" in result.remarks[0] and "3 more signals grew as far" in result.remarks[0]


@pytest.fixture(scope="module")
def ending(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Model Exchange FMU that requests the end of the simulation at its time `end`."""
    return build_integrated_fmu(tmp_path_factory.mktemp("ending") / "B.fmu")


def load_ending(fmu: Path, end: float) -> ec.Scenario:
    return ec.load(str(fmu), kind={"*": "me"}, step_size=0.1, stop_time=1.0, set={"B.end": end})


def test_an_fmu_may_end_the_run(ending: Path) -> None:
    """At 0.3 s, in an event: the last complete step ends at 0.2 s."""
    with load_ending(ending, 3.0).prepare() as simulation:
        result = simulation.run()
        repeated = simulation.run(set={"B.end": 5.0})
        assert "requirements not met" in str(simulation.attempt(require=["B.h.final > 1e9"]).problem)
    assert (result.problem, result.end_s, result.record["status"]) == (None, pytest.approx(0.2), "completed")
    assert result.remarks[0].startswith("the run ended at t = 0.2 s: B asked to end the simulation")
    assert result.record["requested_end"] == {"component": "B", "time_s": pytest.approx(0.2)}
    assert len(result.time) == 3
    assert repeated.end_s == pytest.approx(0.4)


def test_an_fmu_that_ends_before_the_first_row_fails(ending: Path) -> None:
    with load_ending(ending, -1.0).prepare() as simulation, pytest.raises(RunError):
        simulation.run()


@pytest.mark.parametrize("isolate", [False, True])
def test_discarded_steps_that_ask_for_the_end(isolate: bool, faulty_fmu: Path) -> None:
    system = ec.System.of({"a": faulty_fmu}, set={"a.fault": int(Fault.TERMINATE), "a.at": 0.3})
    options = {"step_size": 0.1, "stop_time": 1.0, "isolate": isolate}
    with ec.load(system, **options).prepare() as simulation:
        result = simulation.run()
    assert (result.problem, result.end_s) == (None, pytest.approx(0.3))
    assert "a asked to end the simulation during doStep" in result.remarks[0]


def test_the_command_ends_with_0(ending: Path, emla: Emla) -> None:
    result = emla(
        "run", str(ending), "--kind", "me", "--step-size", "0.1", "--stop-time", "1", "--set", "B.end=3",
        "--no-plots", "--output", "o",
    )  # fmt: skip
    assert result.exit_code == 0
    assert "asked to end the simulation" in result.output


@pytest.mark.slow
def test_sweeps_tell_diverged_variants_from_others(pair: ec.System, on_one_cluster: None) -> None:
    scenario = ec.load(pair, step_size=1e-2, stop_time=2.0, algorithm="jacobi")
    swept = ec.sweep(scenario, {"load.m": [0.1, 300.0]}, metrics=["a = last(drive.a)"])
    assert swept.variants["status"].to_list() == ["done", "diverged"]
    assert swept.variants["problem"][1].startswith("Diverged: drive.a reached")
