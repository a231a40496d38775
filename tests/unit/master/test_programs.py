"""Programs of users: combined values, groups, sampled components, in C and by the plain stepper."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.stepper.layout import Failure
from fmublock import Block, Input, Output, Parameter, State
from tests.support.ctrl_c import interrupt_steps
from tests.support.plain_stepper import PlainStepSize

H, STEPS = 0.01, 40
WAYS = pytest.mark.parametrize("way", [{}, {"step_size_control": PlainStepSize()}], ids=["C", "plain"])


class Ramp(Block):
    """Passes its input on, and adds the time."""

    u = Input()
    k = Parameter(1.0)
    x = State(0.0)
    y = Output()

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": 1.0 + 0.0 * v.u}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": v.k * v.u + v.x}


@dataclass(eq=False)
class Written(ec.Explicit):
    """An algorithm whose program is an argument."""

    write: Callable[[Any], Sequence[Any]] = field(default=lambda network: [])

    def table(self, network: Any) -> Sequence[Any]:
        return self.write(network)

    def late(self) -> list[Any]:
        return self.network.links


def calls(instances: Sequence[int], store: str = "signals", steps: int = 0) -> list[Any]:
    """The calls of a Jacobi step, with inputs from a vector."""
    return [
        *(ec.Operation(ec.Call.SET, i, steps, store) for i in instances),
        *(ec.Operation(call, i, steps) for call in (ec.Call.STEP, ec.Call.GET) for i in instances),
    ]


def relaxed(weight: float) -> Written:
    def write(network: Any) -> list[Any]:
        positions = range(len(network.instances))
        terms = {"used": 1.0 - weight, "signals": weight}
        return [*calls(positions, "used"), *(ec.Combine(i, "used", terms) for i in positions)]

    return Written(write=write)


@pytest.fixture(scope="module")
def ring(fmu_folder: Path) -> Iterator[ec.Simulation]:
    """a.y = -1.5 b.y + t, b.y = a.y + t: Jacobi diverges, with half of the newest values it does not."""
    system = ec.System.of({"a": Ramp, "b": Ramp}, ["a.y -> b.u", "b.y -> a.u"], {"a.k": -1.5})
    with ec.load(system, fmus=fmu_folder, step_size=H, stop_time=STEPS * H).prepare() as simulation:
        yield simulation


def recursion(ring: ec.Simulation, weight: float) -> Mapping[str, np.ndarray]:
    """The values by the formula of relaxation, from the initial ones on."""
    first = ring.run(stop_time=H)
    a, b = ([float(first[name][0])] for name in ("a.y", "b.y"))
    used_a, used_b = a[0], b[0]
    for k in range(1, STEPS + 1):
        a.append(-1.5 * used_b + k * H)
        b.append(used_a + k * H)
        used_a, used_b = (1 - weight) * used_a + weight * a[k], (1 - weight) * used_b + weight * b[k]
    return {"a.y": np.array(a), "b.y": np.array(b)}


@WAYS
@pytest.mark.parametrize("weight", [1.0, 0.5])
def test_relaxation_follows_its_formula(ring: ec.Simulation, weight: float, way: dict[str, Any]) -> None:
    result = ring.run(algorithm=relaxed(weight), **way)
    for name, expected in recursion(ring, weight).items():
        np.testing.assert_allclose(result[name], expected, atol=1e-13 * np.abs(expected).max())
    assert (np.abs(result["a.y"]).max() > 2.0) == (weight == 1.0)


def test_checkpoints_have_the_vectors_of_a_program(ring: ec.Simulation, tmp_path: Path) -> None:
    expected, checkpoint = ring.run(algorithm=relaxed(0.3)), tmp_path / "half.checkpoint"
    ring.run(algorithm=relaxed(0.3), stop_time=0.2, checkpoint=checkpoint)
    rest = ring.run(algorithm=relaxed(0.3), resume=checkpoint)
    for name in ("a.y", "b.y"):
        assert rest[name].tobytes() == expected[name][-len(rest[name]) :].tobytes()


@WAYS
def test_group_of_a_program_agrees_with_strong(ring: ec.Simulation, way: dict[str, Any]) -> None:
    solved = ring.run(algorithm=Written(write=lambda network: [ec.Solve([0, 1])]), **way)
    strong = ring.run(algorithm="strong")
    for name in ("a.y", "b.y"):
        np.testing.assert_allclose(solved[name], strong[name], rtol=1e-6)
    assert solved.stepping["loops"] == [["a", "b"]]
    assert solved.stepping["sweeps_over_loops"] > STEPS


@WAYS
def test_instances_of_a_program_can_be_sampled(ring: ec.Simulation, way: dict[str, Any]) -> None:
    sampled = Written(write=lambda network: [*calls([0]), *calls([1], steps=4)])
    usual = Written(write=lambda network: [*calls([0]), *calls([1])], step_multiples={"b": 4})
    result, expected = (ring.run(algorithm=x, **way) for x in (sampled, usual))
    assert result["b.y"].tobytes() == expected["b.y"].tobytes()
    assert len(set(result["b.y"].tolist())) == STEPS // 4 + 1


@WAYS
def test_the_largest_step_multiple_never_steps(ring: ec.Simulation, way: dict[str, Any]) -> None:
    result = ring.run(algorithm="jacobi", step_multiples={"b": 2**31}, **way)
    assert len(set(result["b.y"].tolist())) == 1


@WAYS
def test_terms_are_added_in_order_and_into_the_signals(ring: ec.Simulation, way: dict[str, Any]) -> None:
    """In any other order, (0.1 + 1e16) - 1e16 would not be zero but 0.1 times the signal."""

    def write(network: Any) -> list[Any]:
        keep = ec.Combine(0, "kept", {"signals": 1.0})
        sums = ec.Combine(0, "signals", {"kept": 0.1, "signals": 1e17, "previous": 0.0, "again": -1e17})
        return [*calls([0, 1]), keep, ec.Combine(0, "again", {"signals": 1.0}), sums]

    assert not ring.run(algorithm=Written(write=write), **way)["a.y"][1:].any()


@pytest.mark.parametrize(
    ("program", "problem"),
    [
        (
            [*calls([0], store="usd"), *calls([1])],
            "reads the vector 'usd', which no Combine writes; there are",
        ),
        ([ec.Combine(0, "mine", {"sinals": 1.0})], "reads the vector 'sinals'"),
        ([ec.Combine(0, "previous", {"signals": 1.0})], "cannot write 'previous'"),
        ([ec.Combine(0, "mine", {"signals": float("nan")})], "the factor of 'signals' is nan"),
        ([ec.Combine(0, "mine", {"signals": "1"})], "the factor of 'signals' is '1'"),  # type: ignore[dict-item]
        ([ec.Combine(0, "mine", {})], "a Combine without terms has no sum"),
        ([*calls([0], steps=2), ec.Operation(ec.Call.SET, 0, 3)], "of a are done every 2, 3 steps; all need"),
        ([*calls([0], steps=-1)], "of a are done every -1 steps"),
        (
            [*calls([0], steps=2), ec.Solve([0, 1])],
            "a group needs members, and all of them without step multiples",
        ),
        ([ec.Solve([])], "a group needs members"),
        ([ec.Solve([0, 0])], "uses an instance twice"),
        ([ec.Solve([0, 2])], "uses an instance that does not exist; their numbers are 0 to 1"),
        ([ec.Operation(ec.Call.STEP, -1)], "uses an instance that does not exist; their numbers are 0 to 1"),
        (
            [ec.Combine(2, "mine", {"signals": 1.0})],
            "uses an instance that does not exist; their numbers are 0 to 1",
        ),
        ([ec.Operation(7, 0)], "7 is not a Call"),  # type: ignore[arg-type]
        ([(ec.Call.STEP, 0)], "is not an Operation, a Solve or a Combine"),
    ],
)
def test_invalid_programs_are_refused(ring: ec.Simulation, program: list[Any], problem: str) -> None:
    with pytest.raises(ec.CommandError, match=problem):
        ring.run(algorithm=Written(write=lambda network: program))


@pytest.mark.slow
def test_program_is_exported_unchanged(ring: ec.Simulation, fmu_folder: Path, tmp_path: Path) -> None:
    """With vectors of its own, and components that it samples."""

    def write(network: Any) -> list[Any]:
        first, second = (calls([i], "used", steps_at_once) for i, steps_at_once in ((0, 1), (1, 2)))
        terms = {"used": 0.3, "signals": 0.7}
        return [*first, *second, *(ec.Combine(i, "used", terms) for i in (0, 1))]

    system = ec.System.of({"a": Ramp, "b": Ramp}, ["a.y -> b.u", "b.y -> a.u"], {"a.k": 0.5})
    times = {"step_size": H, "stop_time": STEPS * H}
    scenario = ec.load(system, fmus=fmu_folder, algorithm=Written(write=write), **times)
    with scenario.prepare() as simulation:
        run = simulation.run()
    fmu = scenario.export(tmp_path / "x.fmu")
    rows = fmpy.simulate_fmu(str(fmu), stop_time=STEPS * H, step_size=H, output_interval=H)
    for name in ("a.y", "b.y"):
        assert np.array_equal(rows[name], run[name])


def test_program_that_combines_is_not_plain_c(tmp_path: Path) -> None:
    system = ec.System.of({"a": Ramp, "b": Ramp}, ["a.y -> b.u"])
    with pytest.raises(ec.CommandError, match="plain C cannot combine values as Written does"):
        ec.load(system, algorithm=relaxed(0.5), step_size=H, stop_time=1.0).export(
            tmp_path / "x.c", components=["*"]
        )


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_signal_ends_the_steps_immediately(ring: ec.Simulation) -> None:
    """Not after a second of wall time, when the steps end in any case."""
    with pytest.MonkeyPatch.context() as patch:
        ends = interrupt_steps(patch)
        result = ring.attempt(algorithm=relaxed(0.5), stop_time=1e6, recorders=[])
    assert result.interrupted
    assert ends[-1] == Failure.INTERRUPTED
