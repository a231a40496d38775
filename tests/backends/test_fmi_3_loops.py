"""FMI 3.0 FMUs in compiled loops: the bits, the rows and the errors of Python, and the bytes of FMI 2.0."""

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import polars as pl
import pytest

import emla_cosim as ec
import fmublock
from emla_cosim.base.errors import RunError
from emla_cosim.fmu.file import open_fmu
from emla_cosim.fmu.fmi_3_calls import DISCARD, ERROR, StepEnd
from emla_cosim.fmu.log import FmuLog
from emla_cosim.master.instances.call_codes import code_of, decode_call
from emla_cosim.master.instances.instance_kinds import make_instance
from emla_cosim.sandbox import black_box
from emla_cosim.system.model import System
from fmublock import Block, Input, Output, Parameter, State
from tests.support.commands import Emla, sentence
from tests.support.handwritten_fmu import build_handwritten_fmu
from tests.support.paths import SUPPORT
from tests.support.tiers import mostly_slow
from tests.support.two_masses import DAMPING, MASS, STIFFNESS, rigid_solution

SOURCE = SUPPORT / "fmi3" / "fmi3.c"
DISCARDS, TERMINATES, RETURNS_EARLY, WANTS_EVENT = 1, 2, 3, 4
STEP, STOP = 0.125, 2.0
LOAD = 0.5
ALGORITHMS = ["jacobi", "gauss-seidel", "strong"]


class Mass(Block):
    """A mass on a spring with a damper; its motion is one vector."""

    F = Input(description="Force")
    x = State(0.1, description="Displacement")
    w = State(0.0, description="Speed")
    motion = Output(shape=3, description="Displacement, speed and acceleration")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.w, "w": (v.F - STIFFNESS * v.x - DAMPING * v.w) / MASS}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"motion": [v.x, v.w, (v.F - STIFFNESS * v.x - DAMPING * v.w) / MASS]}


class Load(Block):
    """A second mass that is fixed to the first."""

    motion = Input(shape=3)
    m = Parameter(LOAD)
    F = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"F": -v.m * v.motion[2]}


@pytest.fixture(scope="module")
def third(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("fmi3") / "Third.fmu"
    return build_handwritten_fmu(file, SOURCE, platform=fmpy.platform_tuple)


Masses = Mapping[str, Mapping[str, Path]]


@pytest.fixture(scope="module")
def masses(tmp_path_factory: pytest.TempPathFactory) -> Masses:
    """The FMUs of systems by the versions of their FMUs: all 2, all 3, and mixed."""
    built = {}
    for version in (2, 3):
        folder = tmp_path_factory.mktemp(f"fmi{version}")
        for block in (Mass, Load):
            name = block.__name__.lower()
            built[name, version] = fmublock.build(block, folder / f"{block.__name__}.fmu", fmi=version)
    versions = {"2": (2, 2), "3": (3, 3), "mixed": (2, 3)}
    return {
        name: {"mass": built["mass", mass], "load": built["load", load]}
        for name, (mass, load) in versions.items()
    }


def pair(fmus: Mapping[str, Path]) -> System:
    wires = [f"mass.motion[{i}] -> load.motion[{i}]" for i in (1, 2, 3)]
    return System.of(fmus, [*wires, "load.F -> mass.F"])


def rows(system: System, compiled: bool, **options: Any) -> np.ndarray:
    """All columns but texts as doubles, after a run that was compiled if it should be."""
    times = {"step_size": STEP, "stop_time": STOP} | options
    with ec.load(system, compiled=compiled, **times).prepare() as simulation:
        found = simulation.run()
    assert found.stepping["compiled"] == compiled
    return np.array([found[n] for n in found.names if found[n].dtype != object], dtype=np.float64)


def assert_same_bits(one: np.ndarray, other: np.ndarray) -> None:
    assert one.shape == other.shape
    assert (one.view(np.uint64) == other.view(np.uint64)).all()


# ---- types and arrays --------------------------------------------------------------------------

SIGNAL = "a.Int64_out -> b.{}_in"
INTEGERS = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")


def typed(third: Path, **values: Any) -> System:
    """A component that counts drives all numbers of another; whole arrays and parts of them pass as well."""
    signals = [SIGNAL.format(kind) for kind in (*INTEGERS, "Float32")]
    wires = ["b.y -> c.u", "a.x -> b.u[2,1]", "a.Int64_out -> b.u[1,2]", "a.Boolean_out -> b.Boolean_in"]
    wires += ["a.Enumeration_out -> b.Enumeration_in", "b.Boolean_out -> c.UInt8_in"]
    return System.of({"a": third, "b": third, "c": third}, [*signals, *wires], values)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_all_types_have_the_bits_of_python(algorithm: str, third: Path) -> None:
    values = {"a.stride": 7, "a.u[1,1]": 0.8, "a.Enumeration_in": "two", "c.gain[1,2]": -0.3}
    system = typed(third, **values, **{"a.Boolean_in": True})
    found = rows(system, True, algorithm=algorithm)
    assert_same_bits(found, rows(system, False, algorithm=algorithm))


def test_each_type_gets_its_value(third: Path) -> None:
    """With `jacobi` a value arrives one step later."""
    system = typed(third, **{"a.stride": 7, "a.Boolean_in": True})
    with ec.load(system, step_size=STEP, stop_time=STOP, algorithm="jacobi").prepare() as simulation:
        found = simulation.run()
    assert found.stepping["compiled"]
    late = 7 * np.arange(round(STOP / STEP))
    for kind in (*INTEGERS, "Float32"):
        assert (found[f"b.{kind}_out"][1:] == late).all(), kind
    assert (found["b.y[1,2]"][1:] == 2.0 * late).all()
    assert found["b.Boolean_out"].all()
    assert (found["c.UInt8_out"][1:] == 1).all()
    assert (found["b.Enumeration_out"] == 1).all()


def test_a_component_with_doubles_alone_needs_no_conversion(third: Path) -> None:
    """Whole arrays have one value reference for four values."""
    system = System.of({"a": third, "b": third}, ["a.y -> b.u", "b.x -> a.u[1,1]"], {"a.gain[1,1]": 0.25})
    assert_same_bits(rows(system, True), rows(system, False))


# ---- failures ----------------------------------------------------------------------------------


def failure(system: System, compiled: bool, tmp_path: Path, **options: Any) -> tuple[str, bytes]:
    """The error message of a run, and the rows that it left."""
    times = {"step_size": STEP, "stop_time": STOP} | options
    folder = tmp_path / str(compiled)
    loaded = ec.load(system, compiled=compiled, **times)
    with loaded.prepare() as simulation, pytest.raises(RunError) as caught:
        simulation.run(recorders=[ec.CsvFile(folder.with_suffix(".csv"))])
    return str(caught.value), folder.with_suffix(".csv").read_bytes()


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (DISCARDS, "answered doStep at t = 0.5 s with fmi3Discard"),
        (TERMINATES, "asked to end the simulation during doStep at t = 0.5 s"),
        (RETURNS_EARLY, "fmi3DoStep returned early at t = 0.5 s, which was not allowed"),
        (WANTS_EVENT, "fmi3DoStep asked for event mode, which is not used"),
    ],
)
@pytest.mark.parametrize("kind", ["doubles", "types"])
def test_failures_are_those_of_python(
    kind: str, fault: int, words: str, algorithm: str, third: Path, tmp_path: Path
) -> None:
    values = {"b.fault": fault, "b.end": 0.5}
    wires = ["a.y -> b.u", "b.y[1,1] -> a.u[1,1]"] if algorithm == "strong" else ["a.y -> b.u"]
    if kind == "types":
        wires.append("a.Int32_out -> b.Int16_in")
    system = System.of({"a": third, "b": third}, wires, {"a.gain[1,1]": -0.25, **values})
    found = failure(system, True, tmp_path, algorithm=algorithm)
    assert words in found[0]
    assert found[0].count(words) == 1
    assert len(found[1].splitlines()) > 2
    assert found == failure(system, False, tmp_path, algorithm=algorithm)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(
    ("kind", "stride", "value"), [("Int8", 60, "180"), ("UInt8", -1, "-1"), ("Int16", 3000, "33000")]
)
def test_a_value_that_does_not_fit_ends_the_run_with_the_same_words(
    kind: str, stride: int, value: str, algorithm: str, third: Path, tmp_path: Path
) -> None:
    wires = [SIGNAL.format(kind), "b.y[2,2] -> a.u[2,2]"]
    if algorithm == "strong":
        wires.append("a.y[2,2] -> b.u[2,2]")
    system = System.of({"a": third, "b": third}, wires, {"a.stride": stride, "a.gain[2,2]": 0.125})
    found = failure(system, True, tmp_path, algorithm=algorithm)
    assert (
        f"b got a value that it cannot take: its input {kind}_in is {kind} and cannot be {value}." in found[0]
    )
    assert found == failure(system, False, tmp_path, algorithm=algorithm)


def test_signals_that_are_not_finite_end_the_run_with_the_same_words(third: Path, tmp_path: Path) -> None:
    system = System.of({"a": third, "b": third}, ["a.x -> b.u[1,1]"], {"a.u[1,1]": 1e308})
    found = failure(system, True, tmp_path, stop_time=4.0)
    assert "a.x" in found[0]
    assert found == failure(system, False, tmp_path, stop_time=4.0)


@pytest.mark.parametrize(
    ("status", "flags", "expected"),
    [(0, "", 0), (1, "", 1), (0, "t", DISCARD), (1, "te", DISCARD), (0, "v", ERROR), (0, "e", ERROR)]
    + [(status, "tev", status) for status in (2, 3, 4, -1)],
)
def test_what_a_step_says_is_judged(status: int, flags: str, expected: int) -> None:
    """The arguments are eventHandlingNeeded, terminateSimulation, earlyReturn, lastSuccessfulTime."""
    end = StepEnd()

    def step(component: Any, time: float, length: float, kept: int, *places: int) -> int:
        for place, flag in zip(places, "vte", strict=False):
            if flag in flags:
                end._flags[place - end.address] = True
        return status

    assert end.call(step, None, 0.0, 1.0, 1) == expected
    assert end.terminates == ("t" in flags)


@pytest.mark.parametrize(
    ("inputs", "names"),
    [
        ([f"u[{place}]" for place in ("1,1", "1,2", "2,1", "2,2")], ("setFloat64", "getFloat64")),
        (["u[1,2]"], ("setting inputs", "getting outputs")),
    ],
)
def test_a_crash_is_reported_with_the_call_of_fmi_3(
    inputs: list[str], names: tuple[str, str], third: Path, tmp_path: Path
) -> None:
    instance = make_instance("a", open_fmu(third, tmp_path / "a"), inputs, ["x"], FmuLog())
    try:
        points = instance.entry_points()
        assert points is not None
        assert points.names == (*names, "getFMUState", "setFMUState")
        for name in points.names:
            assert decode_call(black_box.Activity(code=code_of(3, name))) == (3, name)
    finally:
        instance.close()


# ---- the bytes of FMI 2.0 ----------------------------------------------------------------------

EVERYTHING: list[dict[str, Any]] = [
    {"algorithm": "jacobi"},
    {"algorithm": "jacobi", "compiled": False},
    {"algorithm": "gauss-seidel", "threads": 2},
    {"algorithm": "strong"},
    {"algorithm": "strong", "compiled": False},
    {"algorithm": "strong", "threads": 2},
    {"algorithm": "strong", "isolate": True},
    {"algorithm": "strong", "isolate": ["load"], "error_tolerance": 1e-4},
    {"algorithm": "strong", "error_tolerance": 1e-5},
    {"algorithm": "strong", "error_tolerance": 1e-5, "compiled": False},
    {"algorithm": "gauss-seidel", "error_tolerance": 1e-4},
    {"algorithm": "strong", "profile": True},
]


CASES = [(options, versions) for options in EVERYTHING for versions in ("3", "mixed")]


@pytest.mark.parametrize(
    ("options", "versions"),
    mostly_slow(CASES, [case for case in CASES if case[1] == "3" or case[0] == {"algorithm": "strong"}]),
    ids=str,
)
def test_both_versions_give_the_same_bytes(
    options: dict[str, Any], versions: str, masses: Masses, tmp_path: Path
) -> None:
    found, isolated = {}, "isolate" in options
    for name in ("2", versions):
        loaded = ec.load(pair(masses[name]), step_size=1e-3, stop_time=0.1, **options)
        with loaded.prepare() as simulation:
            result = simulation.run(recorders=[ec.CsvFile(tmp_path / f"{name}.csv")])
        assert result.stepping["compiled"] == (options.get("compiled", True) and not isolated)
        counts = {k: v for k, v in result.stepping.items() if k != "compiled"}
        found[name] = (tmp_path / f"{name}.csv").read_bytes(), json.dumps(counts, default=str)
        if "profile" in options:
            assert result.profile is not None
            for fmu in result.profile["fmus"].values():
                assert fmu["calls"]["steps"]["count"] >= result.steps
                assert fmu["calls"]["states"]["count"] >= result.steps
    assert found["2"] == found[versions]
    assert len(found["2"][0]) > 1000


def test_a_strong_loop_has_the_solution_of_both_masses_as_one(masses: Masses) -> None:
    loaded = ec.load(pair(masses["3"]), step_size=1e-4, stop_time=0.5, algorithm="strong")
    with loaded.prepare() as simulation:
        found = simulation.run()
    assert found.stepping["compiled"]
    exact = rigid_solution(LOAD, found.time)
    assert np.abs(found["mass.motion[1]"] - exact).max() < 1e-3 * 0.1


@pytest.mark.parametrize(
    "more", [{}, {"error_tolerance": 1e-5, "output_interval": 1e-3}, {"compiled": False}], ids=str
)
def test_a_run_continues_from_its_checkpoint(more: dict[str, Any], masses: Masses, tmp_path: Path) -> None:
    whole = {}
    for name in ("2", "3"):
        kept = tmp_path / name

        def run(stop: float, name: str = name, **options: Any) -> ec.Result:
            base = {"step_size": 1e-3, "stop_time": stop, "algorithm": "strong"}
            with ec.load(pair(masses[name]), **base, **more, **options).prepare() as simulation:
                return simulation.run()

        before, whole[name] = run(0.04, checkpoint=kept), run(0.1)
        after = run(0.1, resume=kept)
        assert 0 < len(after.time) < len(whole[name].time)
        assert len(before.time) < len(whole[name].time)
        for signal in after.names:
            assert (whole[name][signal][-len(after.time) :] == after[signal]).all()
    for signal in whole["2"].names:
        assert (whole["2"][signal] == whole["3"][signal]).all()


def test_a_sweep_gives_the_same_measures(masses: Masses) -> None:
    found = {}
    for name in ("2", "3"):
        times = {"step_size": 1e-3, "stop_time": 0.05, "algorithm": "strong"}
        vary = {"load.m": [0.25, 0.5, 1.0]}
        found[name] = ec.sweep(
            pair(masses[name]), vary, metrics={"end": lambda r: float(r["mass.motion[1]"][-1])}, **times
        ).variants
    ends = found["2"]["end"]
    assert len(set(ends)) == 3
    assert (ends == found["3"]["end"]).all()
    assert isinstance(found["3"], pl.DataFrame)


# ---- faulty model descriptions -----------------------------------------------------------------


def test_a_faulty_model_description_needs_the_option(third: Path, tmp_path: Path, emla: Emla) -> None:
    faulty = tmp_path / "Third.fmu"
    with zipfile.ZipFile(third) as old, zipfile.ZipFile(faulty, "w") as new:
        for name in old.namelist():
            text = old.read(name)
            if name == "modelDescription.xml":
                changed = text.replace(
                    b"<CoSimulation ", b'<CoSimulation canGetAndSetFMUState="perhaps" '
                ).replace(b' canGetAndSetFMUState="true"', b"")
                assert changed != text
                text = changed
            new.writestr(name, text)
    options = ["--stop-time", "1", "--step-size", "0.125", "--no-plots"]
    refused = emla("run", str(faulty), *options, "--output", str(tmp_path / "no"))
    assert "canGetAndSetFMUState" in sentence(refused, 2)
    assert "`--lenient` accepts this" in sentence(refused, 2)
    for fmu, more in ((third, []), (faulty, ["--lenient"])):
        done = emla("run", str(fmu), *options, *more, "--output", str(tmp_path / f"run{len(more)}"))
        assert done.exit_code == 0, done.output
    found = [(tmp_path / f"run{n}" / "results.csv").read_bytes() for n in (0, 1)]
    assert found[0] == found[1]
    assert b"gain[2,2]" in found[0] or b"u[2,2]" in found[0] or b"y[2,2]" in found[0]
    record = json.loads((tmp_path / "run1" / "run.json").read_text())
    (problems,) = record["accepted_faults"].values()
    assert "canGetAndSetFMUState" in problems[0]
