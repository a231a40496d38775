"""Steps chosen by their error: the step control alone, and step doubling with every algorithm.

That C does the same is shown in test_matrix.py; here only rules that no system there needs.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.extrapolation import EXTRAPOLATIONS
from emla_cosim.master.algorithms.registry import ALGORITHMS, GaussSeidel, Jacobi, Strong
from emla_cosim.master.instances.fmu_instance import DiscardedStepError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.run_loop import simulate
from emla_cosim.master.stepping import control_tables, step_size_control
from emla_cosim.master.stepping.control_tables import SMALLEST_STEP_FRACTION
from emla_cosim.master.stepping.error_control import ErrorControl
from emla_cosim.master.stepping.timing import make_clock, make_communication_points
from emla_cosim.run.options import Options
from tests.support.faulty_systems import line_with_a_fault, open_system
from tests.support.hand_written_fmus import Fault
from tests.support.linear import LinearSlave, Whole, connected
from tests.support.plain_error_control import PlainErrorControl, PlainErrorControlledStepSize
from tests.support.simulated import Table, begun, recorded, simulated
from tests.support.slaves import FakeSlave
from tests.support.step_control import LARGEST_CUT, LARGEST_GROWTH, SAFETY, StepControl
from tests.support.tiers import mostly_slow
from tests.support.two_masses import MASS, STIFFNESS, Part, rigid_load

sizes = st.floats(-12.0, 6.0).map(lambda x: 10.0**x)


def controlled(
    network: Network,
    algorithm: Algorithm,
    stop: float,
    first: float,
    tolerance: float,
    interval: float | None = None,
) -> ErrorControl:
    times = make_communication_points(stop, first)
    return ErrorControl(begun(network, algorithm, times), times, tolerance, interval)


# ---- the step control alone ---------------------------------------------------------------------


@given(sizes, sizes)
def test_proposed_step_leaves_zero_or_a_full_step(step: float, remaining: float) -> None:
    proposed = StepControl(step, 1, 1e-15).propose(remaining)
    assert 0.0 < proposed <= min(remaining, step * (1.0 + 1e-8))
    assert proposed == remaining or remaining - proposed >= proposed * (1.0 - 1e-12)
    assert proposed >= min(0.5 * step, remaining)


@given(st.integers(1, 2), st.floats(0.0, 1.0), st.floats(1e-10, 1.0))
def test_accepted_step_changes_the_next_within_bounds(order: int, error: float, last: float) -> None:
    control = StepControl(0.1, order, 1e-7, last_error=last)
    assert control.judge(0.1, error)
    assert LARGEST_CUT * 0.1 <= control.step <= LARGEST_GROWTH * 0.1
    assert (control.accepted, control.rejected) == (1, 0)


@given(st.integers(1, 2), st.floats(1.0, exclude_min=True) | st.just(float("nan")))
def test_rejected_step_is_tried_shorter(order: int, error: float) -> None:
    control = StepControl(0.1, order, 1e-7)
    assert not control.judge(0.1, error)
    assert LARGEST_CUT * 0.1 <= control.step <= (SAFETY if np.isfinite(error) else LARGEST_CUT) * 0.1
    assert (control.accepted, control.rejected) == (0, 1)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("interval", [0.1, 0.3, 0.6, 0.85])
def test_points_that_steps_must_meet_cost_one_step_each(order: int, interval: float) -> None:
    """A step of 0.9 would be allowed: one per interval will do."""
    control, points = StepControl(0.01, order + 1, 1e-8), 100
    for _ in range(points):
        remaining = interval
        while remaining > 0.0:
            step = control.propose(remaining)
            if control.judge(step, step ** (order + 1)):
                remaining -= step
    assert control.accepted <= points + 10
    assert control.rejected == 0


# ---- local errors -------------------------------------------------------------------------------


def oscillators() -> Part:
    """Two oscillators, one pulling at the other's displacement and speed."""
    a = LinearSlave("a", [[0, 1], [-4, -0.1]], [0, 1], np.eye(2), [[0], [0]], [1, 0])
    b = LinearSlave("b", [[0, 1], [-1, -0.2]], [[0, 0], [1, 0.2]], [1, 0], [[0, 0]], [0, 0.5])
    return [a, b], [(0, 0, 1, 0), (0, 1, 1, 1), (1, 0, 0, 0)]


EXTRAPOLATED = [(name, way) for name in ALGORITHMS for way in EXTRAPOLATIONS]
LOCAL = [(*case, t) for case in EXTRAPOLATED for t in ((1e-3, 1e-5) if case[1] == "fmu" else (1e-1,))]


@pytest.mark.parametrize(("name", "extrapolation", "tolerance"), mostly_slow(LOCAL, LOCAL[::4]))
def test_local_errors_are_near_the_tolerance(name: str, extrapolation: str, tolerance: float) -> None:
    """Per unit step, against the closed form, begun anew at every accepted point."""
    slaves, wires = oscillators()
    closed_form, network, first = Whole(slaves, wires), connected(slaves, wires), 0.01
    stepping = controlled(network, ALGORITHMS[name](extrapolation), 6.0, first, tolerance)
    longest = stepping.control.longest
    table, largest = Table(1 + len(network.signals)), np.abs(network.signals)
    errors = []
    while not stepping.finished:
        time, x, before = stepping.time, np.concatenate([s.state for s in slaves]), stepping.steps
        stepping.advance(table, 1)
        if stepping.steps > before:
            step = stepping.time - time
            exact = closed_form.N @ expm(closed_form.M * step) @ x
            allowed = tolerance * step / (time + step + longest)
            errors.append((np.abs(network.signals - exact) / (largest + 0.01)).max() / allowed)
            largest = np.maximum(largest, np.abs(network.signals))
    assert len(errors) == stepping.control.accepted > 20
    # `master` is late by a part of the step at both ends, which only the estimate sees
    assert (0.0 if extrapolation == "master" else 0.1) < np.median(errors) < 0.9
    # lines through the past know its spacing, which the estimate does not
    assert max(errors[1:]) < (3.0 if extrapolation == "fmu" else 1.0)
    assert errors[0] < 3.0  # before which there is no line


def burst() -> Part:
    """A source that rings at 400 rad/s for 0.1 s and swings permanently at 0.5 rad/s, and what it drives."""
    fast, slow, decay = 400.0, 0.5, 40.0
    A = [[-decay, fast, 0, 0], [-fast, -decay, 0, 0], [0, 0, 0, slow], [0, 0, -slow, 0]]
    source = LinearSlave("source", A, [], [1, 0, 0.5, 0], np.empty((1, 0)), [1, 0, 1, 0])
    a = LinearSlave("a", [[-200]], [200, 20], [1], [[0, 0]], [0.5])
    b = LinearSlave("b", [[-1]], [1], [1], [[0]], [0])
    return [source, a, b], [(0, 0, 1, 0), (2, 0, 1, 1), (1, 0, 2, 0)]


def error_of(rows: np.ndarray, part: Part) -> float:
    closed_form = Whole(*part)
    return max(float(np.abs(row[1:] - closed_form.outputs(row[0])).max()) for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "extrapolation", "tolerance"),
    [("jacobi", "fmu", 1e-2), ("gauss-seidel", "fmu", 3e-3), ("strong", "fmu", 3e-3)],
)
def test_ten_times_fewer_steps_than_fixed_ones(name: str, extrapolation: str, tolerance: float) -> None:
    stop, part = 20.0, burst()
    stepping = controlled(connected(*part), ALGORITHMS[name](extrapolation), stop, 1e-3, tolerance)
    error = error_of(recorded(stepping), part)
    assert error < 10.0 * tolerance
    steps = 3 * (stepping.control.accepted + stepping.control.rejected)
    # the fixed ones make their error in the burst
    part, fixed = burst(), stop / (10 * steps)
    rows = simulated(
        connected(*part),
        ALGORITHMS[name](extrapolation),
        make_communication_points(round(0.1 / fixed) * fixed, fixed),
    )
    assert error_of(rows, part) > 5.0 * error


# ---- going back ---------------------------------------------------------------------------------


def everything(stepping: ErrorControl, slaves: list[LinearSlave]) -> dict[str, bytes]:
    """All that a rejected step must leave as it was."""
    algorithm = stepping.algorithm
    states = [x.tobytes() for slave in slaves for x in slave.save()]
    return {
        "states": b"".join(states),
        "memory": algorithm.restored.tobytes(),
        "steps": bytes(algorithm.steps),
    }


@pytest.mark.parametrize(("name", "extrapolation"), EXTRAPOLATED)
def test_rejected_step_restores_all_state(name: str, extrapolation: str) -> None:
    slaves, wires = oscillators()
    algorithm = ALGORITHMS[name](extrapolation)
    stepping = controlled(connected(slaves, wires), algorithm, 6.0, 0.1, 1e-4)
    table = Table(1 + len(algorithm.network.signals))
    stepping.advance(table, 3)
    for step in (0.5, 2.0):
        stepping.control.step = step
        sizes = algorithm.scale.largest  # which the trial updates first
        sizes[:] = np.maximum(sizes, np.abs(algorithm.network.signals))
        before, time, accepted = everything(stepping, slaves), stepping.time, stepping.steps
        stepping.advance(table, 1)
        assert stepping.steps == accepted
        assert everything(stepping, slaves) == before
        assert stepping.time == time
    assert stepping.control.rejected >= 2


def test_run_continues_from_its_state_after_a_rejected_step() -> None:
    """Also the first try, by which jumps are recognised, bit for bit."""
    rows = []
    for interrupted in (False, True):
        part = oscillators()
        stepping = controlled(connected(*part), Jacobi("fmu"), 1.0, 0.5, 1e-4)
        stepping.advance(Table(4), 1)
        assert (stepping.control.accepted, stepping.control.rejected) == (0, 1)
        if interrupted:
            state = {name: value.copy() for name, value in stepping.state_dict().items()}
            part = oscillators()
            stepping = controlled(connected(*part), Jacobi("fmu"), 1.0, 0.5, 1e-4)
            stepping.load_state_dict(state)
            assert {n: v.tobytes() for n, v in stepping.state_dict().items()} == {
                n: v.tobytes() for n, v in state.items()
            }
        rows.append(recorded(stepping))
    assert rows[0].tobytes() == rows[1].tobytes()


def test_rejected_large_values_do_not_loosen_the_tolerance_of_a_loop() -> None:
    """Long steps come to 1e12 on the way; what agrees must not be judged by that afterwards."""

    def wild(u: np.ndarray, x: np.ndarray, t: float, h: float) -> np.ndarray:
        return x * 1e12 if h > 0.2 else x + h * (1.0 - 3.0 * u)

    a = FakeSlave("a", 1, [1.0], wild)
    b = FakeSlave("b", 1, [0.0], lambda u, x, t, h: 2.0 * u)
    network = Network([a, b], [Link(1, 0, 0, 0, True), Link(0, 0, 1, 0, True)])
    algorithm = Strong()
    stepping = controlled(network, algorithm, 1.0, 1.0, 0.1)
    recorded(stepping)
    assert stepping.control.rejected > 0
    assert algorithm.scale.largest.max() < 10.0


def test_slave_that_discards_every_step_ends_the_run_with_its_message() -> None:
    def never(u: np.ndarray, x: np.ndarray, t: float, h: float) -> np.ndarray:
        raise DiscardedStepError("stubborn", "doStep", "fmi2Discard", ["No."])

    slave = FakeSlave("stubborn", 0, [0.0], never)
    stepping = controlled(Network([slave], []), Jacobi(), 1.0, 0.1, 1e-3)
    with pytest.raises(DiscardedStepError, match=r"stubborn answered doStep with fmi2Discard. FMU log: No\."):
        recorded(stepping)
    assert SMALLEST_STEP_FRACTION / 2.0 < 0.1 * 2.0**-stepping.control.rejected < SMALLEST_STEP_FRACTION


def ending(wrong: float, reads: bool) -> Network:
    """A clock whose second output becomes something else after 0.5 s, and perhaps a reader of it."""
    clock = FakeSlave(
        "clock", 0, [0.0], lambda u, x, t, h: x + h, lambda u, x: [x[0], wrong if x[0] > 0.5 else 0.0]
    )
    reader = FakeSlave("reader", 1, [0.0], lambda u, x, t, h: x + h * u)
    return Network([clock, reader], [Link(0, 1 if reads else 0, 1, 0, False)])


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_nan_in_a_connected_signal_ends_the_run(wrong: float) -> None:
    stepping = controlled(ending(wrong, True), Jacobi(), 1.0, 0.1, 0.05)
    with pytest.raises(RunError, match=rf"^clock\[1\] became {wrong} at t = 0.5"):
        recorded(stepping)
    assert stepping.time == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_nan_in_an_unconnected_signal_is_allowed(wrong: float) -> None:
    """As with fixed steps."""
    stepping = controlled(ending(wrong, False), Jacobi(), 1.0, 0.1, 0.05)
    rows = recorded(stepping)
    assert rows[-1, :2] == pytest.approx([1.0, 1.0])
    assert rows[-1, 3] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("infinity", mostly_slow([np.inf, -np.inf], [-np.inf]))
def test_infinite_value_does_not_make_every_later_error_small(infinity: float) -> None:
    """A signal that was infinite once is judged by its finite values ever after."""

    def steps(first: float) -> int:
        spring = FakeSlave(
            "spring",
            0,
            [0.0, 1.0],
            lambda u, x, t, h: [x[0] + h * 20.0 * x[1], x[1] - h * 20.0 * x[0]],
            lambda u, x: [first if x[0] == 0.0 else x[0]],  # which no input reads
        )
        stepping = controlled(Network([spring], []), Jacobi(), 1.0, 1e-3, 1e-3)
        assert np.isfinite(recorded(stepping)[1:]).all()
        assert np.isfinite(stepping.algorithm.scale.largest).all()
        return stepping.steps

    finite = steps(0.0)
    assert steps(infinity) == pytest.approx(finite, rel=0.1)
    assert finite > 100


@pytest.mark.parametrize("name", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("mass", [1.5, 100.0])
def test_unstable_coupling_is_not_treated_as_jumps(name: str, mass: float) -> None:
    """A rigid load diverges at every step. Once that may pass for a jump, not again and again."""
    stepping = controlled(connected(*rigid_load(mass)), ALGORITHMS[name](), 0.5, 1e-2, 1e-3)
    table = Table(5)
    with np.errstate(all="ignore"), pytest.raises(RunError, match=r"even with a step of .* s"):
        simulate(stepping, table)
    initial = STIFFNESS * 0.1 / (MASS + mass)
    assert np.abs(table.rows[:, 3]).max(initial=0.0) < 20.0 * initial


def test_noise_ends_the_run_but_a_jump_does_not() -> None:
    """A step of a continuous output that is 1 high at any step size."""
    slave = FakeSlave("jump", 0, [0.0], lambda u, x, t, h: [1.0] if t < 0.3 < t + h else x, None)
    slave.state[:] = 0.0
    stepping = controlled(Network([slave], []), Jacobi(), 1.0, 0.1, 1e-3)
    recorded(stepping)  # both ways of doing the step see the jump: no error
    noise = np.random.default_rng(3)
    slave = FakeSlave("noise", 0, [0.0], lambda u, x, t, h: noise.normal(size=1))
    reader = FakeSlave("reader", 1, [0.0], lambda u, x, t, h: x + h * u)
    stepping = controlled(Network([slave, reader], [Link(0, 0, 1, 0, False)]), Jacobi(), 1.0, 0.1, 1e-6)
    with pytest.raises(RunError, match=r"even with a step of .* s"):
        recorded(stepping)


# ---- points to be met ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stop", "first", "interval"),
    [
        (1.0, 0.1, 0.1),
        (4.2, 0.1, 0.7),
        (1.2, 0.1, 0.3),
        (2.1, 0.1, 0.7),
        (1.0, 0.001, 0.25),
        (1.0, 0.5, 0.02),
        (1.0, 0.1, 0.3),
    ],
)
def test_rows_are_at_multiples_of_the_interval_and_at_the_end(
    stop: float, first: float, interval: float
) -> None:
    part = oscillators()
    stepping = controlled(connected(*part), Strong("fmu"), stop, first, 1e-4, interval)
    rows = recorded(stepping)
    points = [make_clock(0.0, interval).point(k) for k in range(int(stop / interval + 1e-9) + 1)]
    assert rows[:, 0].tolist() == sorted({*points, stop})
    assert error_of(rows, part) < 1e-2


# ---- what cannot be controlled ------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, 1.0, float("nan"), float("inf")])
def test_impossible_tolerances_are_refused(tolerance: float) -> None:
    with pytest.raises(CommandError, match=r"the error tolerance .* must be between 0 and 1"):
        Options().updated({"error_tolerance": tolerance})


@pytest.mark.parametrize(
    ("ability", "message"),
    [
        ("rolls_back", r"error control needs FMUs with canGetAndSetFMUstate; clock cannot do it\."),
        ("varies_step", "error control needs FMUs with canHandleVariableCommunicationStepSize; clock cannot"),
    ],
)
def test_instances_must_have_states_and_vary_the_step(ability: str, message: str) -> None:
    network = ending(0.0, True)
    setattr(network.instances[0], ability, False)
    with pytest.raises(CommandError, match=message):
        controlled(network, Jacobi(), 1.0, 0.1, 1e-3)


@pytest.mark.parametrize(("name", "multiple"), [("jacobi", 2), ("gauss-seidel", 2), ("strong", 1)])
def test_step_multiples_need_fixed_steps(name: str, multiple: int) -> None:
    make: Callable[..., Algorithm] = ALGORITHMS[name]
    with pytest.raises(CommandError, match="step multiples need fixed steps"):
        controlled(ending(0.0, True), make("none", {"clock": multiple}), 1.0, 0.1, 1e-3)


# ---- rules for errors ---------------------------------------------------------------------------


def shuffle(stepping: ErrorControl, seed: int) -> Any:
    """Give the signals random roles, so that every rule applies to some."""
    random, tables = np.random.default_rng(seed), stepping._tables
    for role in ("is_instant", "is_unread"):
        tables.signals[role] = random.random(len(tables.signals)) < 0.3
    stepping.control.controlled_count -= int(random.integers(len(tables.signals) // 4))
    jumped = random.integers(0, 12, len(tables.signals))
    tables._flags["jumped"][:] = jumped
    if isinstance(stepping, PlainErrorControl):
        stepping.jumped = jumped
    return stepping


class Shuffled(ErrorControl):
    seed = 0

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments[:-1], sampled=bool(self.seed % 2))
        shuffle(self, self.seed)


class PlainShuffled(PlainErrorControlledStepSize):
    seed = 0

    def make_stepping(self, algorithm: Any, request: Any) -> Any:
        request = dataclasses.replace(request, sampled=bool(self.seed % 2))
        return shuffle(super().make_stepping(algorithm, request), self.seed)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", mostly_slow([0, 2, 6, 9], [6, 9]))
def test_every_rule_for_errors_is_the_same(
    seed: int, fmu_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a run in which all apply."""
    monkeypatch.setattr(control_tables, "SHORT_STEP_FRACTION", 1e-2)
    monkeypatch.setattr(step_size_control, "ErrorControl", Shuffled)
    monkeypatch.setattr(Shuffled, "seed", seed)
    monkeypatch.setattr(PlainShuffled, "seed", seed)
    tolerance = [1e-3, 1e-5][seed % 2]
    scenario = ec.load(
        "lift",
        step_size=1e-5,
        stop_time=3e-5,
        fmus=fmu_folder,
        algorithm=["jacobi", "gauss-seidel", "strong"][seed % 3],
        extrapolation=["none", "fmu", "none"][seed % 3],
    )
    plain = PlainShuffled(error_tolerance=tolerance, largest_step=2e-5)
    ways: list[dict[str, Any]] = [
        {"error_tolerance": tolerance, "largest_step": 2e-5},
        {"step_size_control": plain},
    ]
    results = []
    for way in ways:
        with scenario.prepare() as simulation:
            results.append(simulation.attempt(recorders=[ec.TimeSeries()], **way))
    fast, in_python = results
    names = ["time", *in_python.names]
    assert all(
        x.tobytes() == y.tobytes() for x, y in zip(*(r.read(names).values() for r in results), strict=True)
    )
    assert (fast.problem, fast.steps, fast.end_s) == (in_python.problem, in_python.steps, in_python.end_s)
    assert fast.stepping == in_python.stepping
    assert in_python.problem is None
    assert set(plain.made.rules) == {"jump", "chatter", "brief"}


def test_events_are_the_same(faulty_fmu: Path) -> None:
    """Steps end at each event, and the history of lines begins anew there."""

    def run(kind: type[ErrorControl], interval: float | None) -> tuple[list[list[float]], int]:
        with open_system(line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)) as assembly:
            times = make_communication_points(1.0, 0.1)
            algorithm = begun(assembly.network, GaussSeidel("fmu"), times)
            stepping = kind(algorithm, times, 1e-3, interval, events=[0.31, 0.5, 0.77])
            return recorded(stepping).tolist(), stepping.report()["rejected_steps"]

    rows, each = run(ErrorControl, 0.25), run(ErrorControl, None)
    assert rows == run(PlainErrorControl, 0.25) and each == run(PlainErrorControl, None)
    assert [row[0] for row in rows[0]] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert {0.31, 0.5, 0.77} <= {row[0] for row in each[0]}
