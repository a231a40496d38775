"""An FMU that ends its process or never returns: the command names the call, and keeps every row so far."""

import contextlib
import json
import os
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

import emla_cosim as ec
from emla_cosim.base import crash_page
from emla_cosim.base.units import LinearTransformation
from emla_cosim.master.instances.measured_calls import CALLS, code_of, decode_call
from emla_cosim.study.loading import load
from emla_cosim.system.model import Alias
from tests.support.faulty_systems import line_with_a_fault
from tests.support.hand_written_fmus import MARK, Fault, build_faulty_fmu
from tests.support.processes import start
from tests.support.tiers import mostly_slow
from tests.support.waiting import wait_for
from tests.support.whole_files import names

AT = 0.35
HANGS = "hangs"
"""File that says that an FMU does not return any more."""

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no `fork`, so no supervision.")


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three components in steps of 0.1 s, of which j.bad can fail; one output has another unit."""
    folder = tmp_path_factory.mktemp("line")
    system = line_with_a_fault(build_faulty_fmu(folder), Fault.NONE, AT)
    *front, sink = system.components
    aliases = {"y_milli": Alias("y", LinearTransformation(1e-3))}
    system = replace(system, components=(*front, replace(sink, aliases=aliases)))
    return load(system, stop_time=1.0, step_size=0.1).export(folder / "line.ssp")


def complete(package: Path, **options: Any) -> polars.DataFrame:
    """All rows of the line without a fault."""
    with load(package, output_interval=0.1, **options).prepare() as simulation:
        return simulation.run().to_polars()


def start_line(
    folder: Path, package: Path, fault: Fault, *options: object, code: str = ""
) -> subprocess.Popen[str]:
    """Start a run of the line into the folder's `out`."""
    arguments = ("run", package, "--output", "out", "--no-plots", "--output-interval", 0.1, *options)
    value = ("--set", f"j.bad.fault={fault.value}")
    return start(folder, *arguments, *value, code=code, environment={MARK: str(folder / HANGS)})


def failure(process: subprocess.Popen[str], folder: Path) -> str:
    """Wait for a command that fails; return its one error message. Nothing else is left."""
    _, errors = process.communicate(timeout=300.0)
    assert process.returncode == 1, errors
    assert "Traceback" not in errors
    assert not any((folder / "temporary").iterdir())
    (message,) = (text for text in errors.splitlines() if text.startswith("Error:"))
    return message


def record(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "out/run.json").read_text())


def steps(folder: Path) -> int:
    return json.loads((folder / "out/metrics.json").read_text())["run"]["steps"]


def table(folder: Path) -> polars.DataFrame:
    return polars.read_csv(folder / "out/results.csv")


# ---- the FMU ends the process ------------------------------------------------------------------

DEFAULT, JACOBI, STRONG = (), ("--algorithm", "jacobi"), ("--algorithm", "strong")
ERROR_CONTROL = ("--algorithm", "jacobi", "--error-tolerance", "1e-3")
OPTIONS = {JACOBI: {"algorithm": "jacobi"}, STRONG: {"algorithm": "strong"}}

DEADLY = [
    (Fault.SEGFAULT, DEFAULT, False, "doStep at t = 0.3 s (SIGSEGV)"),
    (Fault.SEGFAULT, DEFAULT, True, "doStep at t = 0.3 s (SIGSEGV)"),
    (Fault.EXIT, JACOBI, False, "doStep at t = 0.3 s (exit code 0)"),
    (Fault.ABORT, STRONG, False, "doStep at t = 0.3 s (SIGABRT)"),
    (Fault.EXIT, STRONG, True, "doStep at t = 0.3 s (exit code 0)"),
    (Fault.SEGFAULT_GET_REAL, ERROR_CONTROL, False, "getReal (SIGSEGV)"),
    (Fault.SEGFAULT_GET_REAL, JACOBI, True, "getReal (SIGSEGV)"),
    (Fault.ORPHAN, DEFAULT, False, "doStep at t = 0.3 s (exit code 3)"),  # a copy of it keeps the lock
]


@needs_fork
@pytest.mark.parametrize(("fault", "options", "isolated", "call"), mostly_slow(DEADLY, DEADLY[:1]))
def test_fmu_that_ends_the_process_is_named_and_rows_are_kept(
    fault: Fault, options: tuple[str, ...], isolated: bool, call: str, package: Path, tmp_path: Path
) -> None:
    more = ("--isolate", "j.bad") if isolated else ()
    process = start_line(tmp_path, package, fault, *options, *more)
    if fault is Fault.ORPHAN:
        assert process.wait(300.0) == 1  # its copy has the streams still open
    else:
        assert (
            failure(process, tmp_path)
            == f"Error: {record(tmp_path)['status']} The results so far are in out."
        )
    assert f"j.bad ended {'its' if isolated else 'the'} process in {call}" in record(tmp_path)["status"]
    rows = table(tmp_path)
    if options is not ERROR_CONTROL:  # which ends between two rows that are due
        assert rows.equals(complete(package, **OPTIONS.get(options, {}))[:4])
    assert rows["time"].to_list()[:4] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert steps(tmp_path) >= 3
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "call"),
    [
        (Fault.SEGFAULT_TERMINATE, "terminate"),
        (Fault.SEGFAULT_FREE, "freeInstance"),
        (Fault.SEGFAULT_FREE_STATE, "freeFMUstate"),
    ],
)
def test_results_are_complete_when_an_fmu_crashes_at_its_end(
    fault: Fault, call: str, package: Path, tmp_path: Path
) -> None:
    message = failure(start_line(tmp_path, package, fault, *STRONG), tmp_path)
    assert f"j.bad ended the process in {call} (SIGSEGV), when the results were complete." in message
    assert record(tmp_path)["status"] in message
    assert record(tmp_path)["components"]["j.bad"]["parameters"]["fault"] == str(fault.value)
    assert table(tmp_path).equals(complete(package, algorithm="strong"))
    assert steps(tmp_path) == 10
    if fault is Fault.SEGFAULT_FREE:  # an isolated FMU may end like this
        isolated = start_line(tmp_path, package, fault, *STRONG, "--isolate", "j.bad", "--overwrite")
        assert isolated.communicate(timeout=300.0) and isolated.returncode == 0
        assert record(tmp_path)["status"] == "completed"


@needs_fork
@pytest.mark.slow
def test_crash_before_the_first_step_and_after_an_error(package: Path, tmp_path: Path) -> None:
    message = failure(start_line(tmp_path, package, Fault.SEGFAULT_INITIALIZATION), tmp_path)
    assert "before its first step: j.bad ended the process in exitInitializationMode (SIGSEGV)" in message
    assert record(tmp_path) == {"scenario": "system", "status": message[7:].partition(" The results")[0]}
    sink = ("--set", f"j.sink.fault={Fault.SEGFAULT_FREE.value}", "--overwrite")
    message = failure(start_line(tmp_path, package, Fault.ERROR, *sink), tmp_path)
    assert "j.bad answered doStep at t = 0.3 s with fmi2Error" in message
    assert "Then j.sink ended the process in freeInstance (SIGSEGV)" in message


SLOW_DISK = """
import os, time, emla_cosim.recorders.csv_file as c
store = c.CsvFile.store
def slow(file, rows):
    if len(rows) > 1000 and not os.path.exists('slow'):  # the process that saves the rest is fast
        store(file, rows[:500])
        open('slow', 'w').close()
        time.sleep(3.0)
        store(file, rows[500:])
    else:
        store(file, rows)
c.CsvFile.store = slow
"""
SMALL_STEPS = ("--step-size", 1e-4, "--output-interval", 1e-4, "--stop-time", 2)


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize(
    ("at", "code", "options"),
    [
        (0.54995, "", DEFAULT),
        (0.54995, "", STRONG),
        (0.54995, SLOW_DISK, DEFAULT),
        (1.04995, SLOW_DISK, ()),
    ],
)
def test_rows_that_wait_for_the_disk_are_kept(
    at: float, code: str, options: tuple[str, ...], package: Path, tmp_path: Path
) -> None:
    """4000 rows make a block: some are stored, some are passed on, and some wait when the process ends."""
    more = (*SMALL_STEPS, "--set", f"j.bad.at={at}", *options)
    failure(start_line(tmp_path, package, Fault.SEGFAULT, *more, code=code), tmp_path)
    assert (tmp_path / "slow").exists() == bool(code)
    rows = table(tmp_path)
    assert np.allclose(rows["time"], 1e-4 * np.arange(round(at * 1e4 + 0.5)))
    assert steps(tmp_path) == len(rows) - 1


CALLS_THAT_END = [Fault.SEGFAULT, Fault.EXIT, Fault.SEGFAULT_GET_REAL]


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize("form", ["csv", "parquet"])
@pytest.mark.parametrize("steps_per_row", [1, 7, 100_000])
@pytest.mark.parametrize("fault", CALLS_THAT_END)
def test_rows_that_are_due_and_the_last_one_are_kept(
    fault: Fault, steps_per_row: int, form: str, package: Path, tmp_path: Path
) -> None:
    """In any call, for any number of steps in a row of the table; metrics are those of these rows."""
    interval = ("--output-interval", f"{steps_per_row * 1e-4:g}", "--output-format", form)
    value = ("--set", "j.bad.at=1.04995")
    failure(start_line(tmp_path, package, fault, *SMALL_STEPS, *interval, *value), tmp_path)
    assert names(tmp_path / "out") == {f"results.{form}", "metrics.json", "run.json"}
    path = tmp_path / f"out/results.{form}"
    rows = table(tmp_path) if form == "csv" else polars.read_parquet(path)
    last = steps(tmp_path)
    assert last >= 10_498
    due = sorted({*range(0, last + 1, steps_per_row), last})
    with load(package, step_size=1e-4, output_interval=1e-4, stop_time=1e-4 * last).prepare() as simulation:
        assert rows.equals(simulation.run().to_polars()[due])
    figures = json.loads((tmp_path / "out/metrics.json").read_text())["signals"]
    for name in rows.columns[1:]:
        assert figures[name]["maximum"] == rows[name].max()
        assert figures[name]["final"] == rows[name][-1]
    remarks = [text for text in record(tmp_path)["remarks"] if text.startswith("The metrics were computed")]
    assert len(remarks) == (steps_per_row > 1)


@needs_fork
@pytest.mark.slow
def test_some_signals_without_a_file_for_the_newest_rows(package: Path, tmp_path: Path) -> None:
    """A file system that cannot share memory costs the newest rows; run.json says so."""
    code = """
import emla_cosim.recorders.row_buffer as f
def refuse(*arguments):
    raise OSError(95, 'Operation not supported')
f._allocate = refuse
"""
    options = (*SMALL_STEPS, "--signals", "j.sink.z", "--set", "j.bad.at=1.04995")
    failure(start_line(tmp_path, package, Fault.ABORT, *options, code=code), tmp_path)
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}
    rows = table(tmp_path)
    assert rows.columns == ["time", "j.sink.z"] and 1 <= len(rows) < 10_500
    assert steps(tmp_path) == 10_499
    assert list(json.loads((tmp_path / "out/metrics.json").read_text())["signals"]) == ["j.sink.z"]
    remarks = " ".join(record(tmp_path)["remarks"])
    assert "are lost" in remarks and "Operation not supported" in remarks
    assert "with those of its signals alone" in remarks


@needs_fork
@pytest.mark.slow
def test_parquet_and_continued_runs_are_kept(package: Path, tmp_path: Path) -> None:
    failure(start_line(tmp_path, package, Fault.SEGFAULT, "--output-format", "parquet"), tmp_path)
    assert names(tmp_path / "out") == {"results.parquet", "metrics.json", "run.json"}
    assert polars.read_parquet(tmp_path / "out/results.parquet").equals(complete(package)[:4])
    first = start_line(tmp_path, package, Fault.SEGFAULT, "--stop-time", 0.2, "--checkpoint", "c")
    assert first.communicate(timeout=300.0) and first.returncode == 0
    failure(start_line(tmp_path, package, Fault.SEGFAULT, "--resume", "c"), tmp_path)
    assert table(tmp_path).equals(complete(package)[:4])
    assert steps(tmp_path) == 1


# ---- the FMU never returns ---------------------------------------------------------------------


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize("isolated", [False, True], ids=["supervised", "isolated"])
def test_ctrl_c_twice_ends_a_call_that_never_returns(isolated: bool, package: Path, tmp_path: Path) -> None:
    process = start_line(tmp_path, package, Fault.HANG, *(["--isolate", "j.bad"] if isolated else []))
    wait_for((tmp_path / HANGS).exists)
    for _ in range(5):  # a busy machine may join two signals to one request
        for _ in range(2):
            process.send_signal(signal.SIGINT)
            time.sleep(0.5)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(30.0)
            break
    assert "doStep at t = 0.3 s" in failure(process, tmp_path)
    assert table(tmp_path)["time"].to_list() == pytest.approx([0.0, 0.1, 0.2, 0.3])


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize("isolated", [False, True], ids=["supervised", "isolated"])
def test_killed_parent_ends_its_children(isolated: bool, package: Path, tmp_path: Path) -> None:
    process = start_line(tmp_path, package, Fault.HANG, *(["--isolate"] if isolated else []))
    wait_for((tmp_path / HANGS).exists)
    children = psutil.Process(process.pid).children(recursive=True)
    assert len(children) == (4 if isolated else 1)
    process.kill()
    process.communicate(timeout=60.0)
    assert not psutil.wait_procs(children, timeout=60.0)[1]


# ---- isolated FMUs -----------------------------------------------------------------------------


@pytest.mark.slow
def test_isolated_fmus_resume_and_write_the_checkpoints_of_others(package: Path, tmp_path: Path) -> None:
    scenario = load(package, output_interval=0.1, algorithm="strong")
    with scenario.prepare() as simulation:
        expected = simulation.run().to_polars()
        simulation.run(stop_time=0.3, checkpoint=tmp_path / "others")
    with scenario.prepare(isolate=["j.bad"]) as simulation:
        simulation.run(stop_time=0.3, checkpoint=tmp_path / "isolated")
        rest = simulation.run(resume=tmp_path / "others").to_polars()
        assert rest.equals(expected.tail(7))
        assert simulation.run(fresh=True).to_polars().equals(expected)
    with scenario.prepare() as simulation:
        assert simulation.run(resume=tmp_path / "isolated").to_polars().equals(rest)


@needs_fork
def test_simulation_survives_the_end_of_an_isolated_fmu(package: Path) -> None:
    """After a crash, an end that leaves a copy with the streams, and noise on the streams."""
    expected = complete(package)
    with load(package, output_interval=0.1).prepare(isolate=["j.bad"]) as simulation:
        for fault, message in (
            (Fault.SEGFAULT, r"j\.bad ended its process in doStep"),
            (Fault.ORPHAN, r"j\.bad ended its process in doStep .* \(exit code 3\)"),
            (Fault.GARBLE, "something else wrote to the stream"),
        ):
            with pytest.raises(ec.RunError, match=message) as error:
                simulation.run(set={"j.bad.fault": fault.value})
            assert error.value.fields["result"].time[-1] == pytest.approx(0.3)
        assert simulation.run().to_polars().equals(expected)


@pytest.mark.parametrize(
    "faults",
    mostly_slow(
        [[Fault.ERROR], [Fault.GET_REAL, Fault.DISCARD, Fault.NAN_Y, Fault.SET_REAL]], [[Fault.ERROR]]
    ),
)
def test_errors_of_isolated_fmus_are_those_of_others(faults: list[Fault], package: Path) -> None:
    messages = []
    for isolate in (False, ["j.bad"]):
        with load(package).prepare(isolate=isolate) as simulation:
            for fault in faults:
                with pytest.raises(ec.RunError) as error:
                    simulation.run(set={"j.bad.fault": fault.value})
                messages.append(str(error.value))
    assert messages[: len(faults)] == messages[len(faults) :]


def test_isolated_fmu_has_limited_time_to_terminate(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emla_cosim.master.instances.isolated_instance._TIMEOUT", 0.2)
    fault = {"j.bad.fault": Fault.HANG_TERMINATE.value}
    with load(package).prepare(isolate=["j.bad"], set=fault) as simulation:
        assert simulation.run().steps == 10


def test_isolated_fmu_ends_with_its_simulation(package: Path) -> None:
    """At once: the shortest of several closings, as the machine may be busy."""

    def seconds_to_close() -> float:
        before = set(psutil.Process().children())
        simulation = load(package).prepare(isolate=["j.bad"])
        (process,) = set(psutil.Process().children()) - before
        start = time.monotonic()
        simulation.close()
        assert not process.is_running()
        return time.monotonic() - start

    assert any(seconds_to_close() < 1.0 for _ in range(3))


def test_isolate_takes_patterns_and_true(package: Path, tmp_path: Path) -> None:
    with pytest.raises(ec.CommandError, match=r"no component matches 'j\.bat'; did you mean j\.bad"):
        load(package).prepare(isolate=["j.bat"])
    file = tmp_path / "isolated.toml"
    file.write_text(f'system = "{package}"\nisolate = true\n')
    assert load(file).options.isolate == ["*"]


# ---- the record of the present call ------------------------------------------------------------


@given(st.integers(0, 10_000), st.sampled_from(CALLS[1:]))
def test_code_has_instance_and_call(instance: int, call: str) -> None:
    present = crash_page.Activity(code=code_of(instance, call), time=0.5)
    assert decode_call(present) == (instance, f"{call} at t = 0.5 s" if call == "doStep" else call)
    assert decode_call(crash_page.Activity())[0] is None
