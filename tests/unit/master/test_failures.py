"""An FMU that fails ends the run with one message that names it, and every row so far is kept."""

import errno
import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from click.testing import CliRunner
from click.testing import Result as Finished
from fmpy.fmi2 import FMU2Slave

import emla_cosim.cli.commands.run
import emla_cosim.recorders.checkpoints
import emla_cosim.run.execution
import emla_cosim.run.simulation
from emla_cosim.base.errors import CommandError
from emla_cosim.base.interruption import ONE_REQUEST
from emla_cosim.cli.app import app
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.stepping.checkpoint import save_checkpoint
from emla_cosim.master.stepping.stepping_base import RowSink, Stepping
from emla_cosim.recorders.csv_file import CsvFile
from emla_cosim.recorders.recorder import Recorder
from emla_cosim.run.result import Result
from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from tests.support.faulty_systems import (
    counts_of,
    faulty,
    line_with_a_fault,
    loop_with_a_fault,
    run_system,
    wired,
)
from tests.support.hand_written_fmus import Counts, Fault, build_faulty_fmu
from tests.support.whole_files import names

AT = 0.35
STEPPED = {
    "jacobi": {"algorithm": "jacobi"},
    "jacobi in threads": {"algorithm": "jacobi", "threads": 3},
    "gauss-seidel": {"algorithm": "gauss-seidel", "extrapolation": "fmu"},
    "gauss-seidel in threads": {"algorithm": "gauss-seidel", "extrapolation": "fmu", "threads": 2},
}
"""Options by the kind of stepping that they choose."""

ENDINGS = {
    Fault.DISCARD: (0.3, "j.bad answered doStep at t = 0.3 s with fmi2Discard."),
    Fault.ERROR: (0.3, "j.bad answered doStep at t = 0.3 s with fmi2Error."),
    Fault.FATAL: (0.3, "j.bad answered doStep at t = 0.3 s with fmi2Fatal."),
    Fault.NAN_Y: (0.3, "j.bad.y became nan at t = 0.4 s."),
    Fault.GET_REAL: (0.3, "j.bad answered getReal with fmi2Error."),
    Fault.SET_REAL: (0.4, "j.bad answered setReal with fmi2Error."),
    Fault.PENDING: (0.3, "j.bad answered doStep at t = 0.3 s with fmi2Pending."),
    Fault.NEGATIVE: (0.3, "j.bad answered doStep at t = 0.3 s with status -1."),
}
"""How a run in steps of 0.1 s ends: time of the last row, and the message; that of the FMU may follow."""


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> list[Counts]:
    """Counters of the faulty FMUs of every run from now on."""
    counters: list[Counts] = []

    def counting(*arguments: Any) -> Assembly:
        assembly = Assembly(*arguments)
        counters.extend(counts_of(assembly))
        return assembly

    monkeypatch.setattr(emla_cosim.run.simulation, "Assembly", counting)
    return counters


def table(folder: Path) -> polars.DataFrame:
    """results.csv with all its values as numbers."""
    return polars.read_csv(folder / "results.csv").cast(polars.Float64)


def check_end(result: Result, folder: Path, last: float, message: str) -> None:
    """The run ended with this message, and all rows up to this time are there, and no more."""
    assert result.problem is not None
    assert result.problem.startswith(f"the run ended at t = {last:.6g} s: {message}")
    assert ("faulty model" in result.problem) == ("nan" not in message), "the log of the FMU is missing"
    assert result.end_s == pytest.approx(last)
    frame = table(folder)
    assert frame["time"].to_numpy() == pytest.approx(np.arange(round(last / 0.1) + 1) * 0.1)
    assert np.isfinite(frame.to_numpy()).all()
    assert json.loads((folder / "run.json").read_text())["status"] == result.problem
    assert json.loads((folder / "metrics.json").read_text())["run"]["steps"] == len(frame) - 1


def check_freed(counts: list[Counts], *, died: bool = False) -> None:
    """All instances and states were freed; after fmi2Fatal nothing of an FMU may be called."""
    assert counts
    for count in counts:
        assert count.calls_after_fatal == 0
        assert (count.instances > 0) == died
        assert died or count.states == 0


# ---- steps of one length -----------------------------------------------------------------------

_OTHER_OPTIONS = list(STEPPED)[1:]
PAIRS = [
    *((fault, "jacobi") for fault in ENDINGS),
    *((fault, _OTHER_OPTIONS[i % len(_OTHER_OPTIONS)]) for i, fault in enumerate(ENDINGS)),
]


@pytest.mark.parametrize(("fault", "stepped"), PAIRS)
def test_failing_fmu_is_named_and_rows_are_kept(
    fault: Fault, stepped: str, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    result = run_system(line_with_a_fault(faulty_fmu, fault, AT), tmp_path, **STEPPED[stepped])
    check_end(result, tmp_path, *ENDINGS[fault])
    check_freed(counts, died=fault == Fault.FATAL)


@pytest.mark.parametrize(
    ("fault", "stepped"),
    list(zip((Fault.DISCARD, Fault.ERROR, Fault.GET_REAL, Fault.SET_REAL), STEPPED, strict=False)),
)
def test_fmu_is_terminated_after_discard_but_not_after_an_error(
    fault: Fault, stepped: str, faulty_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The standard forbids fmi2Terminate after fmi2Error, and requires it after fmi2Discard."""
    terminated: list[str] = []
    terminate = FMU2Slave.terminate

    def record(slave: FMU2Slave) -> None:
        terminated.append(slave.instanceName)
        terminate(slave)

    monkeypatch.setattr(FMU2Slave, "terminate", record)
    system = line_with_a_fault(faulty_fmu, fault, AT)
    run_system(system, tmp_path, **STEPPED[stepped])
    expected = {c.name for c in system.components} - ({"j.bad"} if fault != Fault.DISCARD else set())
    assert sorted(terminated) == sorted(expected)


@pytest.mark.parametrize("stepped", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("fault", [Fault.WARNING, Fault.NAN_Z])
def test_warning_and_unread_nan_do_not_end_the_run(
    fault: Fault, stepped: str, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    result = run_system(line_with_a_fault(faulty_fmu, fault, AT), tmp_path, **STEPPED[stepped])
    assert result.problem is None
    frame = table(tmp_path)
    assert len(frame) == 11
    late = frame["time"].to_numpy() > AT
    assert (np.isnan(frame["j.bad.z"].to_numpy()) == (late & (fault == Fault.NAN_Z))).all()
    assert frame["j.bad.y"].to_numpy()[1:] == pytest.approx(np.arange(1, 11) * 0.2 + 1.0)
    check_freed(counts)


@pytest.mark.parametrize("stepped", STEPPED)
def test_fmu_with_long_steps_fails_at_the_start_of_its_step(
    stepped: str, faulty_fmu: Path, tmp_path: Path
) -> None:
    """The step of j.bad from 0.2 s fails when the others are at 0.3 s. Rows that are not due are left out."""
    system = line_with_a_fault(faulty_fmu, Fault.ERROR, AT)
    result = run_system(system, tmp_path, **STEPPED[stepped], step_multiples={"j.bad": 2})
    check_end(result, tmp_path, 0.3, "j.bad answered doStep at t = 0.2 s with fmi2Error.")
    run_system(system, tmp_path, **STEPPED[stepped], output_interval=0.2)
    assert table(tmp_path)["time"].to_list() == pytest.approx([0.0, 0.2, 0.3])


@pytest.mark.parametrize("fault", [Fault.ENTER_INITIALIZATION, Fault.EXIT_INITIALIZATION])
def test_failed_initialization_leaves_no_rows(
    fault: Fault, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    result = run_system(line_with_a_fault(faulty_fmu, fault, AT), tmp_path)
    verb = "enter" if fault == Fault.ENTER_INITIALIZATION else "exit"
    start = f"the run ended at t = 0 s: j.bad answered {verb}InitializationMode with fmi2Error."
    assert result.problem is not None and result.problem.startswith(start)
    assert len(table(tmp_path)) == 0
    assert json.loads((tmp_path / "metrics.json").read_text())["run"]["steps"] == 0
    check_freed(counts)


def invoke(system: System, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Finished:
    """`emla run` of a system."""
    monkeypatch.setattr(emla_cosim.cli.commands.run, "load", lambda _, **options: load(system, **options))
    times = ["--stop-time", "1", "--step-size", "0.1"]
    return CliRunner().invoke(app, ["run", "test", *times, "--no-plots", "--output", str(folder)])


def test_command_reports_the_failure_in_one_message(
    faulty_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    result = invoke(line_with_a_fault(faulty_fmu, Fault.ERROR, AT), out, monkeypatch)
    assert result.exit_code == 1
    (error,) = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert error.startswith(f"Error: the run ended at t = 0.3 s: {ENDINGS[Fault.ERROR][1]}")
    assert error.endswith(f" The results so far are in {out}.")
    assert names(out) == {"results.csv", "metrics.json", "run.json"}


# ---- strong coupling and error control ---------------------------------------------------------

STRONG, CONTROLLED = {"algorithm": "strong"}, {"error_tolerance": 0.1}
REPEATED = [
    *(
        (fault, loop_with_a_fault, STRONG)
        for fault in (Fault.ERROR, Fault.FATAL, Fault.NAN_Y, Fault.GET_REAL)
    ),
    *((fault, line_with_a_fault, CONTROLLED) for fault in ENDINGS),
]


@pytest.mark.parametrize(("fault", "make", "options"), REPEATED)
def test_failing_fmu_ends_a_run_that_repeats_steps(
    fault: Fault,
    make: Callable[..., System],
    options: dict[str, Any],
    faulty_fmu: Path,
    tmp_path: Path,
    counts: list[Counts],
) -> None:
    """All states that it saved are freed."""
    result = run_system(make(faulty_fmu, fault, AT), tmp_path, **options)
    assert result.problem is not None and "j.bad" in result.problem
    frame = table(tmp_path)
    assert np.isfinite(frame.to_numpy()).all()
    assert 0.29 < frame["time"][-1] == result.end_s < 0.41
    assert len(frame) == result.steps + 1
    check_freed(counts, died=fault == Fault.FATAL)


@pytest.mark.parametrize("options", [*STEPPED.values(), {"algorithm": "strong"}, {"error_tolerance": 0.5}])
def test_step_that_is_too_long_for_an_fmu_is_divided(
    options: dict[str, Any], faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    """The input is constant: every division of the step is exact."""
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0, longest=0.3 * 0.125)
    result = run_system(system, tmp_path, step_size=0.125, **options)
    assert result.problem is None
    assert "error_tolerance" not in options or result.stepping["rejected_steps"] > 0
    frame = table(tmp_path)
    assert frame["time"][-1] == 1.0
    np.testing.assert_allclose(frame["j.bad.z"], 2.0 * frame["time"], rtol=1e-12)
    if "error_tolerance" not in options:
        assert result.stepping["divided_steps"] == {"j.bad": {"steps": 8, "shortest_part_s": 0.03125}}
        assert "j.bad discarded 8 steps, and did them in parts; the shortest was 0.0312 s" in result.remarks
    check_freed(counts)


def test_discarded_step_that_cannot_be_divided(tmp_path: Path) -> None:
    fmu = build_faulty_fmu(tmp_path, name="Rigid", rollback=False)
    result = run_system(wired([faulty("j.bad", fmu, longest=0.06)]), tmp_path / "out")
    reason = "The step cannot be repeated in parts: j.bad cannot return to an earlier state"
    assert result.problem is not None and reason in result.problem
    assert result.problem.endswith(" (canGetAndSetFMUstate). Set a smaller --step-size.")


def test_state_that_cannot_be_restored_ends_the_run(faulty_fmu: Path, tmp_path: Path) -> None:
    """The run ends rather than continue with wrong values, if an FMU fails to restore its state."""
    system = line_with_a_fault(faulty_fmu, Fault.SET_STATE, 0.0, longest=0.06)
    result = run_system(system, tmp_path)
    assert result.problem is not None and "j.bad answered setFMUstate with fmi2Error." in result.problem


# ---- states of FMUs ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (Fault.GET_STATE, "j.bad answered getFMUstate with fmi2Error."),
        (
            Fault.HUGE_STATE,
            f"j.bad answered SerializedFMUstateSize with {2**60} bytes, more than {2**32}.",
        ),
    ],
)
def test_state_that_cannot_be_saved_leaves_the_rows_and_no_checkpoint(
    fault: Fault, message: str, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    system = line_with_a_fault(faulty_fmu, fault, AT)
    result = run_system(system, tmp_path / "out", checkpoint=tmp_path / "c")
    assert result.problem is not None and message in result.problem
    assert not (tmp_path / "c").exists()
    assert len(table(tmp_path / "out")) == 11
    check_freed(counts)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"algorithm": "strong"}, "the strong coupling of a loop needs FMUs with canGetAndSetFMUstate"),
        ({"error_tolerance": 0.1}, "error control needs FMUs with canGetAndSetFMUstate"),
        ({"checkpoint": Path("c")}, "a checkpoint needs FMUs with canSerializeFMUstate"),
    ],
)
def test_missing_capabilities_are_reported_with_the_components(
    options: dict[str, Any], message: str, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    plain = build_faulty_fmu(tmp_path, rollback=False, name="Plain")
    loop = wired(
        [faulty("j.a", faulty_fmu), faulty("j.b", plain), faulty("j.c", plain)],
        "j.a.y -> j.b.u",
        "j.b.y -> j.c.u",
        "j.c.y -> j.a.u",
    )
    with pytest.raises(CommandError) as error:
        run_system(loop, tmp_path / "out", **options)
    assert str(error.value) == f"{message}; j.b, j.c cannot do it."
    assert list((tmp_path / "out").iterdir()) == []
    check_freed(counts)


def test_strong_coupling_needs_no_states_without_a_loop(tmp_path: Path) -> None:
    plain = build_faulty_fmu(tmp_path, rollback=False, name="Plain")
    line = wired([faulty("j.a", plain, b=1.0, u=1.0), faulty("j.b", plain)], "j.a.y -> j.b.u")
    assert run_system(line, tmp_path / "out", "strong").problem is None


def test_checkpoints_free_their_states(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(emla_cosim.recorders.checkpoints, "INTERVAL", 0.0)
    monkeypatch.setattr(emla_cosim.run.execution, "FLUSH_INTERVAL", 0.0)
    freed_states: list[int] = []

    def save(*arguments: Any) -> None:
        save_checkpoint(*arguments)
        freed_states.append(counts[0].states)

    monkeypatch.setattr(emla_cosim.recorders.checkpoints, "save_checkpoint", save)
    system, out = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0), tmp_path / "out"
    run_system(system, out, checkpoint=tmp_path / "c")
    resumed = run_system(system, out, stop_time=2.0, resume=tmp_path / "c", checkpoint=tmp_path / "d")
    assert resumed.problem is None
    assert len(freed_states) >= 4 and set(freed_states) <= {0, 3}  # the run keeps one state of each FMU
    check_freed(counts)


# ---- a full disk, no memory, Ctrl-C ------------------------------------------------------------


def test_full_disk_ends_the_run(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts], monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []

    def write(file: CsvFile, rows: np.ndarray) -> None:
        if len(written) > 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append(len(rows))

    monkeypatch.setattr(CsvFile, "write", write)
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    result = run_system(system, tmp_path, stop_time=2000.0)
    assert result.problem == f"{tmp_path / 'results.csv'} cannot be written: No space left on device."
    assert sum(written) <= result.steps < 20_000
    assert json.loads((tmp_path / "run.json").read_text())["status"] == result.problem
    check_freed(counts)


def test_recorder_without_memory_ends_the_run(faulty_fmu: Path, tmp_path: Path) -> None:
    class Hungry(Recorder):
        def pause(self, run: Any) -> None:
            if run.stepping.steps:
                raise MemoryError

    scenario = load(line_with_a_fault(faulty_fmu, Fault.NONE, 0.0), stop_time=1.0, step_size=0.1)
    with scenario.prepare() as simulation:
        result = simulation.attempt(recorders=[Hungry(), CsvFile(tmp_path / "results.csv")])
    assert result.problem is not None and "there is not enough memory" in result.problem
    assert len(table(tmp_path)) == result.steps + 1


def test_second_ctrl_c_ends_at_once_and_keeps_whole_rows(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(signal.SIGINT)  # a job in the background starts with it ignored

    def interrupt_twice(
        stepping: Stepping, rows: RowSink, interrupted: Callable[[], bool], *_: object
    ) -> None:
        stepping.advance(rows, 5)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)  # as a parent that passes it on
        assert interrupted()
        time.sleep(ONE_REQUEST)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(emla_cosim.run.execution, "simulate", interrupt_twice)
    result = invoke(line_with_a_fault(faulty_fmu, Fault.NONE, 0.0), tmp_path / "out", monkeypatch)
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1] == "Interrupted."
    assert table(tmp_path / "out")["time"].to_list() == pytest.approx([0.1 * k for k in range(6)])
    assert signal.getsignal(signal.SIGINT) is before
    check_freed(counts)
