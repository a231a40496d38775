"""Threads that share a step, and FMUs in other processes that step at once.

That they have the bits of one thread is shown in test_matrix.py and, for any schedule, in
test_stepper.py.
"""

import dataclasses
import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import polars
import pytest
from hypothesis import given

import emla_cosim as ec
from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.program import StepTask
from emla_cosim.master.algorithms.registry import GaussSeidel, Jacobi, Strong
from emla_cosim.master.instances.fmu_instance import InstanceError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.run_loop import simulate
from emla_cosim.master.stepping import lanes as choice
from emla_cosim.master.stepping.lanes import ThreadSchedule, schedule_tasks
from emla_cosim.master.stepping.step_size_control import FixedSteps
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.run.stepping_options import read_threads
from emla_cosim.stepper.layout import Failure
from emla_cosim.stepper.library import load_stepper
from tests.support.ctrl_c import interrupt_steps
from tests.support.faulty_systems import line_with_a_fault, open_system
from tests.support.hand_written_fmus import Fault
from tests.support.lanes import in_lanes
from tests.support.simulated import Table, begun, recorded
from tests.support.slaves import FakeSlave, compilable

TIMES = make_communication_points(1.0, 0.125)
Advance = Callable[[np.ndarray, np.ndarray, float, float], Any]


def mix(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
    """A step that mixes all inputs into the state."""
    return 0.9 * x + step * (np.sin(time) + u.sum())


def chains(count: int, links: Sequence[tuple[int, int]], advance: Advance = mix) -> Network:
    """Slaves s0, s1, ... with one output each, the input of every link the next one of its target."""
    inputs = Counter(target for _, target in links)
    slaves = [FakeSlave(f"s{i}", inputs[i], [0.1 * i], advance) for i in range(count)]
    used = Counter[int]()
    wires = []
    for source, target in links:
        wires.append(Link(source, 0, target, used[target], False))
        used[target] += 1
    return Network([compilable(slave) for slave in slaves], wires)


def work_of(algorithm: Algorithm, network: Network) -> list[StepTask]:
    algorithm.setup(network)
    return algorithm.tasks()


# ---- who does what -----------------------------------------------------------------------------


def simulated_length(
    work: Sequence[StepTask], costs: Sequence[float], lanes: Sequence[Sequence[int]]
) -> float:
    """How long a step is, worked out from what each lane waits for; fails where lanes wait for each other."""
    through = dict[int, float]()
    at, now = [0] * len(lanes), [0.0] * len(lanes)
    while len(through) < len(work):
        before = len(through)
        for lane, tasks in enumerate(lanes):
            while at[lane] < len(tasks) and through.keys() >= set(work[tasks[at[lane]]].after):
                task = work[tasks[at[lane]]]
                begin = max([now[lane], *(through[p] for p in task.after)])
                now[lane] = begin + (sum(costs[i] for i in task.instances) if task.steps else 0.0)
                through[tasks[at[lane]]] = now[lane]
                at[lane] += 1
        assert len(through) > before, "lanes wait for each other"
    return max(now)


def lane_of(work: Sequence[StepTask], placement: ThreadSchedule) -> dict[int, set[int]]:
    """The lanes in which each slave is called."""
    lanes_by_slave: dict[int, set[int]] = {}
    for lane, tasks in enumerate(placement.lanes):
        for task in tasks:
            for i in work[task].instances:
                lanes_by_slave.setdefault(i, set()).add(lane)
    return lanes_by_slave


@given(st.data())
def test_lanes_never_wait_for_each_other(data: st.DataObject) -> None:
    """Every task is in one lane, each slave in one, and a step is as long as was said."""
    count = data.draw(st.integers(1, 7))
    numbers = st.integers(0, count - 1)
    links = data.draw(st.lists(st.tuples(numbers, numbers), max_size=12, unique=True))
    kind = data.draw(st.sampled_from([Jacobi, GaussSeidel, Strong]))
    costs = data.draw(st.lists(st.sampled_from([0.0, 1.0, 2.5, 7.0]), min_size=count, max_size=count))
    exclusive = data.draw(st.sets(numbers))
    work = work_of(kind(), chains(count, links))
    lanes = data.draw(st.integers(1, 4))
    placement = schedule_tasks(work, costs, lanes, exclusive)
    assert sorted(p for lane in placement.lanes for p in lane) == list(range(len(work)))
    where = lane_of(work, placement)
    assert all(len(slave_lanes) == 1 for slave_lanes in where.values())
    with_them = {i for task in work if exclusive & set(task.instances) for i in task.instances}
    assert all(where[i] == {0} for i in with_them)
    assert simulated_length(work, costs, placement.lanes) <= placement.length + 1e-9
    assert max(costs) <= placement.length <= sum(costs)


# ---- failures ----------------------------------------------------------------------------------


def failing(times: dict[str, float]) -> Network:
    """Return six slaves in three pairs; those that are named refuse the step at a time in s."""
    network = chains(6, [(0, 1), (2, 3), (4, 5)])

    def fail_at(name: str, at: float) -> Advance:
        def advance(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
            if time >= at:
                raise InstanceError(name, f"doStep at t = {time:.9g} s", "fmi2Error", [])
            return mix(u, x, time, step)

        return advance

    for slave in network.instances:
        assert isinstance(slave, FakeSlave)
        slave._advance = fail_at(slave.name, times.get(slave.name, np.inf))
        slave.error = lambda call, answer, name=slave.name: InstanceError(name, call, "fmi2Error", [])
    return network


def ended(network: Network, algorithm: Algorithm, seed: int | None) -> tuple[str, bytes]:
    """Return the error message that ends a run, and its rows; threads share it by `seed`."""
    stepping = FixedSteps(begun(network, algorithm, TIMES), TIMES)
    if seed is not None:
        in_lanes(stepping, seed)
    table = Table(1 + len(network.signals))
    with pytest.raises(ec.RunError) as caught:
        simulate(stepping, table)
    stepping.close()
    assert stepping.steps == len(table.rows)
    return str(caught.value), table.rows.tobytes()


@pytest.mark.parametrize("kind", [Jacobi, GaussSeidel, Strong])
@pytest.mark.parametrize("times", [{"s1": 0.5, "s4": 0.5}, {"s5": 0.25, "s0": 0.375}], ids=str)
def test_first_failure_is_reported_from_any_thread(times: dict[str, float], kind: type[Algorithm]) -> None:
    """The error message, and the rows before it, are those of one thread."""
    expected = ended(failing(times), kind(), None)
    for seed in range(3):
        assert ended(failing(times), kind(), seed) == expected


def test_threads_that_cannot_be_used_end_a_run_that_requests_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a request, the run continues in one thread, and reports why."""
    no_threads = dataclasses.replace(load_stepper(), start_lanes=lambda *_: None)
    monkeypatch.setattr("emla_cosim.stepper.library.require_stepper", lambda: no_threads)
    monkeypatch.setattr(choice, "count_cores", lambda: 2)
    words = "the system cannot start 2 threads for FMUs. Set fewer threads."
    times = make_communication_points(60.0, 1.0)
    automatic, two = (
        FixedSteps(begun(chains(2, [], slow(1e-3)), Jacobi(), times), times, threads=threads)
        for threads in (None, 2)
    )
    recorded(automatic)
    assert automatic.steps == 60 and automatic.report()["threads"] == 1
    assert automatic.report()["why_one_thread"] == words
    with pytest.raises(ec.RunError, match=words):
        recorded(two)


@pytest.mark.parametrize("threads", [0, -1, 33])
def test_impossible_numbers_of_threads_are_refused(threads: int) -> None:
    with pytest.raises(ec.CommandError, match=f"^the number of threads must be from 1 to .*, not {threads}"):
        FixedSteps(begun(chains(1, []), Jacobi(), TIMES), TIMES, threads=threads)


def test_number_of_threads_is_read_from_text() -> None:
    assert [read_threads(text) for text in ("auto", "2")] == [None, 2]
    for text in ("many", "1.5", "AUTO"):
        with pytest.raises(ec.CommandError, match=f"--threads {text} is neither a whole number nor auto"):
            read_threads(text)


# ---- found out by measuring --------------------------------------------------------------------


def test_light_steps_stay_in_one_thread_unless_more_are_requested(fmu_folder: Path) -> None:
    with ec.load("study", fmus=fmu_folder, stop_time=0.02, output_interval=1e-4).prepare() as simulation:
        automatic, requested = simulation.run(), simulation.run(threads=3)
        components = [c.name for c in simulation.system.components]
    assert automatic.stepping["threads"] == 1 and "lanes" not in automatic.stepping
    assert requested.stepping["threads"] == 3
    lanes = requested.stepping["lanes"]
    assert sorted(name for lane in lanes for name in lane) == sorted(components)
    assert requested.to_polars().equals(automatic.to_polars())


def slow(seconds: float) -> Advance:
    def advance(u: np.ndarray, x: np.ndarray, at: float, step: float) -> Any:
        time.sleep(seconds)  # which lets other threads continue
        return mix(u, x, at, step)

    return advance


@pytest.mark.parametrize("kind", [Jacobi, GaussSeidel])
def test_heavy_steps_are_tried_in_threads(kind: type[Algorithm], monkeypatch: pytest.MonkeyPatch) -> None:
    """Two chains that need nothing of each other; how fast they are is up to the machine."""
    monkeypatch.setattr(choice, "count_cores", lambda: 2)
    times = make_communication_points(100.0, 1.0)
    links = [(0, 1), (2, 3)]
    expected = recorded(FixedSteps(begun(chains(4, links), kind(), times), times))
    stepping = FixedSteps(begun(chains(4, links, slow(4e-3)), kind(), times), times, threads=None)
    actual = recorded(stepping)
    report = stepping.report()
    assert actual.tobytes() == expected.tobytes()
    assert sorted(name for lane in report["lanes"] for name in lane) == ["s0", "s1", "s2", "s3"]
    assert all(report["lanes"]) and report["threads"] in (1, 2)
    assert min(report[f"{x}_us"] for x in ("step_in_threads", "step_in_one_thread")) > 0.0


# ---- FMUs that do not run beside others --------------------------------------------------------


def test_fmus_of_one_interpreter_share_a_thread(python_fmu_folder: Path) -> None:
    results = [
        ec.load("lift", flavour="python", fmus=python_fmu_folder, stop_time=2e-3, output_interval=1e-4)
        .prepare()
        .run(threads=threads)
        for threads in (1, 3)
    ]
    assert results[1].to_polars().equals(results[0].to_polars())
    (lane,) = results[1].stepping["lanes"]
    assert sorted(lane) == sorted(c.name for c in ec.load("lift").system.components)
    assert results[1].stepping["threads"] == 1


def test_components_that_python_calls_are_in_the_first_lane(faulty_fmu: Path) -> None:
    """The last of three is isolated; the others may run beside it."""
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    options = {"stop_time": 2.0, "step_size": 0.1, "algorithm": "jacobi"}
    with ec.load(system, **options).prepare(isolate=["j.sink"]) as simulation:
        single, shared = (simulation.run(threads=threads) for threads in (1, 2))
    assert shared.to_polars().equals(single.to_polars())
    first, second = shared.stepping["lanes"]
    assert "j.sink" in first and {*first, *second} == {"j.source", "j.bad", "j.sink"}


class Averaged(ec.Explicit):
    """An algorithm that passes on the mean of the present and the previous signals."""

    def table(self, network: Network) -> Sequence[ec.Operation | ec.Combine]:
        slaves = range(len(network.instances))
        return [
            *(ec.Combine(i, "mean", {"signals": 0.5, "previous": 0.5}) for i in slaves),
            *(ec.Operation(ec.Call.SET, i, store="mean") for i in slaves),
            *(ec.Operation(call, i) for call in (ec.Call.STEP, ec.Call.GET) for i in slaves),
        ]

    def late(self) -> list[Link]:
        return self.network.links


@pytest.mark.parametrize(
    ("algorithm", "isolate", "reason"),
    [
        (Averaged(), False, "the program of the algorithm combines vectors"),
        ("jacobi", True, "FMUs in other processes already step at the same time"),
    ],
)
def test_systems_whose_steps_threads_cannot_share(
    algorithm: Any, isolate: bool, reason: str, faulty_fmu: Path
) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    with ec.load(system, stop_time=1.0, step_size=0.1).prepare(isolate=isolate) as simulation:
        stepping = simulation.run(algorithm=algorithm, threads=2).stepping
    assert stepping["threads"] == 1 and stepping["why_one_thread"].startswith(reason)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals.")
def test_ctrl_c_ends_lanes_after_the_present_step(faulty_fmu: Path) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    options = {"step_size": 0.1, "algorithm": "jacobi"}
    with pytest.MonkeyPatch.context() as patch, ec.load(system, **options).prepare() as simulation:
        ends = interrupt_steps(patch, lambda loop: loop.is_shared)
        result = simulation.attempt(threads=3, stop_time=1e6, recorders=[])
    assert result.interrupted
    assert ends[-1] == Failure.INTERRUPTED


@pytest.mark.slow
def test_crashed_fmu_is_among_the_named_ones(faulty_fmu: Path, tmp_path: Path) -> None:
    """Which of several threads it was cannot be known from outside."""
    system = line_with_a_fault(faulty_fmu, Fault.SEGFAULT, 0.35)
    package = ec.load(system, stop_time=1.0, step_size=0.01).export(tmp_path / "line.ssp")
    words = ("--algorithm", "jacobi", "--threads", "2", "--no-plots", "--output", tmp_path / "out")
    command = [sys.executable, "-m", "emla_cosim", "run", *map(str, (package, *words))]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 1
    status = json.loads((tmp_path / "out/run.json").read_text())["status"]
    assert re.search(r"j\.bad (in|ended the process in) doStep at t = 0\.3[45] s.* \(SIGSEGV\)", status), (
        status
    )
    assert len(polars.read_csv(tmp_path / "out/results.csv")) in (35, 36)


# ---- FMUs in processes of their own ------------------------------------------------------------


class OverlappingSlave(FakeSlave):
    """A slave whose steps are done when they are ended; `calls` says so."""

    steps_apart = True

    def begin_step(self, time: float, step: float) -> None:
        self.calls.append(f"{self.name}.begin")
        self._begun, self.is_under_way = (time, step), True

    def end_step(self) -> None:
        self.is_under_way = False
        self.do_step(*self._begun)


def with_steps_apart(network: Network, calls: list[str]) -> Network:
    for slave in network.instances:
        slave.__class__ = OverlappingSlave
        vars(slave)["calls"] = calls
        del vars(slave)["entry_points"], vars(slave)["forget"]  # they are called from Python
    return network


@pytest.mark.parametrize("kind", [Jacobi, partial(GaussSeidel, order=["s0", "s1", "s2", "s3"])])
def test_overlapped_steps_change_no_bits(kind: Callable[[], Algorithm]) -> None:
    calls: list[str] = []
    links = [(0, 1), (2, 3), (3, 0)]
    expected = recorded(FixedSteps(begun(chains(4, links), kind(), TIMES), TIMES))
    network = with_steps_apart(chains(4, links), calls)
    actual = recorded(FixedSteps(begun(network, kind(), TIMES), TIMES))
    assert actual.tobytes() == expected.tobytes()
    begun_at_once = calls[calls.index("s0.begin") : calls.index("s0.step")]
    free = ["s0", "s1", "s2", "s3"] if kind is Jacobi else ["s0", "s2"]
    assert {f"{name}.begin" for name in free} == {x for x in begun_at_once if x.endswith("begin")}


def test_overlapped_steps_of_a_loop_change_no_bits() -> None:
    calls: list[str] = []
    links = [(0, 1), (0, 2), (0, 3), (1, 0), (2, 0), (3, 0)]
    in_turn, overlapping = (Strong(order=["s1", "s2", "s3", "s0"]) for _ in range(2))
    expected = recorded(FixedSteps(begun(chains(4, links), in_turn, TIMES), TIMES))
    network = with_steps_apart(chains(4, links), calls)
    actual = recorded(FixedSteps(begun(network, overlapping, TIMES), TIMES))
    assert actual.tobytes() == expected.tobytes()
    assert overlapping.sweeps == in_turn.sweeps > len(actual)
    steps = [call for call in calls if call.endswith((".begin", ".step"))]
    sweep = [f"s{i}.{call}" for call in ("begin", "step") for i in (1, 2, 3)] + ["s0.begin", "s0.step"]
    assert steps == sweep * overlapping.sweeps


def test_failed_overlapped_step_of_a_loop_ends_the_run_after_the_other_steps() -> None:
    calls: list[str] = []

    def advance(u: np.ndarray, x: np.ndarray, t: float, h: float) -> Sequence[float]:
        if len(u) == 1 and t > 0.4 and x[0] > 0.0:  # the one that began at 0.1
            raise ec.RunError("it failed")
        return x

    links = [(0, 1), (0, 2), (1, 0), (2, 0)]
    slaves = with_steps_apart(chains(3, links, advance), calls)
    stepping = FixedSteps(begun(slaves, Strong(order=["s1", "s2", "s0"]), TIMES), TIMES)
    with pytest.raises(ec.RunError, match="it failed"):
        simulate(stepping, Table(1 + len(slaves.signals)))
    count = Counter(calls)
    assert all(count[f"s{i}.begin"] == count[f"s{i}.step"] for i in range(3))
    assert count["s1.step"] == count["s2.step"] == count["s0.step"] + 1


@pytest.mark.parametrize("kind", [Jacobi, GaussSeidel])
@pytest.mark.parametrize("times", [{"s1": 0.5, "s4": 0.5}], ids=str)
def test_failure_of_an_overlapped_step_ends_the_run(times: dict[str, float], kind: type[Algorithm]) -> None:
    expected = ended(failing(times), kind(), None)
    calls: list[str] = []
    network = with_steps_apart(failing(times), calls)
    stepping = FixedSteps(begun(network, kind(), TIMES), TIMES)
    table = Table(1 + len(network.signals))
    with pytest.raises(ec.RunError) as caught:
        simulate(stepping, table)
    assert (str(caught.value), table.rows.tobytes()) == expected
    count = Counter(calls)
    assert all(count[f"s{i}.begin"] == count[f"s{i}.step"] for i in range(6))


@pytest.mark.slow
def test_isolated_fmu_that_fails_beside_others_leaves_them_usable(faulty_fmu: Path) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.ERROR, 0.35)
    options = {"stop_time": 1.0, "step_size": 0.1, "algorithm": "jacobi"}
    with ec.load(system, **options).prepare(isolate=True) as simulation:
        for _ in range(2):
            with pytest.raises(ec.RunError, match=r"j\.bad answered doStep at t = 0\.3 s with fmi2Error"):
                simulation.run()
        without_fault = simulation.run(set={"j.bad.fault": Fault.NONE.value})
        assert without_fault.time[-1] == 1.0
    with open_system(system) as assembly:
        assert len(assembly.instances) == 3
