"""Energies of power bonds, against integrals and exact solutions."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from emla_cosim.base.errors import CommandError
from emla_cosim.base.units import SiUnit
from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.continuous_connections import (
    ContinuousConnection,
    list_continuous_connections,
    loop_responses,
)
from emla_cosim.master.algorithms.extrapolation import Mode
from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.recorders.bond_energies import BondEnergies
from emla_cosim.recorders.recorder import RunLayout
from emla_cosim.system.bond import Bond
from tests.support.linear import LinearSlave, Whole, Wire, connected
from tests.support.simulated import step_by_step

EFFORT, FLOW = "b.F", "a.v"
LAYOUT = RunLayout([], [], make_communication_points(1.0, 0.1), [])


def rod(mode: Mode, late: tuple[bool, bool], units: Sequence[SiUnit | None] = (None, None)) -> BondEnergies:
    """The bond of a force and a speed that two components exchange."""
    exchanged = [
        ContinuousConnection("b.F -> a.F", 0, "b", "a", late[0], mode, True),
        ContinuousConnection("a.v -> b.v", 1, "a", "b", late[1], mode, True),
    ]
    signals: dict[str, SiUnit | None] = {EFFORT: units[0], FLOW: units[1]}
    return BondEnergies({"rod": Bond(EFFORT, FLOW)}, signals, exchanged, dict)


def effort(t: float) -> float:
    return 3.0 + np.sin(7.0 * t)


def flow(t: float) -> float:
    return np.cos(7.0 * t) - 0.3 * t


def used(
    signal: Callable[[float], float],
    t: float,
    begin: float,
    lengths: tuple[float, float],
    mode: Mode,
    late: bool,
) -> float:
    """What the consumer sees at a time within a step; `lengths` are that of the step before, and its own."""
    h = lengths[1]
    now, before, end = signal(begin), signal(begin - lengths[0]), signal(begin + h)
    if mode == Mode.HOLD:
        return now if late else end
    slope = (now - before if late else end - now) / h
    return now + slope * (0.5 * h if mode == Mode.MIDDLE else t - begin)


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("late", [(True, True), (True, False), (False, False)])
def test_energy_against_integrals(mode: Mode, late: tuple[bool, bool]) -> None:
    h, count = 0.01, 400
    times = 0.5 + h * np.arange(-2, count + 1)
    coupling = rod(mode, late)
    coupling.write(np.array([[t, effort(t), flow(t)] for t in times]))
    created = exchanged = 0.0
    for begin in times[:-1]:
        lengths = (h if begin > times[0] else 0.0, h)

        def lost_power(t: float, begin: float = begin, step_lengths: tuple[float, float] = lengths) -> float:
            e, f = (used(s, t, begin, step_lengths, mode, x) for s, x in ((effort, late[0]), (flow, late[1])))
            return effort(t) * f - e * flow(t)

        created += quad(lost_power, begin, begin + h)[0]
        exchanged += quad(lambda t: abs(effort(t) * flow(t)), begin, begin + h)[0]
    figures = coupling.figures()["rod"]
    edge = 0.0 if mode == Mode.HOLD else (7.0 * h) ** 3 * exchanged / 12  # what a parabola does not know
    assert figures["energy_error_J"] == pytest.approx(abs(created), rel=0.02, abs=edge)
    assert figures["energy_exchanged_J"] == pytest.approx(exchanged, rel=0.01)
    assert figures["energy_error"] == figures["energy_error_J"] / figures["energy_exchanged_J"]


def test_energies_are_in_joules_for_all_units() -> None:
    rows = np.array([[t, effort(t), flow(t)] for t in 0.01 * np.arange(50)])
    plain = rod(Mode.HOLD, (True, True))
    plain.write(rows)
    units = (SiUnit("kN", (1, 1, -2, 0, 0, 0, 0, 0), 1e3), SiUnit("mm/s", (0, 1, -1, 0, 0, 0, 0, 0), 1e-3))
    scaled = rod(Mode.HOLD, (True, True), units)
    scaled.write(rows * [1.0, 1e-3, 1e3])
    assert scaled.figures()["rod"] == pytest.approx(plain.figures()["rod"], rel=1e-12)


Parts = tuple[list[LinearSlave], list[Wire]]


def spring_pair(k: float, kc: float, damping: float = 0.0) -> Parts:
    """Two masses of 1 kg on springs of k and 1000 N/m, and a spring kc between them, in the second part."""
    A, load = [[0, 1], [-k, -2 * damping]], [[0, 1], [-kc - 1000.0, -damping]]
    first = LinearSlave("first", A, [0, 1], [[1, 0], [0, 1]], [[0], [0]], [0.01, 0])
    B, D = [[0, 0], [kc, damping]], [[-kc, -damping]]
    second = LinearSlave("second", load, B, [kc, damping], D, [0, 0])
    return [first, second], [(0, 0, 1, 0), (0, 1, 1, 1), (1, 0, 0, 0)]


def rigid_pair(ratio: float) -> Parts:
    """A mass of 1 kg on a spring, and one fixed to it that answers its acceleration with a force."""
    k, c = 400.0, 2.0
    C, D = [[1, 0], [0, 1], [-k, -c]], [[0], [0], [1]]
    first = LinearSlave("first", [[0, 1], [-k, -c]], [0, 1], C, D, [0.1, 0])
    return [first, LinearSlave("second", [], [], [], [[-ratio]], [])], [(0, 2, 1, 0), (1, 0, 0, 0)]


@dataclass(frozen=True)
class PairRun:
    """Rows of a run, the time first, the same in closed form, and what its bond needs."""

    rows: np.ndarray
    exact: np.ndarray
    algorithm: Algorithm
    bond: Bond

    def energies(self, blocks: Sequence[int] = (700,), resumed: bool = False) -> dict[str, float]:
        """Hand the rows over in blocks of these lengths in turn, maybe with a new object for each."""
        energies, start = self._energies(), 0
        for length in cycle(blocks):
            if start >= len(self.rows):
                return energies.figures()["pair"]
            if resumed:
                state, energies = json.loads(json.dumps(energies.state_dict())), self._energies()
                energies.begin(LAYOUT, state)
            energies.write(self.rows[start : start + length])
            start += length
        raise AssertionError

    def _energies(self) -> BondEnergies:
        units, responses = (
            dict.fromkeys(self.algorithm.network.names),
            partial(loop_responses, self.algorithm),
        )
        connections = list_continuous_connections(self.algorithm)
        return BondEnergies({"pair": self.bond}, units, connections, responses)


def run_pair(parts: Parts, algorithm: str, bond: tuple[int, int], stop: float, start: float = 0.0) -> PairRun:
    """Run a pair in steps of 1 ms; `bond` has the positions of effort and flow among all outputs."""
    slaves, wires = parts
    network = connected(slaves, wires)
    master = ALGORITHMS[algorithm]()
    master.setup(network)
    times = make_communication_points(start + stop, 1e-3, start)
    master.initialize(start, times.stop)
    rows = [np.array([start, *network.signals])]
    for k in step_by_step(master, times):
        rows.append(np.array([times.point(k + 1), *network.signals]))
    closed_form = Whole(slaves, wires)
    onward, states = expm(closed_form.M * 1e-3), [closed_form.x_0]
    for _ in range(times.steps):
        states.append(onward @ states[-1])
    exact = np.array([[row[0], *(closed_form.N @ x)] for row, x in zip(rows, states, strict=True)])
    effort, flow = (network.names[i] for i in bond)
    return PairRun(np.array(rows), exact, master, Bond(effort, flow))


@pytest.fixture(scope="module")
def growing() -> PairRun:
    """Jacobi makes this oscillation grow from 0.01 m to metres."""
    return run_pair(spring_pair(1000.0, 3000.0), "jacobi", (2, 1), stop=4.0)


def test_growing_run_has_an_energy_error(growing: PairRun) -> None:
    assert np.abs(growing.exact[:, 1]).max() < 0.02 and np.abs(growing.rows[:, 1]).max() > 1.0
    assert growing.energies()["energy_error"] > 0.05


def test_energy_error_of_a_heavy_load_against_the_exact_power() -> None:
    """The force within a step, F = -m a with the acceleration that the held force gives, has this power."""
    ratio, h = 100.0, 1e-3
    run = run_pair(rigid_pair(ratio), "strong", (3, 1), stop=2.0)
    x, v, force = run.rows[:-1, 1], run.rows[:-1, 2], run.rows[1:, 4]
    created = 0.0
    for part in (np.arange(20) + 0.5) / 20:  # the first mass between points, under the force that it used
        s = part * h
        a = -400.0 * x - 2.0 * v + force
        position, speed = x + v * s + 0.5 * a * s * s, v + a * s
        created += (
            h / 20 * float(((-ratio * (-400.0 * position - 2.0 * speed + force) - force) * speed).sum())
        )
    assert run.energies()["energy_error_J"] == pytest.approx(abs(created), rel=0.05)


@pytest.mark.parametrize(
    ("blocks", "resumed"), [((3,), False), ((2, 137), True), ((1999, 1, 7), True), ((100000,), False)]
)
def test_figures_do_not_depend_on_the_blocks_of_rows(
    growing: PairRun, blocks: tuple[int, ...], resumed: bool
) -> None:
    few = replace(growing, rows=growing.rows[:800])
    assert few.energies(blocks, resumed) == pytest.approx(few.energies(), rel=1e-9)


def test_figures_do_not_depend_on_the_start_time() -> None:
    now, later = (
        run_pair(spring_pair(1000.0, 1000.0), "gauss-seidel", (2, 1), stop=1.0, start=start)
        for start in (0.0, 1000.0)
    )
    assert later.energies() == pytest.approx(now.energies(), rel=1e-6, abs=1e-9)


def test_constant_nan_and_missing_rows() -> None:
    for value in (0.0, 5.0, np.nan):
        bonds = rod(Mode.HOLD, (True, True))
        rows = np.full((50, 3), value)
        rows[:, 0] = 0.1 * np.arange(50)
        bonds.write(rows)
        assert bonds.figures()["rod"]["energy_error_J"] in (0.0, pytest.approx(np.nan, nan_ok=True))
    single = rod(Mode.HOLD, (True, True))
    single.write(np.ones((1, 3)))
    assert single.figures()["rod"]["energy_exchanged_J"] == 0.0


@pytest.mark.parametrize("text", ["a.F", "a.F *", "* a.v", "a.F * a.v * a.x", ""])
def test_invalid_bonds(text: str) -> None:
    with pytest.raises(CommandError, match="write two signals"):
        Bond.read("rod", text)
