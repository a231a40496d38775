"""Where the time of a run goes: `--profile`."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.master.algorithms.gauss_seidel import GaussSeidel
from emla_cosim.master.algorithms.jacobi import Jacobi
from emla_cosim.master.algorithms.strong import Strong
from emla_cosim.master.instances.fmu_instance import EntryPoints, FmuInstance
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.fixed_steps import FixedSteps
from emla_cosim.master.stepping.profiler import Profiler
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.lanes import in_lanes
from tests.support.simulated import Table, begun, simulated
from tests.support.slaves import FakeSlave, compilable
from tests.support.tiers import mostly_slow

NAP = 2e-3
STEPS = 20
TIMES = make_communication_points(1.0, 1.0 / STEPS)
SAME = {"stop_time": 0.05, "step_size": 1e-4}


class Passing(FmuInstance):
    """Passes all calls on to another slave, whose C functions a profiler cannot replace."""

    rolls_back = True

    def __init__(self, slave: FakeSlave) -> None:
        self.slave, self.name = compilable(slave), slave.name
        self.inputs, self.outputs = slave.inputs, slave.outputs
        self.continuous_inputs, self.continuous_outputs = slave.continuous_inputs, slave.continuous_outputs
        self.nominals = slave.nominals

    def bind(self, inputs: np.ndarray, outputs: np.ndarray) -> None:
        self.slave.bind(inputs, outputs)
        self.inputs, self.outputs = inputs, outputs

    def enter_initialization(self, start_time: float, stop_time: float | None) -> None:
        self.slave.enter_initialization(start_time, stop_time or 0.0)

    def exit_initialization(self) -> None:
        self.slave.exit_initialization()

    def set_inputs(self) -> None:
        self.slave.set_inputs()

    def get_outputs(self) -> None:
        self.slave.get_outputs()

    def do_step(self, time: float, step: float) -> None:
        self.slave.do_step(time, step)

    def save(self, state: Any = None) -> Any:
        return self.slave.save(state)

    def restore(self, state: Any) -> None:
        self.slave.restore(state)

    def forget(self, state: Any) -> None:
        self.slave.forget(state)

    def entry_points(self) -> EntryPoints | None:
        return self.slave.entry_points()

    def close(self) -> None:
        self.slave.close()


def slow_and_fast() -> Network:
    """`slow` sleeps in each step; `fast` reads it, and `slow` reads `fast`."""

    def sleeping(u: np.ndarray, x: np.ndarray, at: float, step: float) -> np.ndarray:
        time.sleep(NAP)
        return x + step * (u - x)

    slaves = [
        FakeSlave("slow", 1, [1.0], sleeping),
        FakeSlave("fast", 1, [0.0], lambda u, x, at, step: x + step * u),
    ]
    return Network([Passing(slave) for slave in slaves], [Link(0, 0, 1, 0, False), Link(1, 0, 0, 0, False)])


def noted(network: Network) -> dict[str, dict[str, int]]:
    """Calls by name of the slave and by what they do, as the slaves noted them."""
    found = {}
    for passing in network.instances:
        assert isinstance(passing, Passing)
        calls = [call.split(".")[1] for call in passing.slave.calls]
        kinds = {"set": "inputs", "step": "steps", "get": "outputs", "save": "states", "restore": "states"}
        found[passing.name] = dict[str, int]()
        for call in calls:
            found[passing.name][kinds[call]] = found[passing.name].get(kinds[call], 0) + 1
    return found


@pytest.mark.parametrize("lanes", [1, 2])
@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("algorithm", [Jacobi, GaussSeidel, Strong])
def test_each_slave_has_its_calls_and_its_time(algorithm: type, compiled: bool, lanes: int) -> None:
    """The slaves note their calls themselves, and one sleeps; rows are those without a profiler."""
    if lanes > 1 and not compiled:
        pytest.skip("Python steps in one thread.")
    plain = simulated(slow_and_fast(), algorithm(), TIMES, compiled=compiled)
    network = slow_and_fast()
    profiler = Profiler(network.instances)
    stepping = FixedSteps(begun(network, algorithm(), TIMES), TIMES, compiled)
    assert stepping.is_compiled == compiled
    if lanes > 1:
        in_lanes(stepping, count=lanes)
    profiler.restart()
    for passing in network.instances:
        passing.slave.calls.clear()  # type: ignore[attr-defined]
    table = Table(1 + len(network.signals))
    stepping.record(table)
    began = time.perf_counter()
    while not stepping.finished:
        stepping.advance(table, STEPS)
    wall = time.perf_counter() - began
    found = profiler.report(wall, stepping.seconds_beside)
    profiler.close()
    assert table.rows.tobytes() == plain.tobytes()
    calls = {n: {k: c["count"] for k, c in row["calls"].items()} for n, row in found["fmus"].items()}
    assert calls == noted(network)
    slow, fast = found["fmus"]["slow"], found["fmus"]["fast"]
    steps = slow["calls"]["steps"]
    assert steps["count"] >= STEPS
    assert 0.99 * NAP * steps["count"] < steps["seconds"] <= wall
    assert fast["seconds"] < slow["seconds"]
    parts = [slow, fast, found["master"], found["profiler"]]
    assert sum(part["share"] for part in parts) == pytest.approx(1.0, abs=1e-6)
    assert not {"do_step", "entry_points", "set_inputs", "save"} & set(vars(network.instances[0]))
    stepping.close()


WAYS = {
    "jacobi": {"algorithm": "jacobi"},
    "gauss-seidel": {"algorithm": "gauss-seidel"},
    "strong": {"algorithm": "strong"},
    "python": {"compiled": False, "stop_time": 0.01},
    "strong-python": {"algorithm": "strong", "compiled": False, "stop_time": 0.01},
    "threads": {"threads": 2},
    "error": {"error_tolerance": 1e-2, "stop_time": 0.005},
}


@pytest.fixture(scope="module")
def lift() -> Any:
    with ec.load("lift").prepare() as simulation:
        yield simulation


@pytest.mark.parametrize("way", mostly_slow(list(WAYS), ["gauss-seidel", "strong", "threads", "error"]))
def test_runs_of_fmus(way: str, lift: ec.Simulation) -> None:
    """Same bits, shares that add up, and as many steps as the run has; the next run measures nothing."""
    options = {**SAME, **WAYS[way]}
    plain = lift.run(**options)
    result = lift.run(profile=True, **options)
    assert result.table is not None and plain.table is not None
    assert result.table.rows.tobytes() == plain.table.rows.tobytes()
    assert str(result.metrics) == str(plain.metrics)
    found = result.profile
    assert found is not None and result.record["profile"] == found
    assert plain.profile is None and "profile" not in plain.record
    steps = {n: row["calls"]["steps"]["count"] for n, row in found["fmus"].items()}
    if "error_tolerance" in options:
        tried = result.steps + result.stepping["rejected_steps"]
        assert set(steps.values()) == {3 * tried}  # a step, and two halves
    elif options.get("algorithm") == "strong":
        loops = result.stepping["sweeps_over_loops"]
        assert steps["lift.plant"] == steps["lift.controller"] == loops
        assert steps["lift.reference"] == result.steps
    else:
        assert set(steps.values()) == {result.steps}
        inputs = {n: row["calls"].get("inputs", {"count": 0})["count"] for n, row in found["fmus"].items()}
        assert inputs["lift.reference"] == 0 and inputs["lift.plant"] == result.steps
    parts = [*found["fmus"].values(), found["master"], found["profiler"], *found["recorders"].values()]
    assert sum(part["share"] for part in parts) == pytest.approx(1.0, abs=1e-6)
    assert found["total_s"] >= result.wall_s > 0.0
    assert {"metrics", "table"} <= set(found["recorders"])
    assert lift.run(**options).profile is None


def test_an_fmu_in_its_own_process_is_measured_there() -> None:
    options = {**SAME, "stop_time": 0.01}
    with ec.load("lift").prepare(isolate=["lift.plant"]) as simulation:
        plain, result = simulation.run(**options), simulation.run(profile=True, **options)
        again = simulation.run(profile=True, **options)
    assert result.table.rows.tobytes() == plain.table.rows.tobytes()  # type: ignore[union-attr]
    for found in (result.profile, again.profile):
        assert found is not None
        plant, observer = found["fmus"]["lift.plant"], found["fmus"]["lift.observer"]
        assert plant["separate_process"] and not observer["separate_process"]
        assert plant["calls"]["steps"]["count"] == result.steps
        assert 0.0 < plant["seconds"] < plant["waited_s"] == found["separate_processes"]["seconds"]
        assert found["separate_processes"]["seconds"] < found["total_s"]


class Slow(ec.Recorder):
    """Sleeps for each block of rows."""

    def write(self, rows: np.ndarray) -> None:
        time.sleep(0.05)


def test_recorders_are_measured_one_by_one(lift: ec.Simulation, tmp_path: Path) -> None:
    table = ec.CsvFile(tmp_path / "rows.csv")
    result = lift.run(profile=True, recorders=[table, Slow()], **SAME)
    assert result.profile is not None
    recorders = result.profile["recorders"]
    assert 0.05 <= recorders["Slow"]["seconds"] < result.profile["total_s"]
    assert 0.0 < recorders["table"]["seconds"] < 0.05 + recorders["Slow"]["seconds"]
    assert "write" not in vars(table)


def test_a_failed_run_has_a_profile_and_leaves_nothing_behind(lift: ec.Simulation) -> None:
    class Failing(ec.Recorder):
        def write(self, rows: np.ndarray) -> None:
            raise OSError(5, "broken")

    failing = Failing()
    failed = lift.attempt(profile=True, recorders=[failing], **SAME)
    assert failed.problem is not None and failed.profile is not None
    assert not vars(failing)
    with pytest.raises(ec.CommandError):
        lift.run(profile=True, order="nobody", **SAME)
    assert lift.run(**SAME).profile is None


def test_terminal_file_and_report_show_it(lift: ec.Simulation, tmp_path: Path) -> None:
    result = lift.run(profile=True, **SAME)
    assert result.profile is not None
    lines = str(result).splitlines()
    row = next(line for line in lines if "lift.plant" in line)
    assert f"{result.steps:,}" in row
    assert any("master" in line for line in lines)
    result.save(tmp_path, plots=False, report=True)
    assert json.loads((tmp_path / "run.json").read_text())["profile"] == result.profile
    page = (tmp_path / "report.html").read_text()
    assert "Where the time went" in page and "lift.controller" in page
    assert "Where the time went" not in str(lift.run(**SAME))
