"""Systems with events, clocks, Strings and Binary values as one FMU: values of a host, and messages.

That rows have the bits of a run without a host that sets anything is shown in test_matrix.py.
"""

import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from fmpy.fmi1 import FMICallException

import emla_cosim as ec
from emla_cosim.cli.app import app
from tests.support.c_programs import needs_cc
from tests.support.container_host import Host
from tests.support.hand_written_fmus import build_all_types_3_fmu, build_all_types_fmu, build_event_fmu
from tests.support.tiers import mostly_slow

STEP, STEPS = 0.125, 16
INTEGERS = ("a.bounces", "a.count", "a.latched")
ENDLESS_UPDATES, ENDLESS_RETURNS, UNEXPECTED_EVENT, UNEXPECTED_RETURN, NO_TIME = range(1, 6)
both_versions = pytest.mark.parametrize("fmi", mostly_slow([2, 3], [2]))


@pytest.fixture(scope="module")
def clocked(tmp_path_factory: pytest.TempPathFactory) -> ec.Scenario:
    """Time events, state events, a discrete input, and a clock with an input; all inputs are open."""
    fmu = build_event_fmu(tmp_path_factory.mktemp("clocked") / "Clocked.fmu", clock="periodic")
    system = ec.System.of({"a": fmu}, [], {"a.period": 0.21, "a.threshold": 0.17})
    return ec.load(system, step_size=STEP, stop_time=STEP * STEPS)


@pytest.fixture(scope="module")
def clocked_fmus(clocked: ec.Scenario, tmp_path_factory: pytest.TempPathFactory) -> Mapping[int, Path]:
    folder = tmp_path_factory.mktemp("exported")
    return {fmi: clocked.export(folder / f"{fmi}.fmu", outputs=["*"], fmi=fmi) for fmi in (2, 3)}


def inputs_before(k: int) -> dict[str, float]:
    """Return what is set before step k; some values stay for several steps."""
    return {"a.u": 1.0 + 0.25 * k, "a.n": float(k // 3), "a.w": float(k // 2) - 3.0}


def set_all(host: Host, values: Mapping[str, float]) -> None:
    for name, value in values.items():
        if name == "a.n":
            set_whole = host.fmu.setInteger if host.version == 2 else host.fmu.setInt32
            set_whole([host.references[name]], [int(value)])
        else:
            host[name] = value


def read_all(host: Host) -> list[float]:
    get_whole = host.fmu.getInteger if host.version == 2 else host.fmu.getInt32
    return [*host.read(["a.x", "a.sum"]), *get_whole([host.references[n] for n in INTEGERS])]


@pytest.fixture(scope="module")
def expected(clocked: ec.Scenario) -> list[list[float]]:
    """The values after each step of a run by hand."""
    rows = list[list[float]]()
    with clocked.prepare() as simulation:
        simulation.start()
        for k in range(STEPS):
            for name, value in inputs_before(k).items():
                simulation[name] = value
            simulation.advance((k + 1) * STEP)
            rows.append([float(simulation[n]) for n in ("a.x", "a.sum", *INTEGERS)])
        simulation.finish()
    assert np.ptp(rows, axis=0).all(), "everything changes"
    return rows


@both_versions
def test_inputs_that_change_in_event_mode_and_at_ticks(
    fmi: int, clocked_fmus: Mapping[int, Path], expected: list[list[float]], tmp_path: Path
) -> None:
    """Also after a state from another instance, which has the clocks and the values that wait for a tick."""
    half = STEPS // 2
    with Host(clocked_fmus[fmi], tmp_path) as host, Host(clocked_fmus[fmi], tmp_path / "other") as second:
        host.start()
        for k in range(half):
            set_all(host, inputs_before(k))
            assert host["a.w"] == inputs_before(k)["a.w"]
            host.step(k * STEP, STEP)
            assert read_all(host) == expected[k]
        set_all(host, inputs_before(half))
        content = host.serialize(state := host.save())
        host.free(state)
        second.start()
        second.step(0.0, 3 * STEP)
        second.restore(second.deserialize(content))
        for instance in (host, second):
            instance.step(half * STEP, STEP)
            for k in range(half + 1, STEPS):
                set_all(instance, inputs_before(k))
                instance.step(k * STEP, STEP)
                assert read_all(instance) == expected[k]


def test_event_after_going_back_is_at_the_time_of_the_state(
    clocked_fmus: Mapping[int, Path], tmp_path: Path
) -> None:
    """A value that is set then causes one; clocks whose ticks are after this time must wait."""
    with Host(clocked_fmus[3], tmp_path) as host:
        host.start({"a.w": 2.0})
        host.step(0.0, 6 * STEP)
        state, rows = host.save(), list[list[float]]()
        for _ in range(2):
            set_all(host, {"a.n": 7.0})
            for k in range(6, STEPS):
                host.step(k * STEP, STEP)
                rows += [read_all(host)]
            host.restore(state)
        host.free(state)
    assert rows[: len(rows) // 2] == rows[len(rows) // 2 :]


@pytest.mark.slow
def test_reset_forgets_ticks_and_values(
    clocked_fmus: Mapping[int, Path], expected: list[list[float]], tmp_path: Path
) -> None:
    with Host(clocked_fmus[3], tmp_path) as host:
        for _ in range(2):
            host.start()
            for k in range(4):
                set_all(host, inputs_before(k))
                host.step(k * STEP, STEP)
                assert read_all(host) == expected[k]
            host.fmu.reset()


@pytest.mark.slow
@both_versions
def test_verify_reports_no_problems(fmi: int, clocked_fmus: Mapping[int, Path]) -> None:
    """They read and set each variable in each mode; the component refuses clocked variables between ticks."""
    result = CliRunner().invoke(app, ["verify", str(clocked_fmus[fmi])])
    assert result.exit_code == 0, result.output


# ---- what goes wrong -----------------------------------------------------------------------------

FAULTS = [
    (ENDLESS_UPDATES, {}, "asked 1000 times in a row for more"),
    (ENDLESS_RETURNS, {}, "asked 1001 times in a row for more"),
    (NO_TIME, {}, "has the next event at NaN"),
    (UNEXPECTED_EVENT, {"events": False}, "asked for event mode"),
    (UNEXPECTED_RETURN, {"events": False, "early": False}, "returned early"),
    (
        0,
        {"early": False, "varies": False, "clock": "periodic"},
        "a clock of a ticks at t = 0.35 s, within a step",
    ),
]


def run_with_fault(
    fault: int, flags: Mapping[str, Any], folder: Path, fmi: int = 3, **values: float
) -> tuple[bool, list[str]]:
    """Do steps of an FMU with a fault; return whether one failed, and the messages."""
    fmu = build_event_fmu(folder / "Events.fmu", **flags)
    starts = {"a.period": 0.21, "a.threshold": 0.17, **{f"a.{n}": x for n, x in values.items()}}
    system = ec.System.of({"a": fmu}, [], starts)
    exported = ec.load(system, step_size=STEP, stop_time=1.0).export(folder / "x.fmu", fmi=fmi)
    failed = False
    with Host(exported, folder) as host:
        host.fmu.setDebugLogging(True, [])
        set_whole = host.fmu.setInteger if fmi == 2 else host.fmu.setInt32
        set_whole([host.references["a.fault"]], [fault])
        try:
            host.start()
            for k in range(4):
                answer = host.step(k * STEP, STEP)
                failed = failed or (fmi == 3 and bool(answer[1]))
        except FMICallException:
            failed = True
        return failed, host.messages


@pytest.mark.parametrize(("fault", "flags", "words"), mostly_slow(FAULTS, FAULTS[:1]), ids=str)
def test_errors_in_events_are_reported(fault: int, flags: dict[str, Any], words: str, tmp_path: Path) -> None:
    failed, messages = run_with_fault(fault, flags, tmp_path)
    assert failed and any(words in message and "a" in message for message in messages), messages


@pytest.mark.slow
def test_early_return_without_declaration_is_accepted_with_a_warning(tmp_path: Path) -> None:
    failed, messages = run_with_fault(0, {"early": False}, tmp_path)
    assert not failed and messages == []
    failed, messages = run_with_fault(UNEXPECTED_RETURN, {"early": False}, tmp_path / "again")
    warnings = [m for m in messages if "returned early" in m and "without declaring it" in m]
    assert not failed and len(warnings) == 1


@both_versions
def test_component_can_end_the_simulation(fmi: int, tmp_path: Path) -> None:
    failed, messages = run_with_fault(0, {}, tmp_path, fmi, end=0.3)
    assert failed and any("asks to end the simulation" in m for m in messages)


# ---- sources -------------------------------------------------------------------------------------

ZIG = (sys.executable, "-m", "ziglang", "cc")  # which is clang
COMPILERS = {
    "gcc": ("cc",),
    "clang": ZIG,
    # near to the C of MSVC: without extensions of GNU. Then glibc has HUGE_VAL as a literal.
    "clang -fms-compatibility": (*ZIG, "-fms-compatibility", "-fms-extensions", "-Wno-literal-range"),
    "clang for Windows": (*ZIG, "-target", "x86_64-windows-gnu"),
}


@pytest.mark.slow
@needs_cc
def test_sources_compile_without_warnings(
    clocked_fmus: Mapping[int, Path], fmu_folder: Path, tmp_path: Path
) -> None:
    """With events, with loops, with texts, and with parts that are compiled in or loaded."""
    texts = ec.System.of(
        dict.fromkeys("ab", build_all_types_3_fmu(tmp_path / "Third.fmu")),
        ["a.String_out -> b.String_in", "a.Binary_source -> b.Binary_in"],
    )
    times = {"step_size": 1e-3, "stop_time": 0.1, "fmus": fmu_folder}
    machine = ec.load("hdrm-coupled", fmus=fmu_folder).export(tmp_path / "machine.fmu")
    exported = [
        machine,
        ec.load(texts, **times).export(tmp_path / "texts.fmu", fmi=3),
        *clocked_fmus.values(),
    ]
    commands, headers = list[list[str]](), str(files("fmpy").joinpath("c-code"))
    for number, fmu in enumerate(exported):
        fmpy.extract(str(fmu), folder := str(tmp_path / str(number)))
        for source in sorted(Path(folder, "sources").glob("*.c")):
            flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-I", headers]
            for compiler in COMPILERS.values():
                commands.append([*compiler, *flags, "-c", str(source), "-o", f"{source}.{len(commands)}.o"])
    with ThreadPoolExecutor() as pool:
        processes = list(
            pool.map(lambda x: subprocess.run(x, capture_output=True, text=True, check=False), commands)
        )
    assert len(processes) > 4 * len(COMPILERS)
    assert [x.stderr[:2000] for x in processes if x.returncode != 0] == []


# ---- Strings and Binary values -------------------------------------------------------------------


def test_strings_and_binary_values_pass_as_in_a_run(tmp_path: Path) -> None:
    """From an FMU of FMI 2.0 to two of FMI 3.0; the values change in each step."""
    third = build_all_types_3_fmu(tmp_path / "Third.fmu")
    fmus = {"b": third, "a": build_all_types_fmu(tmp_path / "AllTypes.fmu"), "c": third}
    wires = ["a.text -> b.String_in", "b.String_out -> c.String_in", "a.x -> b.u[1,1]"]
    wires += ["b.Binary_source -> c.Binary_in"]
    texts, numbers = ["a.text", "b.String_out", "c.String_out"], ["c.checksum", "b.checksum"]
    scenario = ec.load(ec.System.of(fmus, wires), step_size=STEP, stop_time=STEP * STEPS)
    with scenario.prepare() as simulation:
        run = simulation.run(signals=[*texts, *numbers])
    assert all(len(set(run[name])) > 2 for name in (*texts, "c.checksum"))
    exported = scenario.export(tmp_path / "x.fmu", outputs=["*"], fmi=3)
    with Host(exported, tmp_path) as host:
        host.start()
        for k in range(STEPS + 1):
            strings = host.fmu.getString([host.references[n] for n in texts])
            assert strings == [run[n][k] for n in texts]
            assert host.fmu.getInt32([host.references[n] for n in numbers]) == [run[n][k] for n in numbers]
            host.step(k * STEP, STEP) if k < STEPS else None


@pytest.mark.slow
def test_binary_values_that_are_too_large_end_the_run(tmp_path: Path) -> None:
    third = build_all_types_3_fmu(tmp_path / "Third.fmu")
    system = ec.System.of({"a": third, "b": third}, ["a.Binary_source -> b.Binary_in"])
    exported = ec.load(system, step_size=STEP, stop_time=2.0).export(tmp_path / "x.fmu", fmi=3)
    with Host(exported, tmp_path) as host:
        host.start({"a.end": 0.25})  # then it has 9 bytes
        with pytest.raises(FMICallException):
            for k in range(STEPS):
                host.step(k * STEP, STEP)
        assert any("takes" in m and "at the most" in m for m in host.messages)
