"""Whatever a slave does, a run ends in one sentence, and everything up to there is kept."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from fmpy.fmi2 import FMU2Slave
from typer.testing import CliRunner
from typer.testing import Result as Finished

import emla_cosim.cli.commands.run
import emla_cosim.recorders.checkpoints
import emla_cosim.run.execution
import emla_cosim.run.simulation
from emla_cosim.base.errors import CommandError
from emla_cosim.cli.app import app
from emla_cosim.master.algorithms.strong import Strong
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.instances.fmu_instance import DiscardedStepError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.checkpoint import save_checkpoint
from emla_cosim.master.stepping.stepping_base import RowSink, Stepping
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.recorders.csv_file import CsvFile
from emla_cosim.recorders.recorder import Outline, Recorder, RecordingError, RowBuffer
from emla_cosim.run.result import Result
from emla_cosim.sandbox.interruption import ONE_REQUEST
from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from tests.support.faulty_fmu import Counts, Fault, build_faulty_fmu
from tests.support.faulty_systems import (
    counts_of,
    faulty,
    line_with_a_fault,
    loop_with_a_fault,
    run_system,
    wired,
)
from tests.support.full_disk import files_of_at_most
from tests.support.simulated import simulated
from tests.support.slaves import FakeSlave
from tests.support.whole_files import names

AT = 0.35
STEPPED = {
    "compiled jacobi": {"algorithm": "jacobi"},
    "compiled jacobi in threads": {"algorithm": "jacobi", "threads": 3},
    "jacobi": {"algorithm": "jacobi", "compiled": False},
    "compiled gauss-seidel": {"algorithm": "gauss-seidel", "extrapolation": "fmu"},
    "compiled gauss-seidel in threads": {"algorithm": "gauss-seidel", "extrapolation": "fmu", "threads": 2},
    "gauss-seidel": {"algorithm": "gauss-seidel", "extrapolation": "fmu", "compiled": False},
}
"""Options by the way of stepping that they choose."""


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> list[Counts]:
    """Counters of the faulty FMUs of every run from now on."""
    found: list[Counts] = []

    def counting(*given: Any) -> Assembly:
        assembly = Assembly(*given)
        found.extend(counts_of(assembly))
        return assembly

    monkeypatch.setattr(emla_cosim.run.simulation, "Assembly", counting)
    return found


@dataclass(frozen=True)
class Ending:
    """How a run of the line in steps of 0.1 s ends: the time of the last row, and the sentence."""

    last: float
    sentence: str


def told(call: str, status: str, said: str) -> str:
    return f"j.bad answered {call} with {status}. It said: the faulty model was told {said}."


ENDINGS = {
    Fault.DISCARD: Ending(
        0.3, told("doStep at t = 0.3 s", "fmi2Discard", "to discard the step to t = 0.4 s")
    ),
    Fault.ERROR: Ending(0.3, told("doStep at t = 0.3 s", "fmi2Error", "to fail in the step to t = 0.4 s")),
    Fault.FATAL: Ending(0.3, told("doStep at t = 0.3 s", "fmi2Fatal", "to die in the step to t = 0.4 s")),
    Fault.NAN_Y: Ending(0.3, "j.bad.y became nan at t = 0.4 s."),
    Fault.TERMINATE: Ending(
        0.3,
        "j.bad asked to end the simulation during doStep at t = 0.3 s. "
        "It said: the faulty model was told to end the run at t = 0.35 s.",
    ),
    Fault.GET_REAL: Ending(0.3, told("getReal", "fmi2Error", "to refuse getting values at t = 0.4 s")),
    Fault.SET_REAL: Ending(0.4, told("setReal", "fmi2Error", "to refuse setting values at t = 0.4 s")),
    Fault.PENDING: Ending(
        0.3, told("doStep at t = 0.3 s", "fmi2Pending", "not to finish the step to t = 0.4 s")
    ),
    Fault.NEGATIVE: Ending(
        0.3, told("doStep at t = 0.3 s", "status -1", "to answer -1 to the step to t = 0.4 s")
    ),
}


def table(folder: Path) -> polars.DataFrame:
    """results.csv with all its values as numbers."""
    frame = polars.read_csv(folder / "results.csv")
    return frame.cast(polars.Float64)


def assert_ended(result: Result, folder: Path, last: float, sentence: str) -> None:
    """The run ended with this sentence, and all rows up to this time are there, and no more."""
    assert result.problem == f"the run ended at t = {last:.6g} s: {sentence}"
    assert result.end_s == pytest.approx(last)
    frame = table(folder)
    assert frame["time"].to_numpy() == pytest.approx(np.arange(round(last / 0.1) + 1) * 0.1)
    assert np.isfinite(frame.to_numpy()).all()
    assert json.loads((folder / "run.json").read_text())["status"] == result.problem
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["run"]["steps"] == len(frame) - 1


def assert_tidy(counts: list[Counts], *, died: bool = False) -> None:
    """Nothing is left of instances and states; after fmi2Fatal they may not even be freed."""
    assert counts
    for count in counts:
        assert count.calls_after_fatal == 0
        assert (count.instances > 0) == died
        assert died or count.states == 0


def invoked(system: System, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Finished:
    """`emla run` of a system."""
    monkeypatch.setattr(emla_cosim.cli.commands.run, "load", lambda _, **options: load(system, **options))
    times = ["--stop-time", "1", "--step-size", "0.1"]
    words = ["run", "test", *times, "--no-plots", "--output", str(folder)]
    return CliRunner().invoke(app, words)


# ---- during steps of one length ----------------------------------------------------------------


@pytest.mark.parametrize("stepped", STEPPED)
@pytest.mark.parametrize("fault", ENDINGS)
def test_a_failing_slave_ends_the_run_with_its_words(
    fault: Fault, stepped: str, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    result = run_system(line_with_a_fault(faulty_fmu, fault, AT), tmp_path, **STEPPED[stepped])
    assert result.stepping["compiled"] == stepped.startswith("compiled")
    assert_ended(result, tmp_path, ENDINGS[fault].last, ENDINGS[fault].sentence)
    assert_tidy(counts, died=fault == Fault.FATAL)


@pytest.mark.parametrize("stepped", STEPPED)
@pytest.mark.parametrize("fault", [Fault.DISCARD, Fault.ERROR, Fault.GET_REAL, Fault.SET_REAL])
def test_a_slave_is_not_terminated_after_an_error(
    fault: Fault, stepped: str, faulty_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The standard forbids it after fmi2Error, and asks for it after fmi2Discard."""
    terminated: list[str] = []
    terminate = FMU2Slave.terminate

    def noted(slave: FMU2Slave) -> None:
        terminated.append(slave.instanceName)
        terminate(slave)

    monkeypatch.setattr(FMU2Slave, "terminate", noted)
    system = line_with_a_fault(faulty_fmu, fault, AT)
    run_system(system, tmp_path, **STEPPED[stepped])
    others = {c.name for c in system.components} - {"j.bad"}
    assert others and set(terminated) == others | ({"j.bad"} if fault == Fault.DISCARD else set())
    assert len(terminated) == len(set(terminated))


@pytest.mark.parametrize("stepped", STEPPED)
@pytest.mark.parametrize("fault", [Fault.WARNING, Fault.NAN_Z])
def test_a_warning_or_a_value_that_nobody_reads_ends_nothing(
    fault: Fault, stepped: str, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    result = run_system(line_with_a_fault(faulty_fmu, fault, AT), tmp_path, **STEPPED[stepped])
    assert result.problem is None
    frame = table(tmp_path)
    assert len(frame) == 11
    late = frame["time"].to_numpy() > AT
    assert (np.isnan(frame["j.bad.z"].to_numpy()) == (late & (fault == Fault.NAN_Z))).all()
    assert frame["j.bad.y"].to_numpy()[1:] == pytest.approx(np.arange(1, 11) * 0.2 + 1.0)
    assert_tidy(counts)


@pytest.mark.parametrize("stepped", STEPPED)
def test_a_slave_that_steps_rarely_fails_where_its_step_begins(
    stepped: str, faulty_fmu: Path, tmp_path: Path
) -> None:
    """Steps of 0.2 s: the one from 0.2 s passes the time, when the others have come to 0.3 s."""
    system = line_with_a_fault(faulty_fmu, Fault.ERROR, AT)
    result = run_system(system, tmp_path, **STEPPED[stepped], step_multiples={"j.bad": 2})
    assert_ended(
        result, tmp_path, 0.3, told("doStep at t = 0.2 s", "fmi2Error", "to fail in the step to t = 0.4 s")
    )


@pytest.mark.parametrize("stepped", STEPPED)
def test_rows_that_are_not_due_are_left_out_but_the_last(
    stepped: str, faulty_fmu: Path, tmp_path: Path
) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.ERROR, AT)
    run_system(system, tmp_path, **STEPPED[stepped], output_interval=0.2)
    assert table(tmp_path)["time"].to_list() == pytest.approx([0.0, 0.2, 0.3])


@pytest.mark.parametrize("fault", [Fault.ENTER_INITIALIZATION, Fault.EXIT_INITIALIZATION])
def test_a_slave_that_refuses_to_initialize_leaves_no_rows(
    fault: Fault, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    result = run_system(line_with_a_fault(faulty_fmu, fault, AT), tmp_path)
    verb = "enter" if fault == Fault.ENTER_INITIALIZATION else "exit"
    sentence = told(f"{verb}InitializationMode", "fmi2Error", f"not to {verb} initialization mode")
    assert result.problem == f"the run ended at t = 0 s: {sentence}"
    assert len(table(tmp_path)) == 0
    assert json.loads((tmp_path / "metrics.json").read_text())["run"]["steps"] == 0
    assert_tidy(counts)


def test_a_failure_is_one_sentence_of_the_command(
    faulty_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    result = invoked(line_with_a_fault(faulty_fmu, Fault.ERROR, AT), out, monkeypatch)
    assert result.exit_code == 1
    errors = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert errors == [
        f"Error: the run ended at t = 0.3 s: {ENDINGS[Fault.ERROR].sentence} The results so far are in {out}."
    ]
    assert names(out) == {"results.csv", "metrics.json", "run.json"}


# ---- strong coupling ---------------------------------------------------------------------------


@pytest.mark.parametrize("make", [line_with_a_fault, loop_with_a_fault])
@pytest.mark.parametrize("fault", [f for f in ENDINGS if f not in (Fault.DISCARD, Fault.SET_REAL)])
def test_a_failing_slave_ends_a_strongly_coupled_run(
    fault: Fault,
    make: Callable[..., System],
    faulty_fmu: Path,
    tmp_path: Path,
    counts: list[Counts],
) -> None:
    result = run_system(make(faulty_fmu, fault, AT), tmp_path, "strong")
    assert result.problem is not None and "j.bad" in result.problem
    frame = table(tmp_path)
    assert frame["time"][-1] == pytest.approx(0.3) and np.isfinite(frame.to_numpy()).all()
    assert result.end_s == pytest.approx(0.3)
    assert_tidy(counts, died=fault == Fault.FATAL)


@pytest.mark.parametrize("make", [line_with_a_fault, loop_with_a_fault])
def test_a_discarded_step_is_given_up_after_some_halvings(
    make: Callable[..., System], faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    result = run_system(make(faulty_fmu, Fault.DISCARD, AT), tmp_path, "strong")
    found = re.fullmatch(
        r"the run ended at t = 0.3 s: j.bad answered doStep at t = (\S+) s with fmi2Discard. It said:.*"
        r"the faulty model was told to discard the step to t = (\S+) s\.",
        result.problem or "",
    )
    assert found, result.problem
    assert AT - 1e-3 < float(found[1]) <= AT < float(found[2]) < AT + 1e-3
    assert table(tmp_path)["time"][-1] == pytest.approx(0.3)
    assert_tidy(counts)


def test_a_step_that_is_too_long_for_a_slave_is_done_in_parts(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    """The input is constant: every way to divide the step is exact."""
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0, longest=0.3 * 0.125)
    result = run_system(system, tmp_path, "strong", step_size=0.125)
    assert result.problem is None
    frame = table(tmp_path)
    assert len(frame) == 9
    assert frame["j.bad.z"].to_list() == [2.0 * 0.125 * k for k in range(9)]
    assert_tidy(counts)


def test_a_loop_with_a_step_too_long_for_one_of_it_is_done_in_parts() -> None:
    """Everyone in the loop takes the parts: just as if the step were as short as they are."""

    def ending(longest: float, step: float) -> np.ndarray:
        def advance(u: np.ndarray, x: np.ndarray, t: float, h: float) -> np.ndarray:
            if h > longest:
                raise DiscardedStepError("position", "doStep", "fmi2Discard", [])
            return x + h * u

        position = FakeSlave("position", 1, [1.0], advance)
        speed = FakeSlave("speed", 1, [0.0], lambda u, x, t, h: x - h * u)
        network = Network([position, speed], [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)])
        return simulated(network, Strong(coupling_tolerance=1e-13), make_communication_points(1.0, step))[-1]

    assert ending(0.3 * 0.125, 0.125) == pytest.approx(ending(1.0, 0.25 * 0.125), abs=1e-11)


# ---- error control -----------------------------------------------------------------------------


@pytest.mark.parametrize("fault", [f for f in ENDINGS if f != Fault.DISCARD])
def test_a_failing_slave_ends_a_run_with_error_control(
    fault: Fault, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    result = run_system(line_with_a_fault(faulty_fmu, fault, AT), tmp_path, error_tolerance=0.1)
    assert result.problem is not None and "j.bad" in result.problem
    frame = table(tmp_path)
    assert np.isfinite(frame.to_numpy()).all()
    assert frame["time"][-1] == result.end_s
    assert len(frame) == result.steps + 1
    assert_tidy(counts, died=fault == Fault.FATAL)


def test_a_discarded_step_is_given_up_when_it_is_tiny(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.DISCARD, AT)
    result = run_system(system, tmp_path, error_tolerance=0.1)
    assert result.problem is not None
    assert re.search(r"j.bad answered doStep at t = 0.3(5|49999)\d* s", result.problem)
    assert "with fmi2Discard. It said: the faulty model was told to discard" in result.problem
    assert 0.35 - 1e-6 < table(tmp_path)["time"][-1] <= 0.35 + 1e-8
    assert_tidy(counts)


def test_error_control_finds_the_longest_step_that_a_slave_does(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0, longest=0.3 * 0.125)
    result = run_system(system, tmp_path, step_size=0.125, error_tolerance=0.5)
    assert result.problem is None and result.stepping["rejected_steps"] > 0
    frame = table(tmp_path)
    assert frame["time"][-1] == 1.0
    np.testing.assert_allclose(frame["j.bad.z"], 2.0 * frame["time"], rtol=1e-12)
    assert_tidy(counts)


@pytest.mark.parametrize("options", [{"algorithm": "strong"}, {"error_tolerance": 0.1}, {"checkpoint": "c"}])
def test_a_state_that_a_slave_does_not_give_ends_the_run(
    options: dict[str, Any], faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    if "checkpoint" in options:
        options = {"checkpoint": tmp_path / "c"}
    result = run_system(loop_with_a_fault(faulty_fmu, Fault.GET_STATE, AT), tmp_path / "out", **options)
    assert result.problem is not None
    assert "j.bad answered getFMUstate with fmi2Error. It said: the faulty model was told" in result.problem
    assert np.isfinite(table(tmp_path / "out").to_numpy()).all()
    assert not (tmp_path / "c").exists()
    assert_tidy(counts)


# ---- FMUs that cannot go back ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"algorithm": "strong"}, "the strong coupling of a loop needs FMUs with canGetAndSetFMUstate"),
        ({"error_tolerance": 0.1}, "error control needs FMUs with canGetAndSetFMUstate"),
        ({"checkpoint": Path("c")}, "a checkpoint needs FMUs with canSerializeFMUstate"),
    ],
)
def test_what_needs_states_names_who_has_none(
    options: dict[str, Any], sentence: str, faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    plain = build_faulty_fmu(tmp_path, rollback=False, name="Plain")
    system = wired(
        [faulty("j.a", faulty_fmu), faulty("j.b", plain), faulty("j.c", plain)],
        "j.a.y -> j.b.u",
        "j.b.y -> j.c.u",
        "j.c.y -> j.a.u",
    )
    with pytest.raises(CommandError) as refused:
        run_system(system, tmp_path / "out", **options)
    assert str(refused.value) == f"{sentence}; j.b, j.c cannot do it."
    assert refused.value.exit_code == 2
    assert list((tmp_path / "out").iterdir()) == []
    assert_tidy(counts)


def test_a_state_of_incredible_size_is_not_believed(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts]
) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.HUGE_STATE, AT)
    result = run_system(system, tmp_path / "out", checkpoint=tmp_path / "c")
    assert result.problem is not None
    assert f"j.bad answered SerializedFMUstateSize with {2**60} bytes, more than {2**32}." in result.problem
    assert not (tmp_path / "c").exists()
    assert len(table(tmp_path / "out")) == 11
    assert_tidy(counts)


def test_checkpoints_leave_no_states_behind(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many are freed as are made, while the FMUs still are."""
    monkeypatch.setattr(emla_cosim.recorders.checkpoints, "INTERVAL", 0.0)
    monkeypatch.setattr(emla_cosim.run.execution, "FLUSH_INTERVAL", 0.0)
    saved: list[int] = []

    def saving(*arguments: Any) -> None:
        save_checkpoint(*arguments)
        saved.append(counts[0].states)

    monkeypatch.setattr(emla_cosim.recorders.checkpoints, "save_checkpoint", saving)
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    run_system(system, tmp_path / "out", checkpoint=tmp_path / "c")
    resumed = run_system(
        system, tmp_path / "out", stop_time=2.0, resume=tmp_path / "c", checkpoint=tmp_path / "d"
    )
    assert resumed.problem is None
    assert len(saved) >= 4
    assert set(saved) == {0}
    assert_tidy(counts)


def test_strong_coupling_without_loops_needs_no_states(faulty_fmu: Path, tmp_path: Path) -> None:
    plain = build_faulty_fmu(tmp_path, rollback=False, name="Plain")
    system = wired([faulty("j.a", plain, b=1.0, u=1.0), faulty("j.b", plain)], "j.a.y -> j.b.u")
    assert run_system(system, tmp_path / "out", "strong").problem is None
    assert table(tmp_path / "out")["time"][-1] == 1.0


# ---- a full disk -------------------------------------------------------------------------------


class Full(Recorder):
    """Has room for some rows only, and notes what it is told."""

    def __init__(self, room: int) -> None:
        self.room, self.rows, self.ended = room, 0, False

    def __str__(self) -> str:
        return "the shelf"

    def write(self, rows: np.ndarray) -> None:
        self.rows += len(rows)
        if self.rows > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def end(self) -> None:
        self.ended = True


def test_every_recorder_is_ended_when_one_is_full() -> None:
    recorders = [Full(3), Full(100)]
    buffer = RowBuffer(2, recorders, block_rows=2)
    with pytest.raises(RecordingError, match=r"^the shelf cannot be written: No space left on device\.$"):
        for _ in range(10):
            buffer.room(1)[:] = 0.0
            buffer.commit(1)
    buffer.end()
    assert [recorder.ended for recorder in recorders] == [True, True]
    assert recorders[0].rows == 4


@pytest.mark.parametrize("stepped", STEPPED)
def test_a_full_disk_ends_the_run_where_it_was(
    stepped: str, faulty_fmu: Path, tmp_path: Path, counts: list[Counts], monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []

    def write(file: CsvFile, rows: np.ndarray) -> None:
        if len(written) > 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append(len(rows))

    monkeypatch.setattr(CsvFile, "write", write)
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    result = run_system(system, tmp_path, stop_time=2000.0, **STEPPED[stepped])
    assert result.problem == f"{tmp_path / 'results.csv'} cannot be written: No space left on device."
    assert sum(written) <= result.steps < 20_000
    assert json.loads((tmp_path / "run.json").read_text())["status"] == result.problem
    assert_tidy(counts)


def test_rows_that_fit_on_the_disk_are_whole(tmp_path: Path) -> None:
    """No part of a row is left, nor one out of order."""
    path = tmp_path / "results.csv"
    file = CsvFile(path)
    file.begin(Outline(["a", "b"], [None, None], make_communication_points(50.0, 1.0), range(2), every=3))
    rows = np.random.default_rng(1).normal(size=(50, 3))
    with files_of_at_most(1000):
        file.write(rows[:2])
        with pytest.raises(OSError, match="File too large"):
            file.write(rows[2:])
            file.memory()  # waits until the rows are on the disk
        file.end()
    found = polars.read_csv(path).to_numpy()
    assert path.read_bytes().endswith(b"\n")
    assert 1 <= len(found) < 17
    assert (found == rows[::3][: len(found)]).all()


# ---- Ctrl-C ------------------------------------------------------------------------------------


def started(fmus: Path, folder: Path, *options: str) -> subprocess.Popen[str]:
    """A run of a simulated quarter of an hour in a process of its own, which has begun to step."""
    arguments = ["run", "lift", "--stop-time", "1000", "--no-plots", "--fmus", str(fmus), *options]
    process = subprocess.Popen(
        [sys.executable, "-m", "emla_cosim", *arguments, "--output", "out"],
        cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    results, deadline = folder / "out" / "results.csv", time.monotonic() + 60.0
    while not (results.exists() and results.stat().st_size > 10_000):
        assert process.poll() is None and time.monotonic() < deadline, process.communicate()
        time.sleep(0.02)
    return process


def test_ctrl_c_ends_a_compiled_run_between_two_steps(fmu_folder: Path, tmp_path: Path) -> None:
    process = started(fmu_folder, tmp_path, "--output-interval", "1e-2", "--realtime", "100")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert re.search(r"Error: interrupted at t = \S+ s\. The results so far are in out\.", errors)
    assert "Traceback" not in errors
    record = json.loads((tmp_path / "out/run.json").read_text())
    assert record["stepping"]["compiled"] and record["status"].startswith("interrupted at t = ")
    frame, steps = table(tmp_path / "out"), record["stepping"]["steps"]
    assert frame["time"][-1] == pytest.approx(steps * 1e-4)
    assert json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"] == steps


def test_a_second_ctrl_c_ends_at_once_and_keeps_whole_rows(
    faulty_fmu: Path, tmp_path: Path, counts: list[Counts], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(signal.SIGINT)  # a job in the background begins with it ignored

    def interrupted_twice(
        stepping: Stepping, rows: RowSink, interrupted: Callable[[], bool], *_: object
    ) -> None:
        stepping.advance(rows, 5)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)  # as a parent that passes it on
        assert interrupted()
        time.sleep(ONE_REQUEST)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(emla_cosim.run.execution, "simulate", interrupted_twice)
    result = invoked(line_with_a_fault(faulty_fmu, Fault.NONE, 0.0), tmp_path / "out", monkeypatch)
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1] == "Interrupted."
    assert table(tmp_path / "out")["time"].to_list() == pytest.approx([0.1 * k for k in range(6)])
    assert signal.getsignal(signal.SIGINT) is before
    assert_tidy(counts)
