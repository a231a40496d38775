"""Loops of slaves in compiled code: the bits, the errors and the memory of the Python path."""

import ctypes
import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.base.errors import RunError
from emla_cosim.fmu.models import fmu_path
from emla_cosim.master.algorithms.group import loop_derivatives
from emla_cosim.master.algorithms.quasi_newton import QuasiNewton
from emla_cosim.master.algorithms.strong import HALVINGS, Strong
from emla_cosim.master.instances.fmu_instance import DiscardedStepError, InstanceError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.run_loop import simulate
from emla_cosim.master.stepping.fixed_steps import FixedSteps
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.study.loading import load
from tests.support.faulty_fmu import Fault
from tests.support.faulty_systems import counts_of, faulty, loop_with_a_fault, open_system, wired
from tests.support.lanes import in_lanes
from tests.support.linear import LinearSlave, connected
from tests.support.simulated import Table, begun, recorded
from tests.support.slaves import FakeSlave, compilable, fmu_slave
from tests.support.tiers import mostly_slow
from tests.support.two_masses import elastic_load, rigid_load

Build = Callable[[], Network]
TIMES = make_communication_points(1.0, 1.0 / 32.0)
WAYS = pytest.mark.parametrize("extrapolation", ["none", "master", "fmu"])


class Doubtful(LinearSlave):
    """Discards steps longer than `longest` in s that end in the time from `begin` to `end` in s."""

    longest, begin, end = np.inf, 0.0, np.inf

    def do_step(self, time: float, step: float) -> None:
        if step > self.longest and self.begin < time + step < self.end:
            raise DiscardedStepError(self.name, f"doStep at t = {time:g} s", "fmi2Discard", [])
        super().do_step(time, step)


def linear(part: Callable[[], tuple], longest: float = np.inf, who: int = -1) -> Build:
    """The slaves of a part, one of them doubtful from 0.3 s to 0.6 s."""

    def build() -> Network:
        slaves, wires = part()
        slaves = [Doubtful(s.name, s.A, s.B, s.C, s.D, s.x_0) for s in slaves]
        slaves[who].longest, slaves[who].begin, slaves[who].end = longest, 0.3, 0.6
        return connected([compilable(slave) for slave in slaves], wires)

    return build


def lag(name: str, feedthrough: list[list[float]], x: float) -> LinearSlave:
    outputs, inputs = np.shape(feedthrough)
    return LinearSlave(name, [[-2.0]], np.ones(inputs), np.ones(outputs), feedthrough, [x])


def two_loops() -> tuple:
    """Of two signals, and of one that reads the first; and a slave before and one behind."""
    slaves = [
        lag("sink", [[1.0]], 0.5),
        lag("a", [[1.5, -4.0], [3.0, 2.5]], 1.0),
        lag("b", [[2.0, 1.0], [-1.0, 3.0]], -1.0),
        LinearSlave("source", [[-1.0]], [], [1.0], np.empty((1, 0)), [1.0]),
        lag("c", [[1.0, 5.0]], 2.0),
        lag("d", [[1.0]], 0.25),
    ]
    inside = [(2, 0, 1, 0), (2, 1, 1, 1), (1, 0, 2, 0), (1, 1, 2, 1)]
    return slaves, [*inside, (5, 0, 0, 0), (3, 0, 4, 0), (5, 0, 4, 1), (4, 0, 5, 0)]


def swinging() -> Network:
    """A nonlinear loop: x = 3 cos(y) + t, y = 2 sin(x) - 1, which needs many sweeps in each step."""
    a = FakeSlave("a", 1, [3.0], lambda u, x, t, h: 3.0 * np.cos(u) + t + h)
    b = FakeSlave("b", 1, [0.0], lambda u, x, t, h: 2.0 * np.sin(u) - 1.0)
    links = [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)]
    return Network([compilable(a), compilable(b)], links)


def stubborn() -> Network:
    """A loop without a solution for steps that are longer than 0.01 s and begin at 0.5 s."""

    def answer(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        return u + 1.0 if step > 0.01 and time == 0.5 else 1.0 - 0.5 * u

    a = FakeSlave("a", 1, [0.0], answer)
    b = FakeSlave("b", 1, [0.0], lambda u, x, t, h: u)
    links = [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)]
    return Network([compilable(a), compilable(b)], links)


def late_refusal() -> Network:
    """A loop with the solution 10 t^2 whose slave discards long steps from 0.3 s to 0.6 s, but only near it.

    Then something has been learned of the loop in the step that is to be forgotten.
    """

    def answer(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        off = u - 10.0 * (time + step) ** 2
        if step > 0.02 and 0.3 < time + step < 0.6 and abs(off[0]) < 1e-6:
            raise DiscardedStepError("a", f"doStep at t = {time:g} s", "fmi2Discard", [])
        return u - 3.0 * off - 5.0 * off * off

    a = FakeSlave("a", 1, [0.0], answer)
    b = FakeSlave("b", 1, [0.0], lambda u, x, t, h: u)
    links = [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)]
    return Network([compilable(a), compilable(b)], links)


def stepped(
    build: Build,
    algorithm: Strong,
    compiled: bool,
    interrupted: Callable[[], bool] = lambda: False,
    shared: int | None = None,
) -> tuple[np.ndarray, dict[str, np.ndarray], int]:
    """All rows of a run, what it remembers in the end, and what the slaves keep of compiled code.

    `shared` is the seed by which threads share the steps.
    """
    network = build()
    stepping = FixedSteps(begun(network, algorithm, TIMES), TIMES, compiled)
    assert stepping.is_compiled == compiled
    if shared is not None:
        in_lanes(stepping, shared)
    rows = recorded(stepping, interrupted=interrupted)
    return rows, stepping.memory(), sum(len(getattr(s, "states", ())) for s in network.instances)


MACHINE = ["lift.plant", "tilt.plant", "telescope.plant"]


def same(found: np.ndarray, expected: np.ndarray) -> bool:
    return found.shape == expected.shape and found.tobytes() == expected.tobytes()


NETWORKS: dict[str, Build] = {
    "rigid load": linear(lambda: rigid_load(1.5)),
    "elastic load": linear(elastic_load),
    "two loops": linear(two_loops),
    "nonlinear": swinging,
    "halved, the last slave": linear(lambda: rigid_load(100.0), 0.01),
    "halved, the first slave": linear(lambda: rigid_load(100.0), 0.01, 0),
    "halved, in a second loop": linear(two_loops, 0.01, 4),
    "halved, behind the loops": linear(two_loops, 0.01, 0),
    "halved for want of agreement": stubborn,
    "halved after some sweeps": late_refusal,
}


THREADS = pytest.mark.parametrize("shared", mostly_slow([None, 1, 2], [None, 1]))
"""The seeds by which threads share the steps; None is one thread alone."""


@THREADS
@WAYS
@pytest.mark.parametrize("name", NETWORKS)
def test_compiled_loops_have_the_bits_of_python(name: str, extrapolation: str, shared: int | None) -> None:
    """Rows, history, sizes of signals, Jacobians, and the number of sweeps."""
    build = NETWORKS[name]
    expected, memory, _ = stepped(build, Strong(extrapolation), False)
    found, compiled_memory, left = stepped(build, Strong(extrapolation), True, shared=shared)
    assert len(expected) == TIMES.steps + 1
    assert np.isfinite(expected).all() and np.ptp(expected, axis=0).any()
    assert same(found, expected)
    assert memory.keys() == compiled_memory.keys()
    for key, value in memory.items():
        assert same(compiled_memory[key], value), key
    assert memory["sweeps"][0] > TIMES.steps
    assert left == 0  # states that were not freed


@THREADS
@pytest.mark.parametrize("halved", [False, True])
def test_sampled_slaves_beside_a_loop_have_the_bits_of_python(halved: bool, shared: int | None) -> None:
    """Also the lines of their inputs, where the loop's step is done in halves."""
    build = linear(two_loops, 0.01 if halved else np.inf, 1)
    for multiples in ({"sink": 1}, {"sink": 3, "d": 2}):
        expected, memory, _ = stepped(build, Strong("fmu", multiples), False)
        found, compiled_memory, _ = stepped(build, Strong("fmu", multiples), True, shared=shared)
        assert same(found, expected)
        assert all(same(compiled_memory[key], value) for key, value in memory.items())


def test_an_interruption_between_two_blocks_changes_nothing() -> None:
    build = linear(two_loops, 0.01)
    expected, *_ = stepped(build, Strong("fmu"), False)
    stepping = FixedSteps(begun(build(), Strong("fmu"), TIMES), TIMES)
    table = Table(expected.shape[1], room=3)
    stepping.record(table)
    while not stepping.finished:  # interrupted after each block
        stops = itertools.chain([False], itertools.repeat(True))
        simulate(stepping, table, lambda stops=stops: next(stops))
    assert same(table.rows, expected)


@pytest.mark.parametrize("at", [7, 11, 15])
def test_python_and_compiled_code_take_over_from_each_other(at: int) -> None:
    """As with a checkpoint: before, between and after the steps that are done in halves."""
    build = linear(two_loops, 0.01, 2)
    expected, *_ = stepped(build, Strong("fmu"), False)
    for compiled in (False, True):
        network, table = build(), Table(expected.shape[1])
        before = FixedSteps(begun(network, Strong("fmu"), TIMES), TIMES, compiled)
        before.record(table)
        while before.steps < at:
            before.advance(table, at - before.steps)
        memory = {name: value.copy() for name, value in before.memory().items()}
        before.close()
        before.algorithm.close()
        algorithm = Strong("fmu")
        algorithm.setup(network)
        after = FixedSteps(algorithm, TIMES, not compiled)
        after.remember(memory)
        while not after.finished:
            after.advance(table, TIMES.steps)
        after.close()
        assert same(table.rows, expected)


# ---- errors ------------------------------------------------------------------------------------


def sentence(build: Build, compiled: bool, shared: int | None = None) -> tuple[str, int]:
    """What ends a run, and after how many rows."""
    algorithm, table = begun(build(), Strong(), TIMES), None
    stepping = FixedSteps(algorithm, TIMES, compiled)
    assert stepping.is_compiled == compiled
    if shared is not None:
        in_lanes(stepping, shared)
    table = Table(1 + len(algorithm.network.signals))
    with pytest.raises(RunError) as caught:
        simulate(stepping, table)
    stepping.close()
    algorithm.close()
    assert all(not getattr(s, "states", ()) for s in algorithm.network.instances)
    assert stepping.steps == len(table.rows)
    return str(caught.value), len(table.rows)


def pair(answer: Callable[[np.ndarray, float], Any]) -> Build:
    """a answers b's output; b passes it back."""

    def build() -> Network:
        a = FakeSlave("a", 1, [0.0], lambda u, x, t, h: answer(u, t))
        b = FakeSlave("b", 1, [0.0], lambda u, x, t, h: u)
        return Network([compilable(a), compilable(b)], [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)])

    return build


def refusing(error: type[InstanceError], status: str, rolls_back: bool = True) -> Build:
    """A slave that refuses every step from 0.5 s on, in front of a loop."""

    def moved(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        if time >= 0.5:
            raise error("s", f"doStep at t = {time:.9g} s", status, [])
        return x + step

    def build() -> Network:
        slave = FakeSlave("s", 0, [0.0], moved)
        slave.rolls_back = rolls_back
        slave.error = lambda call, answer: error("s", call, status, [])
        rest = pair(lambda u, t: 1.0 - 0.5 * u)()
        links = [replace(link, source=link.source + 1, target=link.target + 1) for link in rest.links]
        return Network([compilable(slave), *rest.instances], links)

    return build


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            pair(lambda u, t: u + (t >= 0.5)),
            f"does not converge on the step from t = 0.5 s of {2**-15:.3g} s",
        ),
        (pair(lambda u, t: u + (t > 0.0)), "does not converge on the step from t = "),
        (
            pair(lambda u, t: u * np.nan if t >= 0.5 else 0.5 * u),
            "b[0] is infinite or NaN on the step from t = 0.5",
        ),
        (refusing(DiscardedStepError, "fmi2Discard"), "s answered doStep at t = 0.5 s with fmi2Discard."),
        (refusing(DiscardedStepError, "fmi2Discard", False), "s answered doStep at t = 0.5 s with fmi2Disc"),
        (refusing(InstanceError, "fmi2Error"), "s answered doStep at t = 0.5 s with fmi2Error."),
    ],
    ids=["no agreement", "later", "no number", "discarded", "discarded, no way back", "refused"],
)
def test_what_ends_a_run_is_the_same_sentence(build: Build, words: str) -> None:
    assert HALVINGS == 10  # 2^-5 s are halved to 2^-15 s
    expected = sentence(build, False)
    assert words in expected[0]
    assert sentence(build, True) == expected
    assert all(sentence(build, True, seed) == expected for seed in (1, 2))


@pytest.mark.parametrize(
    ("function", "call"),
    [
        ("set_real", "setReal"),
        ("set_real_input_derivatives", "setRealInputDerivatives"),
        ("do_step", "doStep at t = 0.03125 s"),
        ("get_real", "getReal"),
        ("get_state", "getFMUstate"),
        ("set_state", "setFMUstate"),
    ],
)
def test_a_function_that_fails_in_a_loop_is_named(function: str, call: str) -> None:
    """It fails after the first step."""
    network = linear(lambda: rigid_load(1.5))()
    algorithm, slave = begun(network, Strong("fmu"), TIMES), network.instances[1]
    points, original = slave.entry_points(), slave.entry_points
    assert points is not None
    prototype = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 3, ctypes.c_void_p)
    if function == "do_step":
        prototype = ctypes.CFUNCTYPE(
            ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int
        )
    if function == "set_real_input_derivatives":
        prototype = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 5)
    real = prototype(getattr(points, function))
    answer = prototype(lambda *arguments: 4 if algorithm.steps else real(*arguments))
    changed = replace(points, **{function: ctypes.cast(answer, ctypes.c_void_p).value})
    slave.entry_points = lambda alive=(answer, original): changed
    stepping, table = FixedSteps(algorithm, TIMES), Table(1 + len(network.signals))
    stepping.advance(table, 1)
    with pytest.raises(InstanceError) as caught:
        stepping.advance(table, 5)
    assert str(caught.value) == f"load answered {call} with status 4."
    assert stepping.steps == len(table.rows) == 1
    stepping.close()


# ---- FMUs --------------------------------------------------------------------------------------


def test_the_machine_has_the_bits_of_python(fmu_folder: Path) -> None:
    """Thirteen FMUs, three forces to agree on, and controllers that sample."""
    with load("hdrm-coupled").prepare(fmus=fmu_folder, output_interval=1e-4) as machine:
        for extrapolation in ("none", "fmu"):
            expected, found = (
                machine.run(stop_time=0.01, extrapolation=extrapolation, compiled=compiled)
                for compiled in (False, True)
            )
            assert [r.stepping["compiled"] for r in (expected, found)] == [False, True]
            assert expected.stepping["loops"] == [[*MACHINE, "machine.manipulator"]]
            assert found.stepping["sweeps_over_loops"] == expected.stepping["sweeps_over_loops"] > 200
            assert len(found["time"]) == 101
            assert all(same(found[name], expected[name]) for name in expected.names)


def test_saved_states_are_freed_and_only_kept_where_they_serve(faulty_fmu: Path) -> None:
    """Those of the loop and of who may have to do halves; none of a sampled FMU."""
    system = loop_with_a_fault(faulty_fmu, Fault.DISCARD, 0.75)
    system = wired(
        [*system.components, faulty("j.sampled", faulty_fmu)],
        *map(str, system.connections),
        "j.bad.y -> j.sampled.u",
    )
    for compiled in (False, True):
        with open_system(system) as assembly:
            (counts,) = counts_of(assembly)
            algorithm = begun(assembly.network, Strong(step_multiples={"j.sampled": 2}), TIMES)
            stepping = FixedSteps(algorithm, TIMES, compiled)
            assert stepping.is_compiled == compiled
            table = Table(1 + len(assembly.network.signals))
            stepping.advance(table, 5)
            assert counts.states == 3
            with pytest.raises(DiscardedStepError, match=r"j.bad .* t = 0.75 s"):
                simulate(stepping, table)
            assert stepping.steps == 24
            stepping.close()
            algorithm.close()
            assert counts.states == 0
            assert counts.rollbacks > 0


def test_directional_derivatives_of_an_fmu_are_those_of_its_outputs(fmu_folder: Path) -> None:
    """Against differences in initialization mode, where outputs follow inputs."""
    path = fmu_path("EmlaPlant", "native", fmu_folder)
    inputs, outputs = ["u_q", "F_L", "d_2"], ["a_L", "v_L", "tau_m"]
    with fmu_slave(path, inputs, outputs) as slave:
        assert slave.differentiates
        slave.enter_initialization(0.0, 1.0)
        at, direction = np.array([20.0, 1e4, 0.1]), np.array([3.0, 500.0, 0.2])
        found = []
        for side in (-1.0, 1.0):
            slave.inputs[:] = at + side * direction
            slave.set_inputs()
            slave.get_outputs()
            found.append(slave.outputs.copy())
        differences = 0.5 * (found[1] - found[0])
        assert differences[0] != 0.0
        assert slave.directional_derivative(direction) == pytest.approx(differences, rel=1e-9, abs=1e-12)


class Telling(LinearSlave):
    """Tells what its outputs make of its inputs at once."""

    differentiates = True

    def directional_derivative(self, direction: np.ndarray) -> np.ndarray | None:
        return self.D @ direction


@WAYS
def test_what_slaves_tell_of_their_derivatives_spares_sweeps(extrapolation: str) -> None:
    """With them the first step takes two sweeps of each loop, if it is too short for states to count."""
    tried = []
    for kind in (Telling, LinearSlave):
        slaves, wires = two_loops()
        slaves = [kind(s.name, s.A, s.B, s.C, s.D, s.x_0) for s in slaves]
        short = make_communication_points(1e-12, 1e-12)
        algorithm = begun(connected(slaves, wires), Strong(extrapolation), short)
        algorithm.network.signals[:] += 1.0  # so that there is something to agree on
        algorithm.step(0.0, 1e-12)
        tried.append(algorithm.sweeps)
    assert tried[0] == 2 * 2
    assert tried[1] >= tried[0] + 3  # one value of a loop costs a sweep to learn


def test_derivatives_of_a_loop_are_those_of_its_answer() -> None:
    """With factors of units, and where inputs take the middle of their lines."""
    slaves, _ = two_loops()
    a, b = (Telling(s.name, s.A, s.B, s.C, s.D, s.x_0) for s in slaves[1:3])
    a.interpolates = False
    links = [Link(1, 0, 0, 0, True, True, 2.0, 1.0), Link(1, 1, 0, 1, True, True, -3.0)]
    links += [Link(0, 0, 1, 0, True), Link(0, 1, 1, 1, True, True, 0.5)]
    algorithm = begun(Network([a, b], links), Strong("fmu"), TIMES)
    (group,) = algorithm.groups
    assert group.coupling_variables.tolist() == [2, 3]
    first = 0.5 * np.array([[1.5, -4.0], [3.0, 2.5]]) @ np.diag([2.0, -3.0])
    expected = np.array([[2.0, 1.0], [-1.0, 3.0]]) @ np.diag([1.0, 0.5]) @ first
    found = loop_derivatives(algorithm.exchange, group)
    assert found == pytest.approx(expected, rel=1e-14)
    inverse = expected @ np.linalg.inv(expected - np.eye(2))
    assert group.newton.jacobian == pytest.approx(inverse, rel=1e-12)
    b.differentiates = False
    assert loop_derivatives(algorithm.exchange, group) is None


def test_derivatives_that_nothing_can_be_made_of_are_left_out() -> None:
    """Of x = x, which has no solution or many, and infinite ones."""
    newton = QuasiNewton(1)
    unknown = newton.jacobian.copy()
    newton.forget(np.array([[3.0]]))
    assert newton.jacobian == pytest.approx(np.array([[1.5]]))
    for derivative in (1.0, np.inf, np.nan):
        newton.forget(np.array([[derivative]]))
        assert (newton.jacobian == unknown).all()


def test_a_slave_that_cannot_tell_its_derivatives_here_leaves_the_loop_to_learn() -> None:
    slaves, wires = rigid_load(1.5)
    slaves = [Telling(s.name, s.A, s.B, s.C, s.D, s.x_0) for s in slaves]
    told = begun(connected(slaves, wires), Strong(), TIMES).groups[0].newton.jacobian.copy()
    assert told == pytest.approx(np.array([[1.5 / 2.5]]))
    slaves[1].directional_derivative = lambda direction: None
    left = begun(connected(slaves, wires), Strong(), TIMES).groups[0].newton.jacobian
    assert (left == QuasiNewton(1).jacobian).all()
