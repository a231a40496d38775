"""The stepper: random networks, loops that are solved in halves, and hosts without it.

That it has the bits of the plain stepper with other systems is shown in test_matrix.py.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.base.errors import RunError
from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.extrapolation import EXTRAPOLATIONS
from emla_cosim.master.algorithms.registry import GaussSeidel, Jacobi, Strong
from emla_cosim.master.instances.fmu_instance import DiscardedStepError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.run_loop import simulate
from emla_cosim.master.stepping.step_size_control import FixedSteps
from emla_cosim.master.stepping.timing import CommunicationPoints, make_communication_points
from emla_cosim.stepper.library import StepperBuildError
from emla_cosim.system.model import Component, System
from tests.support.faulty_systems import counts_of, faulty, loop_with_a_fault, open_system, wired
from tests.support.hand_written_fmus import Fault, build_faulty_fmu
from tests.support.lanes import in_lanes
from tests.support.plain_stepper import PlainSteps
from tests.support.prebuilt import without_prebuilt
from tests.support.simulated import Table, begun, recorded
from tests.support.slaves import FakeSlave
from tests.support.tiers import examples

KINDS: tuple[type[Algorithm], ...] = (Jacobi, GaussSeidel, Strong)
TIMES = make_communication_points(1.0, 1.0 / 32.0)
Make = Callable[[], Algorithm]


def rows(
    network: Network,
    algorithm: Algorithm,
    times: CommunicationPoints,
    *,
    plain: bool,
    steps_per_row: int = 1,
    room: int = 7,
    shared: int | None = None,
) -> np.ndarray:
    """Return all rows of a run in this way and no other.

    `shared` is the seed by which threads share its steps.
    """
    begun(network, algorithm, times)
    stepping = PlainSteps(algorithm, times) if plain else FixedSteps(algorithm, times)
    if shared is not None:
        in_lanes(stepping, shared)
    return recorded(stepping, steps_per_row, room=room)


def assert_same_bits(actual: np.ndarray, expected: np.ndarray) -> None:
    assert actual.shape == expected.shape
    assert actual.tobytes() == expected.tobytes()


# ---- networks of all kinds ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def fmus(faulty_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An FMU that takes derivatives of inputs, and one that does not."""
    return faulty_fmu, build_faulty_fmu(tmp_path_factory.mktemp("plain"), interpolate=False, name="Plain")


values = st.floats(-0.5, 0.5).map(lambda x: round(x, 3))
longest = st.sampled_from([1e300, 1e300, 0.03])
"""Steps in s that an instance does; `strong` halves a step of 0.05 s that is too long."""


def systems(fmus: tuple[Path, Path], halved: bool) -> st.SearchStrategy[System]:
    """Two to six instances; the first has no source, the others may read anyone.

    Where steps may be `halved`, some instances discard long ones.
    """

    def of(count: int) -> st.SearchStrategy[System]:
        names = [f"j.c{i}" for i in range(count)]
        most = longest if halved else st.just(1e300)
        component = st.tuples(st.sampled_from(fmus), values, values, values, most)
        source = st.none() | st.sampled_from([f"{name}.{output}" for name in names for output in "yz"])
        drawn = st.tuples(st.tuples(*[component] * count), st.tuples(st.none(), *[source] * (count - 1)))

        def put_together(x: tuple[tuple, tuple]) -> System:
            components: list[Component] = []
            wires = []
            for name, (fmu, a, b, u, most), read in zip(names, *x, strict=True):
                start = {"u": u} if read is None else {}
                components.append(faulty(name, fmu, a=a, b=b, longest=most, **start))
                wires += [f"{read} -> {name}.u"] if read is not None else []
            return wired(components, *wires)

        return drawn.map(put_together)

    return st.integers(2, 6).flatmap(of)


@examples(8, 100)
@given(data=st.data())
def test_any_network_has_the_same_bits(data: st.DataObject, fmus: tuple[Path, Path]) -> None:
    kind = data.draw(st.sampled_from(KINDS), label="algorithm")
    system = data.draw(systems(fmus, kind is Strong), label="system")
    names = [c.name for c in system.components]
    order = data.draw(st.permutations(names), label="order")
    extrapolation = data.draw(st.sampled_from(EXTRAPOLATIONS), label="extrapolation")
    multiples = data.draw(st.dictionaries(st.sampled_from(names), st.sampled_from([1, 2, 3, 5])))
    if kind is Strong:  # sampled slaves do no halves
        too_long = {c.name for c in system.components if c.parameters["longest"] < 1.0}
        multiples = {name: m for name, m in multiples.items() if name not in too_long}
    transformation = st.just((1.0, 0.0)) | st.tuples(values, values)
    transformations = [data.draw(transformation) for _ in system.connections]
    steps_per_row, room = (
        data.draw(st.integers(1, 7), label="every"),
        data.draw(st.sampled_from([1, 2, 5, 1000]), label="room"),
    )
    times = make_communication_points(1.2, 0.05)
    results, seed = [], data.draw(st.integers(0, 99), label="share")
    for plain, shared in ((True, None), (False, None), (False, seed)):
        with open_system(system, transformations) as assembly:
            assembly.network.reorder(order)
            results.append(
                rows(
                    assembly.network,
                    kind(extrapolation, multiples),
                    times,
                    plain=plain,
                    steps_per_row=steps_per_row,
                    room=room,
                    shared=shared,
                )
            )
    expected, *fast = results
    assert len(expected) == 24 // steps_per_row + 1
    for rows_of_one in fast:
        assert_same_bits(rows_of_one, expected)


# ---- loops that are solved in halves -----------------------------------------------------------


def stubborn() -> Network:
    """A loop without a solution for steps that are longer than 0.01 s and start at 0.5 s."""

    def answer(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        return u + 1.0 if step > 0.01 and time == 0.5 else 1.0 - 0.5 * u

    return mirrored(answer)


def late_refusal() -> Network:
    """A loop with the solution 10 t^2 whose slave discards long steps from 0.3 s to 0.6 s, but only near it.

    Then the algorithm has learned something of the loop in the step that it must forget.
    """

    def answer(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        off = u - 10.0 * (time + step) ** 2
        if step > 0.02 and 0.3 < time + step < 0.6 and abs(off[0]) < 1e-6:
            raise DiscardedStepError("a", f"doStep at t = {time:g} s", "fmi2Discard", [])
        return u - 3.0 * off - 5.0 * off * off

    return mirrored(answer)


def mirrored(answer: Callable[[np.ndarray, np.ndarray, float, float], Any]) -> Network:
    """Return a loop of a slave that answers like this and one that passes its output back."""
    a = FakeSlave("a", 1, [0.0], answer)
    b = FakeSlave("b", 1, [0.0], lambda u, x, t, h: u)
    links = [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)]
    return Network([a, b], links)


Step = tuple[np.ndarray, dict[str, np.ndarray], FixedSteps | PlainSteps]


def run_both(build: Callable[[], Network], make: Make) -> tuple[Step, Step]:
    """Return rows, state and stepping of a run in Python and of one in C, after comparing rows and states."""
    results: list[Step] = []
    for kind in (PlainSteps, FixedSteps):
        network = build()
        stepping = kind(begun(network, make(), TIMES), TIMES)
        results.append((recorded(stepping), stepping.state_dict(), stepping))
        assert not any(s.states for s in network.instances)  # saved states that were not freed
    (expected, state, _), (actual, native_state, _) = results
    assert_same_bits(actual, expected)
    assert state.keys() == native_state.keys()
    for key, value in state.items():
        assert_same_bits(native_state[key], value)
    return results[0], results[1]


@pytest.mark.parametrize("extrapolation", EXTRAPOLATIONS)
@pytest.mark.parametrize("build", [stubborn, late_refusal])
def test_halved_steps_have_the_bits_of_python(build: Callable[[], Network], extrapolation: str) -> None:
    """So has what the algorithm keeps: history, sizes of signals, Jacobians, and the number of sweeps."""
    (expected, state, _), _ = run_both(build, lambda: Strong(extrapolation))
    assert len(expected) == TIMES.steps + 1 and np.isfinite(expected).all()
    assert state["counts"][1] > TIMES.steps


def refusal() -> Network:
    """A loop whose second slave discards long steps from 0.3 s to 0.6 s, and its first one after 0.45 s."""

    def answer(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        if step > 0.02 and 0.3 < time + step < 0.6:
            raise DiscardedStepError("b", f"doStep at t = {time:g} s", "fmi2Discard", [])
        return 0.5 * x + 3.0 * u * step

    def source(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        if step > 0.01 and time > 0.45:
            raise DiscardedStepError("a", f"doStep at t = {time:g} s", "fmi2Discard", [])
        return x + np.cos(time) * step - 0.1 * u

    a, b = FakeSlave("a", 1, [0.0], source), FakeSlave("b", 1, [0.0], answer)
    return Network([a, b], [Link(0, 0, 1, 0, False), Link(1, 0, 0, 0, False)])


@pytest.mark.parametrize("extrapolation", EXTRAPOLATIONS)
@pytest.mark.parametrize("kind", [Jacobi, GaussSeidel])
def test_steps_are_divided_from_the_first_discarded_one_on(kind: Any, extrapolation: str) -> None:
    """The run goes back to repeat it. Rows, history and numbers of divided steps are those of Python."""
    (*_, plain), (*_, native) = run_both(refusal, lambda: kind(extrapolation))
    divided = {
        "a": {"steps": 17, "shortest_part_s": 1.0 / 128.0},
        "b": {"steps": 10, "shortest_part_s": 1.0 / 64.0},
    }
    assert plain.report()["divided_steps"] == native.report()["divided_steps"] == divided
    assert plain.remarks() == native.remarks()


def test_saved_states_are_freed(faulty_fmu: Path) -> None:
    """Those of the loop and of who may have to do halves; one of each FMU to go back to."""
    system = loop_with_a_fault(faulty_fmu, Fault.DISCARD, 0.75)
    system = wired(
        [*system.components, faulty("j.sampled", faulty_fmu)],
        *map(str, system.connections),
        "j.bad.y -> j.sampled.u",
    )
    for plain in (True, False):
        with open_system(system) as assembly:
            (counts,) = counts_of(assembly)
            algorithm = begun(assembly.network, Strong(step_multiples={"j.sampled": 2}), TIMES)
            stepping = PlainSteps(algorithm, TIMES) if plain else FixedSteps(algorithm, TIMES)
            table = Table(1 + len(assembly.network.signals))
            stepping.advance(table, 5)
            assert counts.states == 3 if plain else 3 + 4  # of the loop, and one of each to go back to
            with pytest.raises(DiscardedStepError, match=r"j.bad .* t = 0.75 s"):
                simulate(stepping, table)
            assert stepping.steps == 24
            stepping.close()
            algorithm.close()
            assert counts.states == 0
            assert counts.rollbacks > 0


# ---- where nothing can be compiled -------------------------------------------------------------


def test_without_a_compiler_there_is_one_message(faulty_fmu: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise StepperBuildError("there is no compiler for the platform 'riscv'.")

    monkeypatch.setattr("emla_cosim.stepper.library.load_stepper", fail)
    with (
        open_system(wired([faulty("j.a", faulty_fmu, u=1.0)])) as assembly,
        pytest.raises(RunError, match="steps FMUs cannot be built on this machine: there is no compiler"),
    ):
        FixedSteps(begun(assembly.network, Jacobi(), TIMES), TIMES)


# ---- the machine code is kept ------------------------------------------------------------------

_START = """
import sys
from pathlib import Path
from emla_cosim.master.algorithms.registry import Jacobi
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.faulty_systems import faulty, open_system, wired
from tests.support.simulated import simulated
system = wired([faulty("j.a", Path(sys.argv[1]), u=1.0)])
with open_system(system) as assembly:
    rows = simulated(assembly.network, Jacobi(), make_communication_points(1.0, 0.1))
assert abs(rows[-1, 1] - 1.0) < 1e-12
print(*(name in sys.modules for name in ("fmublock.compiling", "networkx")))
"""


@pytest.mark.slow
def test_second_start_needs_no_compiler(faulty_fmu: Path, tmp_path: Path) -> None:
    """Nor the library for loops of links, of which there are none."""
    site = without_prebuilt(tmp_path / "site")
    environment = {**os.environ, **site, "EMLA_COSIM_CACHE": str(tmp_path / "cache")}
    for imported in ("True False", "False False"):
        process = subprocess.run(
            [sys.executable, "-c", _START, str(faulty_fmu)],
            capture_output=True,
            text=True,
            env=environment,
            check=False,
        )
        assert process.returncode == 0, process.stderr
        assert process.stdout.strip() == imported
