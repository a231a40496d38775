"""Loops of slaves: which couplings diverge at any step, and how the strong algorithm solves them."""

import itertools
from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.group import HALVINGS, SWEEPS
from emla_cosim.master.algorithms.registry import ALGORITHMS, Strong
from emla_cosim.master.instances.fmu_instance import DiscardedStepError, InstanceError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support import tiers
from tests.support.linear import LinearSlave, Whole, connected
from tests.support.simulated import begun, simulated, step_by_step
from tests.support.slaves import FakeSlave
from tests.support.tiers import mostly_slow
from tests.support.two_masses import MASS, Part, elastic_load, rigid_load, rigid_solution

TIMES = make_communication_points(1.0, 0.125)


def spectral_radius(mass: float, step: float) -> float:
    """How much of a change of the force comes back after a step of both slaves, without any master."""
    answers = []
    for force in (0.0, 1.0):
        (actuator, load), _ = rigid_load(mass)
        actuator.held[:] = force
        actuator.do_step(0.0, step)
        actuator.get_outputs()
        load.held[:] = actuator.outputs[2]
        load.do_step(0.0, step)
        load.get_outputs()
        answers.append(float(load.outputs[0]))
    return abs(answers[1] - answers[0])


def largest_acceleration(mass: float, algorithm: Algorithm, steps: int) -> float:
    """Within 0.5 s; infinite where it is too large for a number."""
    try:
        with np.errstate(all="ignore"):
            rows = simulated(
                connected(*rigid_load(mass)), algorithm, make_communication_points(0.5, 0.5 / steps)
            )
    except RunError as overflow:
        assert "became" in str(overflow)
        return np.inf
    return float(np.abs(rows[:, 3]).max())


# ---- two masses ---------------------------------------------------------------------------------


@pytest.mark.parametrize("mass", mostly_slow([1.5, 100.0], [1.5]))
@pytest.mark.parametrize("name", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("extrapolation", ["none", "master", "fmu"])
def test_rigid_heavy_load_diverges_with_every_step_size(name: str, mass: float, extrapolation: str) -> None:
    """A shorter step only makes it worse: there are more of them."""
    worst = []
    for steps in (20, 80, 320):
        # the speed gained within the step takes some of it; what is left for short steps is m_2 / m_1
        assert spectral_radius(mass, 0.5 / steps) == pytest.approx(mass / MASS, rel=3.6 / steps)
        assert spectral_radius(mass, 0.5 / steps) > 1.2
        worst.append(largest_acceleration(mass, ALGORITHMS[name](extrapolation), steps))
    assert worst[2] > 1e4 * 40.0  # the true one is at most 40 m/s^2
    assert worst[2] >= worst[1] > worst[0]


@pytest.mark.parametrize(
    ("mass", "extrapolation", "order"),
    mostly_slow(
        [(mass, *way) for mass in (1.5, 100.0) for way in (("none", 1), ("fmu", 2))],
        [(1.5, "none", 1), (100.0, "fmu", 2)],
    ),
)
def test_strong_coupling_solves_the_rigid_load(mass: float, extrapolation: str, order: int) -> None:
    errors, last = [], np.empty(0)
    for steps in (800, 1600):
        algorithm = Strong(extrapolation)
        rows = simulated(connected(*rigid_load(mass)), algorithm, make_communication_points(0.5, 0.5 / steps))
        errors.append(np.abs(rows[:, 1] - rigid_solution(mass, rows[:, 0])).max())
        last = rows[-1]
        # one force to agree on: three sweeps for the first step, then two
        assert algorithm.sweeps <= 2 * steps + 1
    assert algorithm.accuracy == order
    # held, the next term of the error is worth 5 % here where the force of 100 kg is late by half a step
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.06)
    assert last[4] == pytest.approx(-mass * last[3], rel=1e-7)


# ---- random linear loops against the implicit step of the whole ----------------------------------


@st.composite
def linear_parts(draw: Callable[..., float]) -> Part:
    """Two or three stable slaves with several inputs, driven by outputs of any slave, also their own."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    strength = 10.0 ** draw(st.floats(-1.0, 1.5))
    slaves = []
    for i in range(draw(st.integers(2, 3))):
        n, inputs, outputs = (draw(st.integers(low, 2)) for low in (1, 1, 1))
        A = random.normal(size=(n, n)) - 3.0 * np.eye(n)
        B, C = random.normal(size=(n, inputs)), random.normal(size=(outputs, n))
        D = strength * random.normal(size=(outputs, inputs)) * draw(st.integers(0, 1))
        slaves.append(LinearSlave(f"s{i}", A, B, C, D, random.normal(size=n)))
    wires = []
    for target, slave in enumerate(slaves):
        for i in range(slave.B.shape[1]):
            source = draw(st.integers(0, len(slaves) - 1))
            wires.append((source, draw(st.integers(0, len(slaves[source].C) - 1)), target, i))
    return slaves, wires


def implicit_step(system: Whole, x: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """States and outputs after a step that holds the outputs of its end, by linear algebra."""
    n = [len(s.x_0) for s in system.slaves]
    rows = np.cumsum([0, *n])
    F, G = np.zeros_like(system.A), np.zeros_like(system.B)
    columns = np.cumsum([0, *(s.B.shape[1] for s in system.slaves)])
    for i, slave in enumerate(system.slaves):
        state_rows, input_columns = slice(rows[i], rows[i + 1]), slice(columns[i], columns[i + 1])
        response = slave.response(step)
        F[state_rows, state_rows], G[state_rows, input_columns] = np.split(
            response, [n[i], n[i] + slave.B.shape[1]], axis=1
        )[:2]
    y = np.linalg.solve(np.eye(len(system.C)) - (system.C @ G + system.D) @ system.L, system.C @ F @ x)
    return F @ x + G @ system.L @ y, y


def well_posed(system: Whole, step: float) -> bool:
    """Whether the equations of start and of the step can be solved to ten digits."""
    n = len(system.C)
    for h in (0.0, step):
        answers = np.array([implicit_sweep(system, h, column) for column in np.eye(n)]).T
        if np.linalg.cond(np.eye(n) - answers) > 1e3:
            return False
    return True


def implicit_sweep(system: Whole, step: float, y: np.ndarray) -> np.ndarray:
    """What outputs y come back as after a step from rest."""
    u = np.split(system.L @ y, np.cumsum([s.B.shape[1] for s in system.slaves])[:-1])
    answers = []
    for slave, inputs in zip(system.slaves, u, strict=True):
        x = slave.response(step) @ np.concatenate([np.zeros_like(slave.x_0), inputs, np.zeros_like(inputs)])
        answers.append(slave.C @ x + slave.D @ inputs)
    return np.concatenate(answers)


def gain(name: str, feedthrough: list[list[float]], x: float = 1.0) -> LinearSlave:
    """A lag with outputs that show their inputs at once."""
    outputs, inputs = np.shape(feedthrough)
    return LinearSlave(name, [[-2.0]], np.ones(inputs), np.ones(outputs), feedthrough, [x])


TWO_SIGNALS: Part = (
    [gain("a", [[1.5, -4.0], [3.0, 2.5]]), gain("b", [[2.0, 1.0], [-1.0, 3.0]])],
    [(1, 0, 0, 0), (1, 1, 0, 1), (0, 0, 1, 0), (0, 1, 1, 1)],
)
TWO_LOOPS: Part = (
    [gain("a", [[3.0]]), gain("b", [[-2.0]]), gain("c", [[5.0, 1.0]]), gain("d", [[1.0]])],
    [(1, 0, 0, 0), (0, 0, 1, 0), (3, 0, 2, 0), (1, 0, 2, 1), (2, 0, 3, 0)],
)
ITSELF: Part = ([gain("a", [[-7.0]]), gain("after", [[2.0]])], [(0, 0, 0, 0), (0, 0, 1, 0)])


@tiers.examples(20, 60)
@given(linear_parts())
@example(TWO_SIGNALS)
@example(TWO_LOOPS)
@example(ITSELF)
def test_strong_coupling_is_the_implicit_step_of_the_whole(part: Part) -> None:
    step, steps, tolerance = 0.1, 4, 1e-9
    system = Whole(*part)
    assume(well_posed(system, step))
    times = make_communication_points(steps * step, step)
    algorithm = begun(connected(*part), Strong(coupling_tolerance=tolerance), times)
    x, signals = system.x_0.copy(), algorithm.network.signals
    size = np.abs(signals) + 0.01
    for k in step_by_step(algorithm, times):
        x, y = implicit_step(system, x, step)
        size = np.maximum(size, np.abs(y) + 0.01)
        # what is left of the disagreement, in each of the steps, times the condition of the equation
        assert np.abs(signals - y).max() <= 1e3 * (k + 1) * tolerance * size.max()


def test_only_slaves_in_loops_repeat_steps() -> None:
    a, b, c, d = gain("a", [[3.0]]), gain("b", [[-2.0]]), gain("c", [[5.0, 1.0]]), gain("d", [[1.0]])
    sink, source = gain("sink", [[1.0]]), LinearSlave("source", [[-1.0]], [], [1.0], np.empty((1, 0)), [1.0])
    slaves = [sink, a, b, source, c, d]
    # d -> sink, a <-> b, b -> c, c <-> d; no slave reads the source
    wires = [(5, 0, 0, 0), (2, 0, 1, 0), (1, 0, 2, 0), (5, 0, 4, 0), (2, 0, 4, 1), (4, 0, 5, 0)]
    times = make_communication_points(0.1, 0.1)
    algorithm = begun(connected(slaves, wires), Strong(), times)
    assert list(step_by_step(algorithm, times)) == [0]
    assert [[slaves[i].name for i in loop] for loop in algorithm.loops] == [["a", "b"], ["c", "d"]]
    assert (sink.steps, source.steps) == (1, 1)
    assert (a.steps, c.steps) == (b.steps, d.steps)
    assert a.steps + c.steps == algorithm.sweeps > 4


def test_state_of_slaves_is_that_of_the_last_sweep() -> None:
    """Bit for bit what one step from the start makes of the inputs that they hold."""
    slaves, wires = deepcopy(TWO_SIGNALS)  # another test steps these slaves, too
    times = make_communication_points(0.3, 0.1)
    algorithm = begun(connected(slaves, wires), Strong("fmu"), times)
    before = [slave.save() for slave in slaves]
    for k in step_by_step(algorithm, times):
        assert algorithm.sweeps > 2 * k + 1  # there was something to forget
        for slave, state, part in zip(slaves, before, algorithm.network.parts, strict=True):
            after, ends = slave.save(), slave.inputs.copy()
            slopes = algorithm.exchange.derivatives[algorithm.network.input_parts[slaves.index(slave)]]
            slave.restore(state)
            slave.set_inputs()
            slave.set_input_derivatives(slopes)
            slave.do_step(times.point(k), times.point(k + 1) - times.point(k))
            slave.get_outputs()
            assert (slave.inputs == ends).all()
            assert slave.state.tobytes() == after[1].tobytes()
            assert slave.outputs.tobytes() == algorithm.network.signals[part].tobytes()
        before = [slave.save() for slave in slaves]


# ---- the quasi-Newton iteration alone -----------------------------------------------------------


def fixed_point(
    answer: Callable[[np.ndarray], np.ndarray], start: Sequence[float], sizes: Any = 1.0
) -> tuple[Strong, FakeSlave]:
    """Return the coupling of x = F(x): a slave whose inputs are its outputs, of these sizes."""
    count = len(start)
    slave = FakeSlave("a", count, start, lambda u, x, t, h: answer(u))
    slave.nominals = 100.0 * np.ones(count) * sizes
    links = [Link(0, i, 0, i, True, False) for i in range(count)]
    return begun(Network([slave], links), Strong(), TIMES), slave


def sweeps_of(algorithm: Strong, steps: int) -> list[int]:
    """Do so many steps, and return the sweeps in each."""
    counts, before = list[int](), 0
    for _ in itertools.islice(step_by_step(algorithm, TIMES), steps):
        counts.append(algorithm.sweeps - before)
        before = algorithm.sweeps
    return counts


class Affine:
    """F(x) = G x + b with the values' own units."""

    def __init__(self, count: int, seed: int, spread: float = 0.0) -> None:
        random = np.random.default_rng(seed)
        self.sizes = 10.0 ** random.uniform(-spread, spread, count)
        self.G = 3.0 * random.normal(size=(count, count))
        self.b = random.normal(size=count)
        self.condition = np.linalg.cond(np.eye(count) - self.G)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.sizes * (self.G @ (x / self.sizes) + self.b)


@given(st.integers(1, 6), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 6.0]))
@settings(max_examples=100)
def test_affine_problems_take_two_sweeps_with_a_known_jacobian(count: int, seed: int, spread: float) -> None:
    """Also where newtons meet micrometres, twelve orders of magnitude apart.

    Before, one sweep per unknown and two more; and one more again where two differences are alike.
    """
    problem = Affine(count, seed, spread)
    assume(problem.condition < 100.0)
    algorithm, _ = fixed_point(problem, np.zeros(count), problem.sizes)
    (first,) = sweeps_of(algorithm, 1)
    assert first <= count + 3
    problem.b = -2.0 * problem.b[::-1]
    (second,) = sweeps_of(algorithm, 1)
    assert second - first == 2
    solution = problem.sizes * np.linalg.solve(np.eye(count) - problem.G, problem.b)
    assert algorithm.network.signals == pytest.approx(solution, rel=1e-5, abs=1e-5 * problem.sizes.min())


def test_rounding_errors_do_not_change_the_jacobian() -> None:
    """A residual of 1e6 that changes by 1e-6: each try follows a tenth of it, as if nothing had changed."""
    trials: list[float] = []

    def answer(x: np.ndarray) -> np.ndarray:
        trials.append(float(x[0]))
        return x + 1e6 + 1e-6 * (len(trials) % 2)

    algorithm, slave = fixed_point(answer, [0.0])
    slave.rolls_back = True
    with pytest.raises(RunError, match="does not converge"):
        sweeps_of(algorithm, 1)
    assert np.diff(trials[:SWEEPS]) == pytest.approx([1e5] * (SWEEPS - 1), rel=1e-9)


def test_nonlinear_problem_that_repetition_does_not_solve() -> None:
    """x = 3 cos y, y = 2 sin x - 1: repetition jumps about."""

    def answer(x: np.ndarray) -> np.ndarray:
        return np.array([3.0 * np.cos(x[1]), 2.0 * np.sin(x[0]) - 1.0])

    algorithm, _ = fixed_point(answer, [0.5, 0.5])
    assert sweeps_of(algorithm, 1)[0] <= 20
    solution = algorithm.network.signals
    assert answer(solution) == pytest.approx(solution, abs=1e-6)
    x = np.array([0.5, 0.5])
    for _ in range(1000):
        x = answer(x)
    assert np.abs(answer(x) - x).max() > 0.1


@pytest.mark.parametrize(
    ("answer", "sweeps"),
    [
        (lambda x: x + 1.0, 30),
        (lambda x: x * np.nan, 1),
        (lambda x: x + np.inf, 1),
        (lambda x: np.array([1e3, -1e3]) * x**3 + 7.0, 30),
    ],
)
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_failed_iteration_resets_the_jacobian(
    answer: Callable[[np.ndarray], np.ndarray], sweeps: int
) -> None:
    """A Jacobian from answers that ended in no number would lead the next step astray."""
    algorithm, slave = fixed_point(answer, [1.0, 1.0])
    slave.varies_step = False
    algorithm = begun(algorithm.network, Strong(), TIMES)
    with pytest.raises(RunError):
        sweeps_of(algorithm, 1)
    assert algorithm.sweeps <= sweeps
    assert (algorithm.groups[0].jacobian == 0.9 * np.eye(2)).all()


# ---- steps that cannot be done in one -----------------------------------------------------------


def after_a_step(network: Network, at: float = 0.0) -> Strong:
    """Strong coupling after one step of 1 s."""
    algorithm, times = Strong(), make_communication_points(at + 1.0, 1.0, at)
    begun(network, algorithm, times)
    assert list(step_by_step(algorithm, times)) == [0]
    return algorithm


def limited(limit: float, spans: list[tuple[float, float]]) -> Network:
    """A loop of a slave that discards long steps, noting those it does, and one that does not mind."""

    def advance(u: np.ndarray, x: np.ndarray, t: float, h: float) -> np.ndarray:
        if h > limit:
            raise DiscardedStepError("limited", f"doStep at t = {t:g} s", "fmi2Discard", ["Too long."])
        spans.append((t, h))
        return x + h * u

    a = FakeSlave("limited", 1, [1.0], advance)
    b = FakeSlave("other", 1, [0.0], lambda u, x, t, h: x - h * u)
    return Network([a, b], [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)])


def test_discarded_step_is_done_in_halves() -> None:
    spans: list[tuple[float, float]] = []
    algorithm = after_a_step(limited(0.25, spans), at=1.0)
    distinct_spans = list(dict.fromkeys(spans))
    assert distinct_spans == [(1.0, 0.25), (1.25, 0.25), (1.5, 0.25), (1.75, 0.25)]
    # x' = v, v' = -x by the implicit Euler method, four times
    expected = np.linalg.matrix_power(np.linalg.inv([[1.0, -0.25], [0.25, 1.0]]), 4) @ [1.0, 0.0]
    assert algorithm.network.signals == pytest.approx(expected, abs=1e-7)
    assert algorithm.exchange.history.at.tolist() == [2.0, 2.0]
    assert algorithm.exchange.history.before.tolist() == [1.75, 1.75]
    assert algorithm.steps == 1


class Limited(LinearSlave):
    """Discards steps that are longer than `longest`, in s."""

    longest = np.inf

    def do_step(self, time: float, step: float) -> None:
        if step > self.longest:
            raise DiscardedStepError(self.name, f"doStep at t = {time:g} s", "fmi2Discard", [])
        super().do_step(time, step)


@pytest.mark.parametrize("extrapolation", ["none", "master", "fmu"])
def test_half_steps_begin_at_the_start_of_the_step(extrapolation: str) -> None:
    """Signals and their history too: two halves are the same bits as two steps of half the length."""

    def rows(step: float, longest: float) -> np.ndarray:
        (a, b), wires = elastic_load()
        last = Limited(b.name, b.A, b.B, b.C, b.D, b.x_0)
        last.longest = longest
        network = connected([a, last], wires)
        assert network.order == [0, 1]  # the first has done the step when the last refuses it
        return simulated(network, Strong(extrapolation), make_communication_points(0.5, step))

    halves, steps = rows(2.0**-5, 2.0**-6), rows(2.0**-6, np.inf)
    assert len(halves) == 17
    assert halves.tobytes() == steps[::2].tobytes()


def test_slave_outside_of_loops_is_halved_alone() -> None:
    spans: list[tuple[float, float]] = []
    slave = limited(0.5, spans).instances[0]
    source = FakeSlave("source", 0, [2.0], lambda u, x, t, h: x + h)
    algorithm = after_a_step(Network([source, slave], [Link(0, 0, 1, 0, False)]))
    assert spans == [(0.0, 0.5), (0.5, 0.5)]
    assert source.calls.count("source.step") == 1
    assert algorithm.network.signals.tolist() == [3.0, 1.0 + 3.0]


def test_last_halving_reports_the_error_of_the_slave() -> None:
    spans: list[tuple[float, float]] = []
    shortest = 2.0**-HALVINGS
    after_a_step(limited(shortest, spans))
    assert min(h for _, h in spans) == shortest
    with pytest.raises(DiscardedStepError, match=r"limited answered doStep at t = 0 s .* Too long\."):
        after_a_step(limited(0.99 * shortest, spans))


def test_other_errors_are_not_halved() -> None:
    def fail(u: np.ndarray, x: np.ndarray, t: float, h: float) -> np.ndarray:
        raise InstanceError("bad", "doStep", "fmi2Error", [])

    with pytest.raises(InstanceError, match="fmi2Error"):
        after_a_step(Network([FakeSlave("bad", 1, [0.0], fail)], [Link(0, 0, 0, 0, False)]))


def pair(answer: Callable[[np.ndarray, float], np.ndarray]) -> Network:
    """a answers b's output, from the first step on; b passes it back."""
    a = FakeSlave("a", 1, [0.0], lambda u, x, t, h: answer(u, h))
    b = FakeSlave("b", 1, [0.0], lambda u, x, t, h: u)
    return Network([a, b], [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)])


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            lambda u, h: u + 1.0,
            r"^the loop a -> b -> a does not converge on the step from t = 0 s of 0.000977 s in "  # 2^-10 s
            r"30 sweeps: b\[0\] still changes by .* of its size\.$",
        ),
        (
            lambda u, h: u * np.nan,
            r"^in the loop a -> b -> a, b\[0\] is infinite or NaN on the step from t = 0 s",
        ),
    ],
)
def test_loop_without_a_solution_is_named_with_its_signal(
    answer: Callable[[np.ndarray, float], np.ndarray], message: str
) -> None:
    with pytest.raises(RunError, match=message):
        after_a_step(pair(answer))


def test_step_that_does_not_converge_is_halved() -> None:
    """x = x + 1 for steps longer than 0.3 s, x = 1 - x/2 for shorter ones."""
    algorithm = after_a_step(pair(lambda u, h: u + 1.0 if h > 0.3 else 1.0 - 0.5 * u))
    assert algorithm.network.signals == pytest.approx([2.0 / 3.0] * 2, rel=1e-7)


def test_loop_that_moves_along_a_line_needs_one_sweep() -> None:
    """The guess continues along the line of the last two points."""
    network = pair(lambda u, h: u)
    network.instances[0] = FakeSlave("a", 1, [0.0], lambda u, x, t, h: [3.0 * (t + h) - 1.0])
    network = Network(network.instances, network.links)
    times, sweeps = make_communication_points(2.0, 0.25), list[int]()
    algorithm = begun(network, Strong(), times)
    for _ in step_by_step(algorithm, times):
        sweeps.append(algorithm.sweeps)
    assert np.diff(sweeps)[2:].tolist() == [1] * 5


def test_slaves_of_a_loop_must_save_their_state() -> None:
    network = pair(lambda u, h: u)
    network.instances[1].rolls_back = False
    with pytest.raises(CommandError, match="a loop needs FMUs with canGetAndSetFMUstate; b cannot do it"):
        Strong().setup(network)


def test_slave_outside_of_loops_need_not_save_its_state() -> None:
    slave = FakeSlave("s", 0, [0.0], lambda u, x, t, h: x + h)
    slave.rolls_back = False
    rows = simulated(Network([slave], []), Strong(), make_communication_points(1.0, 0.5))
    assert rows[:, 1].tolist() == [0.0, 0.5, 1.0]
