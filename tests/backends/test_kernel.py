"""The compiled stepping gives the same bits as the algorithms in Python, whatever it steps."""

import ctypes
import itertools
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.fmu.models import fmu_path
from emla_cosim.master.algorithms.explicit import Explicit
from emla_cosim.master.algorithms.extrapolation import EXTRAPOLATIONS
from emla_cosim.master.algorithms.gauss_seidel import GaussSeidel
from emla_cosim.master.algorithms.jacobi import Jacobi
from emla_cosim.master.algorithms.operation_table import OperationTableAlgorithm
from emla_cosim.master.algorithms.strong import Strong
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.instances.fmu_instance import InstanceError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.run_loop import simulate
from emla_cosim.master.stepping import kernel
from emla_cosim.master.stepping.compilation import compile_kernel
from emla_cosim.master.stepping.fixed_steps import FixedSteps
from emla_cosim.master.stepping.timing import CommunicationPoints, make_communication_points
from emla_cosim.study.loading import load
from emla_cosim.system.model import Component, System
from tests.support.faulty_fmu import build_faulty_fmu
from tests.support.faulty_systems import faulty, open_system, wired
from tests.support.lanes import in_lanes
from tests.support.simulated import Table, begun, recorded
from tests.support.slaves import FakeSlave, compilable
from tests.support.tiers import examples, mostly_slow

EXPLICIT: tuple[type[Explicit], ...] = (Jacobi, GaussSeidel)
KINDS: tuple[type[OperationTableAlgorithm], ...] = (*EXPLICIT, Strong)
STEPPING = "emla_cosim.master.stepping"
Make = Callable[[], OperationTableAlgorithm]


def rows(
    network: Network,
    make: Make,
    times: CommunicationPoints,
    *,
    compiled: bool,
    every: int = 1,
    room: int = 7,
    shared: int | None = None,
) -> np.ndarray:
    """All rows of a run in this way and no other; `shared` is the seed by which threads share its steps."""
    stepping = FixedSteps(begun(network, make(), times), times, compiled)
    assert stepping.is_compiled == compiled
    if shared is not None:
        in_lanes(stepping, shared)
    return recorded(stepping, every, room=room)


def assert_same_bits(found: np.ndarray, expected: np.ndarray) -> None:
    assert found.shape == expected.shape
    assert (found.view("i8") == expected.view("i8")).all()


# ---- our own FMUs ------------------------------------------------------------------------------


def study_rows(
    folder: Path,
    make: Make,
    steps: int,
    *,
    compiled: bool,
    every: int = 1,
    flavour: str = "native",
    shared: int | None = None,
) -> np.ndarray:
    system = load("study").system
    fmus = {c.name: fmu_path(c.model, flavour, folder) for c in system.components}
    with Assembly(system, fmus) as assembly:
        times = make_communication_points(steps * 1e-4, 1e-4)
        return rows(assembly.network, make, times, compiled=compiled, every=every, shared=shared)


SLOWER = {"lift.controller": 2, "tilt.observer": 3, "tilt.reference": 6}
WAYS = [(kind, way, multiples) for multiples in ({}, SLOWER) for way in EXTRAPOLATIONS for kind in KINDS]


@pytest.mark.parametrize(("kind", "extrapolation", "multiples"), mostly_slow(WAYS, WAYS[::2]))
def test_the_study_has_the_same_bits(
    kind: type[OperationTableAlgorithm], extrapolation: str, multiples: Mapping[str, int], fmu_folder: Path
) -> None:
    def make() -> OperationTableAlgorithm:
        return kind(extrapolation, multiples)

    expected = study_rows(fmu_folder, make, 42, compiled=False)
    assert np.isfinite(expected).all() and np.ptp(expected, axis=0).any()
    assert_same_bits(study_rows(fmu_folder, make, 42, compiled=True), expected)
    for seed in range(3):
        assert_same_bits(study_rows(fmu_folder, make, 42, compiled=True, shared=seed), expected)
    for compiled in (False, True):
        assert_same_bits(study_rows(fmu_folder, make, 42, compiled=compiled, every=7), expected[::7])


def test_pythonfmu_has_the_same_bits_compiled(python_fmu_folder: Path) -> None:
    expected = study_rows(python_fmu_folder, GaussSeidel, 10, compiled=False)
    assert_same_bits(
        study_rows(python_fmu_folder, GaussSeidel, 10, compiled=True, flavour="python"), expected
    )


# ---- networks of all kinds ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def fmus(faulty_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A FMU that takes derivatives of inputs, and one that does not."""
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


@examples(30, 100)
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
    every, room = data.draw(st.integers(1, 7), label="every"), data.draw(st.integers(1, 5), label="room")
    times = make_communication_points(1.2, 0.05)
    found, seed = [], data.draw(st.integers(0, 99), label="share")
    for compiled, shared in ((False, None), (True, None), (True, seed)):
        with open_system(system, transformations) as assembly:
            assembly.network.reorder(order)
            found.append(
                rows(
                    assembly.network,
                    lambda: kind(extrapolation, multiples),
                    times,
                    compiled=compiled,
                    every=every,
                    room=room,
                    shared=shared,
                )
            )
    expected, *fast = found
    assert len(expected) == 24 // every + 1
    for rows_of_one in fast:
        assert_same_bits(rows_of_one, expected)


@pytest.mark.parametrize("room", [1, 2, 3, 1000])
def test_the_room_for_rows_does_not_matter(room: int, faulty_fmu: Path) -> None:
    system = wired([faulty("j.a", faulty_fmu, u=1.0), faulty("j.b", faulty_fmu, b=0.5)], "j.a.y -> j.b.u")
    times = make_communication_points(10.0, 0.05)
    found = []
    for compiled, space in ((False, 7), (True, room)):
        with open_system(system) as assembly:
            found.append(rows(assembly.network, Jacobi, times, compiled=compiled, every=3, room=space))
    assert len(found[0]) == 200 // 3 + 1
    assert_same_bits(*found)


@pytest.mark.parametrize(
    "block",
    [np.empty((4, 3)), np.empty((5, 2)), np.empty((5, 3), order="F"), np.empty((5, 3), dtype="f4")],
    ids=["few", "narrow", "by column", "single precision"],
)
def test_rows_that_do_not_fit_are_not_written_to(block: np.ndarray, faulty_fmu: Path) -> None:
    times = make_communication_points(1.0, 0.1)
    with open_system(wired([faulty("j.a", faulty_fmu, u=1.0)])) as assembly:
        algorithm = begun(assembly.network, Jacobi(), times)
        loop = compile_kernel(algorithm)
        assert loop is not None
        with pytest.raises(ValueError, match="5 times 3 contiguous doubles"):
            loop.run(0, 10, times.clock, 2, block)
        assert algorithm.steps == 0


def failing_at_the_fourth_call(slave: FakeSlave, function: str) -> None:
    original, answers = slave.entry_points, itertools.chain([0, 1, 0], itertools.repeat(4))
    points = original()
    assert points is not None
    answer = ctypes.CFUNCTYPE(ctypes.c_int)(lambda: next(answers))  # whatever the arguments
    changed = replace(points, **{function: ctypes.cast(answer, ctypes.c_void_p).value})
    slave.entry_points = lambda alive=(answer, original): changed


@pytest.mark.parametrize("kind", EXPLICIT)
@pytest.mark.parametrize(
    ("function", "call"),
    [
        ("set_real", "setReal"),
        ("set_real_input_derivatives", "setRealInputDerivatives"),
        ("do_step", "doStep at t = 0.3 s"),
        ("get_real", "getReal"),
    ],
)
def test_a_function_that_fails_is_named(function: str, call: str, kind: type[Explicit]) -> None:
    slaves = [FakeSlave(name, 1, [1.0], lambda u, x, t, h: x) for name in "abc"]
    for slave in slaves:
        slave.interpolates = True
        slave.set_input_derivatives = lambda derivatives: None
        compilable(slave)
    failing_at_the_fourth_call(slaves[1], function)
    times, table = make_communication_points(1.0, 0.1), Table(4)
    system = Network(slaves, [Link(i, 0, (i + 1) % 3, 0, False) for i in range(3)])
    stepping = FixedSteps(begun(system, kind("fmu"), times), times)
    assert stepping.is_compiled
    with pytest.raises(InstanceError) as caught:
        simulate(stepping, table)
    assert str(caught.value) == f"b answered {call} with status 4."
    assert stepping.steps == len(table.rows) == 3


# ---- where nothing can be compiled -------------------------------------------------------------


def test_without_numba_everything_is_stepped_in_python(
    faulty_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    times, found = make_communication_points(1.0, 0.1), []
    for compiled in (True, False):
        if not compiled:
            kernel._advance.cache_clear()
            monkeypatch.delitem(sys.modules, f"{STEPPING}.loop", raising=False)
            monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path))
            monkeypatch.setitem(sys.modules, "numba", None)
        with open_system(wired([faulty("j.a", faulty_fmu, u=1.0)])) as assembly:
            stepping = FixedSteps(begun(assembly.network, Jacobi(), times), times)
            assert stepping.is_compiled == compiled
            found.append(recorded(stepping))
    assert_same_bits(*found)


def test_a_slave_without_entry_points_is_stepped_in_python() -> None:
    times, slave = make_communication_points(1.0, 0.1), FakeSlave("s", 1, [1.0], lambda u, x, t, h: x + u)
    stepping = FixedSteps(begun(Network([slave], [Link(0, 0, 0, 0, False)]), GaussSeidel(), times), times)
    assert not stepping.is_compiled
    assert recorded(stepping)[-1, 1] == 2.0**10


# ---- the machine code is kept ------------------------------------------------------------------

_START = """
import sys
from pathlib import Path
from emla_cosim.master.algorithms.jacobi import Jacobi
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.faulty_systems import faulty, open_system, wired
from tests.support.lanes import in_lanes
from tests.support.simulated import simulated
system = wired([faulty("j.a", Path(sys.argv[1]), u=1.0)])
with open_system(system) as assembly:
    rows = simulated(assembly.network, Jacobi(), make_communication_points(1.0, 0.1))
assert abs(rows[-1, 1] - 1.0) < 1e-12
print("numba" in sys.modules, "networkx" in sys.modules)
"""


def test_the_second_start_needs_no_compiler(faulty_fmu: Path, tmp_path: Path) -> None:
    """Nor the library for loops of links, of which there are none."""
    environment = {**os.environ, "EMLA_COSIM_CACHE": str(tmp_path)}
    for imported in ("True False", "False False"):
        done = subprocess.run(
            [sys.executable, "-c", _START, str(faulty_fmu)],
            capture_output=True,
            text=True,
            env=environment,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == imported
