"""Model Exchange FMUs of FMI 3.0: the bits of FMI 2.0, whose results other tests compare with exact ones."""

import dataclasses
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

import emla_cosim as ec
import fmublock
from emla_cosim.base.errors import CommandError, RunError
from fmublock import Block, Input, Output, State
from tests.oracles.test_integration import SOURCE, assert_is_that_of_fmpy, bouncing
from tests.support.handwritten_fmu import build_handwritten_fmu

SOURCE_3 = SOURCE.parents[1] / "integrated3" / "integrated3.c"
CLOCK = """<Clock name="tick" valueReference="30" causality="input" intervalVariability="constant"
                  intervalDecimal="1"/>"""
STEP, STOP = 0.05, 1.0
Fmus = Mapping[int, Path]


def build_3(path: Path, clock: str = "", indicators: int = 1, rollback: str = "true") -> Path:
    placeholders = {"rollback": rollback, "input": "continuous", "clock": clock}
    return build_handwritten_fmu(
        path, SOURCE_3, placeholders, {"INDICATORS": indicators}, platform=fmpy.platform_tuple
    )


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Fmus:
    """The same model by version: x' = u - x, y = x + gain u, a bouncing ball and a stair."""
    folder = tmp_path_factory.mktemp("versions")
    placeholders = {"rollback": "true", "input": "continuous"}
    two = build_handwritten_fmu(folder / "2" / "Integrated.fmu", SOURCE, placeholders)
    return {2: two, 3: build_3(folder / "3" / "Integrated.fmu")}


def run(source: Any, **options: Any) -> ec.Result:
    given = {"step_size": STEP, "output_interval": STEP, "stop_time": STOP, **options}
    with ec.load(source, **given).prepare() as simulation:
        return simulation.run()


def check_bits(two: ec.Result, three: ec.Result) -> None:
    assert two.names == three.names
    assert len(two["time"]) > 1
    for name in ("time", *two.names):
        assert two[name].tobytes() == three[name].tobytes(), name


def rotating(a: Path, b: Path, **values: float) -> ec.System:
    """a' = -a - b, b' = a - b, each also with its own ball and stair."""
    start = {name.replace("__", "."): value for name, value in values.items()}
    system = ec.System.of({"a": a, "b": b}, ["a.x -> b.u", "b.x -> a.u"], set={"b.x": 0.0, **start})
    first, second = system.connections
    second = dataclasses.replace(second, transformation=ec.LinearTransformation(-1.0))
    return dataclasses.replace(system, connections=(first, second))


ALONE = {"limit": 0.5, "u": 2.0, "x": 0.0}
"""Start values with which x is reset by step events."""


@pytest.mark.parametrize("integrator", ["bdf", "adams"])
def test_time_state_and_step_events_have_the_same_bits(integrator: str, fmus: Fmus) -> None:
    values = {f"Integrated.{name}": value for name, value in ALONE.items()}
    two, three = (
        run(fmus[version], set=values, integrator=integrator, fmi_tolerance=1e-8) for version in (2, 3)
    )
    check_bits(two, three)
    assert three["Integrated.resets"][-1] == 3.0
    assert three["Integrated.stair"][-1] in (9.0, 10.0)
    assert three["Integrated.h"] == pytest.approx(bouncing(three["time"]), abs=1e-7)
    kinds = {of["kind"] for of in three.record["components"].values()}
    assert kinds == {"ModelExchange"}


def test_agrees_with_fmpy(fmus: Fmus) -> None:
    step, stop = 0.017, 50 * 0.017
    found = run(fmus[3], step_size=step, output_interval=step, stop_time=stop, fmi_tolerance=1e-7)
    assert_is_that_of_fmpy(found, fmus[3], step, stop)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"integrate_together": False, "algorithm": "strong", "extrapolation": "master"},
        {"integrate_together": False, "extrapolation": "fmu", "error_tolerance": 1e-3},
        {"isolate": ["b"], "algorithm": "strong", "extrapolation": "fmu"},
    ],
    ids=["group", "strong", "error-control", "isolated"],
)
def test_coupled_fmus_of_any_version_have_the_same_bits(options: Mapping[str, Any], fmus: Fmus) -> None:
    first, *others = (
        run(rotating(fmus[a], fmus[b]), fmi_tolerance=1e-6, **options) for a, b in ((2, 2), (3, 3), (2, 3))
    )
    for other in others:
        check_bits(first, other)
    t = first["time"]
    assert first["a.x"] == pytest.approx(np.exp(-t) * np.cos(t), abs=1e-2 if options else 1e-5)


def test_a_loop_without_delay_is_solved(fmus: Fmus) -> None:
    systems = (
        ec.System.of(
            {"a": fmus[n], "b": fmus[n]}, ["a.y -> b.u", "b.y -> a.u"], set={"a.gain": 0.5, "b.gain": -3.0}
        )
        for n in (2, 3)
    )
    check_bits(*(run(system) for system in systems))


def test_resumes_and_runs_again_with_the_same_bits(fmus: Fmus, tmp_path: Path) -> None:
    whole = {n: run(rotating(fmus[n], fmus[n]), checkpoint=tmp_path / f"{n}.npz") for n in (2, 3)}
    check_bits(whole[2], whole[3])
    system = rotating(fmus[3], fmus[3])
    run(system, stop_time=0.5, checkpoint=tmp_path / "half.npz")
    rest = run(system, resume=tmp_path / "half.npz")
    for name in rest.names:
        assert np.array_equal(whole[3][name][-len(rest[name]) :], rest[name]), name
    with ec.load(system, step_size=STEP, stop_time=STOP, output_interval=STEP).prepare() as simulation:
        first, second = simulation.run(), simulation.run()
    check_bits(first, second)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"end": 3.0}, r"asked to end the simulation during updateDiscreteStates at t = 0\.3"),
        ({"end": -1.0}, r"answered updateDiscreteStates at t = 0 s with nextEventTime = NaN"),
        ({"fails": 0.5}, "cannot be integrated at t = "),
    ],
)
def test_failures_name_the_functions_of_fmi_3(values: Mapping[str, float], message: str, fmus: Fmus) -> None:
    with pytest.raises(RunError, match=message):
        run(fmus[3], set={f"Integrated.{name}": value for name, value in values.items()})


def test_another_number_of_event_indicators_is_reported(tmp_path: Path) -> None:
    path = build_3(tmp_path / "Integrated.fmu", indicators=2)
    with pytest.raises(RunError, match="getNumberOfEventIndicators with 2, and its model description has 1"):
        run(path)


def test_clocks_are_refused(tmp_path: Path) -> None:
    path = build_3(tmp_path / "Integrated.fmu", clock=CLOCK)
    with pytest.raises(
        CommandError, match=r"has the clock 'tick', and clocks are supported for co-simulation only\.$"
    ):
        run(path)
    (note,) = ec.info(path).notes
    assert note.startswith("the FMU cannot be run here: it has the clock 'tick'")


def test_rollback_needs_states(tmp_path: Path) -> None:
    path = build_3(tmp_path / "Integrated.fmu", rollback="false")
    with pytest.raises(CommandError, match="canGetAndSetFMUstate"):
        run(rotating(path, path), integrate_together=False, error_tolerance=1e-3)


class Springs(Block):
    """Two masses on springs, each with a force."""

    F = Input([0.25, -0.5], shape=2)
    x = State([0.1, -0.2], shape=2)
    w = State([0.0, 0.3], shape=2)
    y = Output(shape=3)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {
            "x": [v.w[0], v.w[1]],
            "w": [v.F[0] - 4.0 * v.x[0] - 0.1 * v.w[0], v.F[1] - 9.0 * v.x[1] - 0.2 * v.w[1]],
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": [v.x[0], v.x[1] + 0.5 * v.F[1], v.x[0] - v.w[1]]}


@pytest.fixture(scope="module")
def springs(tmp_path_factory: pytest.TempPathFactory) -> Fmus:
    folder = tmp_path_factory.mktemp("springs")
    return {n: fmublock.build(Springs, folder / str(n) / "Springs.fmu", fmi=n) for n in (2, 3)}


ELEMENTS = ["a.y[1] -> b.F[2]", "b.y[2] -> a.F[1]"]
WHOLE = [f"{source}.x[{i}] -> {target}.F[{i}]" for source, target in ("ab", "ba") for i in (1, 2)]
MIXED = ["a.y[2] -> b.F[2]", "b.y[2] -> a.F[2]", "c.y[3] -> a.F[1]", "a.y[1] -> c.F[2]"]
"""In the group of a and b, one element of a.F comes from b, and the other one from outside."""


@pytest.mark.parametrize(
    ("connections", "options"),
    [
        (ELEMENTS, {}),
        (WHOLE, {}),
        (MIXED, {"isolate": ["c"], "algorithm": "strong"}),
    ],
)
def test_arrays_are_connected_and_integrated_by_element(
    connections: list[str], options: Mapping[str, Any], springs: Fmus
) -> None:
    names = sorted(set(itertools.chain(*((c[0], c[c.index("> ") + 2]) for c in connections))))
    given = {"kind": {"*": "me"}, "set": {"a.x[2]": 0.7}, **options}
    two, three = (run(ec.System.of(dict.fromkeys(names, springs[n]), connections), **given) for n in (2, 3))
    check_bits(two, three)
    grouped = [] if given.get("integrate_together") is False else [["a", "b"]]
    assert three.record["stepping"].get("integrated_together", []) == grouped
    assert np.ptp(three["b.x[2]"]) > 0.01


def test_an_input_that_a_user_changes_keeps_its_value(springs: Fmus) -> None:
    found = []
    for n in (2, 3):
        system = ec.System.of({"a": springs[n], "b": springs[n]}, ELEMENTS)
        with ec.load(system, kind={"*": "me"}, step_size=STEP, stop_time=STOP).prepare() as simulation:
            simulation.advance(0.5)
            simulation["b.F[1]"] = 3.0
            simulation.advance(STOP)
            found.append([simulation[name] for name in ("a.x[1]", "b.x[1]", "b.x[2]", "b.F[1]")])
    assert found[0] == found[1]
    assert found[1][3] == 3.0


def test_state_matrices_are_those_of_fmi_2(springs: Fmus) -> None:
    options = {"kind": {"*": "me"}, "step_size": STEP, "stop_time": 0.1, "matrices": True}
    two, three = (
        ec.linearize(
            ec.System.of({"a": springs[n], "b": springs[n]}, ELEMENTS),
            perturb=["b.F[1]", "a.F[1]"],
            read=["a.y[3]", "b.y[2]"],
            **options,
        )
        for n in (2, 3)
    )
    assert two.matrices.states == three.matrices.states
    for name in "ABCD":
        assert getattr(two.matrices, name).tobytes() == getattr(three.matrices, name).tobytes(), name


def test_strong_loops_through_elements_converge_to_those_of_fmi_2(springs: Fmus) -> None:
    """Not to the bit: dependencies are those of whole arrays, whose parts have no directional derivatives."""
    given = {"kind": {"*": "me"}, "integrate_together": False, "algorithm": "strong"}
    systems = (ec.System.of(dict.fromkeys("ab", springs[n]), ELEMENTS) for n in (2, 3))
    two, three = (run(system, **given) for system in systems)
    for name in two.names:
        assert three[name] == pytest.approx(two[name], abs=1e-5), name
