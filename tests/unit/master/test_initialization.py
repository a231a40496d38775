"""Initial values come through whatever the order, and loops of them are solved."""

import contextlib
import math
import zipfile
from collections.abc import Callable
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.base.errors import RunError
from emla_cosim.master.algorithms.registry import GaussSeidel, Jacobi
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.faulty_systems import faulty, line_with_a_fault, open_system, run_system, wired
from tests.support.hand_written_fmus import Fault
from tests.support.simulated import begun
from tests.support.slaves import FakeSlave

TIMES = make_communication_points(1.0, 0.1)


def gate(
    name: str, inputs: int, output: Callable[[np.ndarray], float], calls: list[str] | None = None
) -> FakeSlave:
    """A slave whose output is a function of its inputs."""
    return FakeSlave(name, inputs, [0.0], lambda u, x, t, h: x, lambda u, x: [output(u)], calls)


def link(source: int, target: int, element: int = 0) -> Link:
    return Link(source, 0, target, element, True)


def initial(network: Network) -> np.ndarray:
    """The signals after initialization."""
    begun(network, Jacobi(), TIMES)
    return network.signals


# ---- without loops -----------------------------------------------------------------------------


@given(data=st.data())
def test_values_pass_through_any_graph_without_loops(data: st.DataObject) -> None:
    count = data.draw(st.integers(2, 8), label="count")
    reads = [data.draw(st.sets(st.integers(0, i - 1))) if i else set() for i in range(count)]
    order = data.draw(st.permutations(range(count)), label="order")
    gates = [gate(f"g{i}", len(r), lambda u, i=i: i + 1.0 + float(u.sum())) for i, r in enumerate(reads)]
    position = [order.index(i) for i in range(count)]
    links = [link(position[s], position[i], k) for i, r in enumerate(reads) for k, s in enumerate(sorted(r))]
    expected: list[float] = []
    for i, sources in enumerate(reads):
        expected.append(i + 1.0 + sum(expected[s] for s in sources))
    assert initial(Network([gates[i] for i in order], links))[position].tolist() == expected


def test_a_graph_without_loops_needs_no_second_round() -> None:
    """Outputs are read in the round and after it; inputs are set in it, after it and at its end."""
    calls: list[str] = []
    names = ["c", "b", "a"]
    gates = [gate(name, int(name != "a"), lambda u: float(u.sum()) + 1.0, calls) for name in names]
    assert initial(Network(gates, [link(1, 0), link(2, 1)])).tolist() == [3.0, 2.0, 1.0]
    for name in names:
        assert [calls.count(f"{name}.{call}") for call in ("enter", "set", "get", "exit")] == [1, 3, 2, 1]
    in_the_round = calls[: min(calls.index(f"{name}.exit") for name in names)]
    assert [c for c in in_the_round if c.endswith(".get")] == ["a.get", "b.get", "c.get"]


def test_start_values_are_used_until_sources_have_values() -> None:
    """Nothing but its own start value is set before the source has given a value."""
    inputs_seen: list[float] = []
    a = gate("a", 1, lambda u: [inputs_seen.append(u[0]), 5.0][1], [])
    a.inputs[:] = 7.0
    b = gate("b", 1, lambda u: 2.0 * u[0], [])
    links = [Link(0, 0, 1, 0, True, initial=True), Link(1, 0, 0, 0, False, initial=False)]
    initial(Network([a, b], links))
    del inputs_seen[: inputs_seen.index(7.0)]
    assert set(inputs_seen) == {7.0, 10.0}


def without_initial_unknowns(fmu: Path, path: Path, outputs: bytes | None = None) -> Path:
    """The same FMU, which says nothing of what its initial values depend on; and other things of outputs."""
    with zipfile.ZipFile(fmu) as original, zipfile.ZipFile(path, "w") as silent:
        for name in original.namelist():
            content = original.read(name)
            if name == "modelDescription.xml":
                before, _, rest = content.partition(b"<InitialUnknowns>")
                content = before + rest.partition(b"</InitialUnknowns>")[2]
                assert len(content) < len(original.read(name))
                if outputs is not None:
                    before, begins, rest = content.partition(b"<Outputs>")
                    content = before + begins + outputs + b"</Outputs>" + rest.partition(b"</Outputs>")[2]
            silent.writestr(name, content)
    return path


def test_dependencies_that_are_not_declared_are_followed(faulty_fmu: Path, tmp_path: Path) -> None:
    silent = without_initial_unknowns(faulty_fmu, tmp_path / "silent.fmu")
    system = wired(
        [
            faulty("j.c", silent, b=5.0),
            faulty("j.b", silent, b=3.0),
            faulty("j.a", silent, b=2.0, u=1.0),
            faulty("j.d", silent, b=7.0),
        ],
        "j.a.y -> j.b.u",
        "j.b.y -> j.c.u",
        "j.d.z -> j.d.u",
    )
    with open_system(system) as assembly:
        values = dict(zip(assembly.network.names, initial(assembly.network), strict=True))
    assert {name: values[f"j.{name}.y"] for name in "abcd"} == {"a": 2.0, "b": 6.0, "c": 30.0, "d": 0.0}


@pytest.mark.parametrize(
    "outputs",
    [None, b'<Unknown index="6" dependencies=""/><Unknown index="7" dependencies=""/>'],
    ids=["outputs as they are", "in the initial values alone"],
)
def test_loops_that_are_not_declared_are_solved(
    outputs: bytes | None, faulty_fmu: Path, tmp_path: Path
) -> None:
    """What outputs depend on after a step says nothing of their initial values."""
    silent = without_initial_unknowns(faulty_fmu, tmp_path / "silent.fmu", outputs)
    system = wired(
        [faulty("j.a", silent, b=0.5), faulty("j.b", silent, b=3.0)], "j.a.y -> j.b.u", "j.b.y -> j.a.u"
    )
    with open_system(system, [(1.0, 1.0), (1.0, 0.0)]) as assembly:
        assert any(x.direct for x in assembly.network.links) == (outputs is None)
        values = dict(zip(assembly.network.names, initial(assembly.network), strict=True))
    # y_a = 0.5 y_b and y_b = 3 (y_a + 1)
    assert (values["j.a.y"], values["j.b.y"]) == pytest.approx((-3.0, -6.0))


# ---- loops -------------------------------------------------------------------------------------


def ring(output: Callable[[float], float]) -> Network:
    """y = f(y), closed through another slave that passes the value on."""
    return Network(
        [gate("a", 1, lambda u: output(u[0])), gate("b", 1, lambda u: u[0])], [link(1, 0), link(0, 1)]
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("start", "offset"), [(0.0, 1e-3), (-3e5, 1.0), (0.0, 2e6)])
@pytest.mark.parametrize("gain", [0.0, 1e-6, 0.5, 1.0 - 1e-6, 1.0 + 1e-6, 2e4, 1e12])
def test_linear_loop_of_any_gain_is_solved(sign: float, gain: float, offset: float, start: float) -> None:
    """A load of 20,000 times the driving mass is such a loop; the error is that of one rounded evaluation."""
    a = sign * gain
    network = ring(lambda u: a * u + offset)
    network.instances[0].inputs[:] = start
    exact, eps = offset / (1.0 - a), np.finfo(float).eps
    rounding = 8.0 * eps * (abs(a * exact) + abs(offset)) * max(1.0, 1.0 / abs(1.0 - a))
    assert initial(network) == pytest.approx([exact] * 2, rel=1e-10, abs=rounding)


@pytest.mark.parametrize("size", [2, 3, 5])
@pytest.mark.parametrize("seed", range(2))
def test_small_linear_systems_of_mixed_scales_are_solved(size: int, seed: int) -> None:
    """Newtons beside micrometres: gains between 1e-6 and 1e6."""
    random = np.random.default_rng(seed)
    scale = 10.0 ** random.uniform(-3.0, 3.0, size)
    A = random.normal(size=(size, size)) * scale[:, None] / scale
    A *= 10.0 ** random.uniform(-2.0, 2.0)
    b = random.normal(size=size) * scale
    gates = [gate(f"g{i}", size, lambda u, i=i: float(A[i] @ u + b[i])) for i in range(size)]
    solution = initial(Network(gates, [link(s, t, s) for t in range(size) for s in range(size)]))
    assert solution / scale == pytest.approx(np.linalg.solve(np.eye(size) - A, b) / scale, rel=1e-8)


def test_a_neutral_direction_does_not_hide_the_solution_of_the_others() -> None:
    """a = a keeps its start value; b = 1 + a - 0.5 b is solved beside it."""
    a = gate("a", 1, lambda u: u[0])
    a.inputs[:] = 3.0
    b = gate("b", 2, lambda u: 1.0 + u[0] - 0.5 * u[1])
    b.inputs[0] = 3.0
    network = Network([a, b], [link(0, 0), link(0, 1), link(1, 1, 1)])
    assert initial(network) == pytest.approx([3.0, 8.0 / 3.0], rel=1e-12)


@pytest.mark.parametrize(
    "output",
    [
        math.cos,
        lambda u: math.exp(-3.0 * u),
        lambda u: 10.0 + 5.0 * math.tanh(u),
        lambda u: 1.0 / (1.0 + u * u) - 4.0 * u,
    ],
)
def test_nonlinear_loops_are_solved(output: Callable[[float], float]) -> None:
    y, _ = initial(ring(output))
    assert y == pytest.approx(output(y), rel=1e-11)


def test_huge_iterate_is_not_returned_as_solution() -> None:
    """The search for the solution 1 comes past 1e17, beside which every difference looks small."""
    with contextlib.suppress(RunError):
        assert initial(ring(lambda u: 2.0 - u**3)) == pytest.approx([1.0, 1.0])


def test_loop_after_a_loop_uses_its_solution() -> None:
    """a = b - 1 and b = 2 a give a = 1, b = 2; then c = d + b and d = 3 c give c = -1."""
    a, b = gate("a", 1, lambda u: u[0] - 1.0), gate("b", 1, lambda u: 2.0 * u[0])
    c, d = gate("c", 2, lambda u: u[0] + u[1]), gate("d", 1, lambda u: 3.0 * u[0])
    links = [link(0, 2, 1), link(1, 0), link(3, 2), link(2, 3), link(0, 1)]
    solution = initial(Network([a, b, c, d], links))
    assert solution == pytest.approx([1.0, 2.0, -0.5, -1.5], rel=1e-10)


@pytest.mark.parametrize("change", [1.0, -1.0])
def test_loop_without_a_solution_is_named(change: float) -> None:
    a, b = gate("a", 1, lambda u: u[0] + change), gate("b", 1, lambda u: u[0])
    bystander = gate("bystander", 0, lambda u: 1.0)
    with pytest.raises(
        RunError,
        match=r"^the initial values of the loop a -> b -> a have no solution: the gain around "
        r"the loop is 1 for b\[0\], so a difference of 1 always remains\.",
    ):
        begun(Network([a, bystander, b], [link(2, 0), link(0, 2)]), GaussSeidel(), TIMES)


# ---- values that are not numbers ---------------------------------------------------------------


def test_nan_of_a_loop_is_named() -> None:
    with pytest.raises(RunError, match=r"loop a -> b -> a .*: b\[0\] became infinite or NaN\."):
        initial(ring(lambda u: math.nan))


def test_initial_nan_ends_the_run(faulty_fmu: Path, tmp_path: Path) -> None:
    result = run_system(line_with_a_fault(faulty_fmu, Fault.NAN_Y, -1.0), tmp_path)
    assert result.problem == "the run ended at t = 0 s: j.bad.y became nan at t = 0 s."
    assert len((tmp_path / "results.csv").read_text().splitlines()) == 1
