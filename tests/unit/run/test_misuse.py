"""Mistakes of a program that uses the package: one error message, and other results stay the same."""

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import fmpy.fmi1
import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.files import get_working_folder
from emla_cosim.system.model import System
from tests.support.faulty_systems import faulty, line_with_a_fault
from tests.support.hand_written_fmus import Fault

Array = np.ndarray


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift", stop_time=0.02, fmus=fmu_folder).prepare() as simulation:
        yield simulation


def rows(result: ec.Result) -> bytes:
    """All bits of all rows."""
    return np.column_stack(list(result.read(["time", *result.names]).values())).tobytes()


def in_threads(function: Callable[[], object]) -> None:
    """Call a function in four threads at once."""
    with ThreadPoolExecutor(4) as threads:
        for future in [threads.submit(function) for _ in range(4)]:
            future.result()


def test_simulations_in_threads_are_independent(fmu_folder: Path) -> None:
    scenario = ec.load("lift", stop_time=0.1, fmus=fmu_folder)
    actual: list[bytes] = []

    def run() -> None:
        with scenario.prepare() as simulation:
            actual.append(rows(simulation.run()))

    in_threads(run)
    run()
    assert len(actual) == 5 and len(set(actual)) == 1


def test_threads_that_prepare_keep_the_working_folder(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The working folder belongs to all of them, and a library is loaded from a folder of its own."""
    load = fmpy.fmi1.cdll.LoadLibrary

    def slowly(path: str) -> Any:
        time.sleep(0.02)
        return load(path)

    monkeypatch.setattr(fmpy.fmi1.cdll, "LoadLibrary", slowly)
    monkeypatch.chdir(tmp_path)
    scenario, folders = ec.load("lift", stop_time=0.01, fmus=fmu_folder), set[Path]()

    def prepare() -> None:
        with scenario.prepare():
            folders.add(get_working_folder())

    in_threads(prepare)
    assert folders == {tmp_path}
    assert Path.cwd() == tmp_path


def test_unloadable_library_keeps_the_working_folder(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: str) -> Any:
        raise OSError("not today")

    monkeypatch.setattr(fmpy.fmi1.cdll, "LoadLibrary", refuse)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ec.CommandError, match=r"cannot be started: .* not today"):
        ec.load("lift", stop_time=0.01, fmus=fmu_folder).prepare()
    assert Path.cwd() == tmp_path


class Failing(ec.Recorder):
    """Raises an error of its own in one of its methods."""

    def __init__(self, where: str, error: BaseException) -> None:
        def fail(*_: Any) -> None:
            raise error

        setattr(self, where, fail)


@pytest.mark.parametrize(
    ("where", "error"),
    [
        *((where, ValueError("mine")) for where in ("begin", "write", "pause", "end")),
        *(("write", error) for error in (SystemExit(3), KeyboardInterrupt())),
    ],
)
def test_error_of_a_recorder_is_raised_and_others_are_ended(
    where: str, error: BaseException, lift: ec.Simulation
) -> None:
    before, ended = ec.TimeSeries(), []

    class Last(ec.TimeSeries):
        def end(self) -> None:
            ended.append(len(self.rows))

    with pytest.raises(type(error)) as caught:
        lift.run(recorders=[before, Failing(where, error), Last()])
    assert caught.value is error
    if where != "begin":
        assert ended == [len(before.rows)]
        assert len(before.rows) == (1 if where == "pause" else 21)
    assert lift.run().problem is None


def test_simulation_can_be_closed_once_and_not_used_after_it(fmu_folder: Path) -> None:
    """Even if a recorder raises an error then."""
    simulation = ec.load("lift", stop_time=0.01, fmus=fmu_folder).prepare()
    simulation.start(recorders=[Failing("pause", ValueError("mine"))])
    with pytest.raises(ValueError, match="mine"):
        simulation.close()
    simulation.close()
    for use in (simulation.run, simulation.start, lambda: simulation.advance(0.002), lambda: simulation["x"]):
        with pytest.raises(ec.CommandError, match="the simulation is closed"):
            use()


@pytest.mark.parametrize(
    ("use", "where"),
    [
        *((use, "pause") for use in ("run", "attempt", "start", "finish", "close", "advance")),
        *(("run", where) for where in ("begin", "write", "end")),
    ],
)
def test_recorder_cannot_run_its_simulation(use: str, where: str, lift: ec.Simulation) -> None:
    refused: list[str] = []

    def meddle(*_: Any) -> None:
        with pytest.raises(ec.CommandError) as caught:
            getattr(lift, use)(*((0.01,) if use == "advance" else ()))
        refused.append(str(caught.value))

    recorder = ec.Recorder()
    setattr(recorder, where, meddle)
    plain = rows(lift.run())
    assert rows(lift.run(recorders=[recorder, ec.TimeSeries()])) == plain
    assert set(refused) == {"the simulation is running; a recorder cannot run, end or close it."}


def test_full_disk_of_a_recorder_is_reported(lift: ec.Simulation) -> None:
    series = ec.TimeSeries()
    full = Failing("write", OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    with pytest.raises(ec.RunError, match=r"cannot be written: No space left on device\.$"):
        lift.run(recorders=[series, full])
    assert len(series.rows)


def test_rows_are_read_only(lift: ec.Simulation) -> None:
    class Scribbling(ec.Recorder):
        def write(self, rows: Array) -> None:
            rows[:] = 0.0

    with pytest.raises(ValueError, match="read-only"):
        lift.run(recorders=[Scribbling()])


def test_other_threads_cannot_use_a_running_simulation(lift: ec.Simulation) -> None:
    refused: list[str] = []

    def meddle() -> None:
        for use in (
            lift.run, lift.finish, lambda: lift["lift.plant.x_L"], lambda: lift.__setitem__("a.b", 1)
        ):  # fmt: skip
            with pytest.raises(ec.CommandError) as caught:
                use()
            refused.append(str(caught.value))

    class Waiting(ec.Recorder):
        def end(self) -> None:
            thread = threading.Thread(target=meddle)
            thread.start()
            thread.join()

    assert lift.run(recorders=[Waiting()]).problem is None
    assert len(refused) == 4
    assert {text.partition(";")[0] for text in refused} == {"another thread uses this simulation"}


@pytest.mark.parametrize(
    "mistake",
    [
        lambda lift: lift["lift.plant.nothing"],
        lambda lift: lift.__setitem__("lift.plant.nothing", 1.0),
        lambda lift: lift.advance(1.5e-4),
        lambda lift: lift.run(set={"lift.plant.nothing": 1.0}),
    ],
    ids=["read", "set", "advance", "run"],
)
def test_mistake_does_not_lock_out_other_threads(
    mistake: Callable[[ec.Simulation], Any], lift: ec.Simulation
) -> None:
    with pytest.raises(ec.CommandError):
        mistake(lift)
    with ThreadPoolExecutor(1) as executor:
        assert executor.submit(lift.run, stop_time=1e-3).result().problem is None
        assert executor.submit(lambda: lift["lift.plant.x_L"]).result() > 0.0


DIVIDING = """
import os, sys
import emla_cosim as ec
with ec.load("lift", stop_time=0.01, fmus=sys.argv[1]).prepare(isolate=["lift.plant"]) as simulation:
    before = simulation.run().to_polars()
    if os.fork() == 0:
        try:
            simulation.run()
        except ec.RunError as error:
            print(error, flush=True)
        sys.exit(0)
    os.wait()
    assert simulation.run().to_polars().equals(before)
    assert simulation.run(fresh=True).to_polars().equals(before)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no `fork`.")
def test_forked_process_cannot_use_isolated_fmus(fmu_folder: Path) -> None:
    process = subprocess.run(
        [sys.executable, "-c", DIVIDING, str(fmu_folder)], capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr
    assert process.stdout == "the FMU of lift.plant belongs to another process. Prepare it in this process.\n"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="Windows has no `setitimer`.")
def test_late_answer_of_an_isolated_fmu_is_ignored(faulty_fmu: Path) -> None:
    """What is raised while an FMU's process is at work leaves its answer in the pipe."""

    def ring(*_: object) -> None:
        raise TimeoutError("mine")

    before = signal.signal(signal.SIGALRM, ring)
    system = line_with_a_fault(faulty_fmu, Fault.HANG, 0.35)
    try:
        with ec.load(system, stop_time=1.0, step_size=0.1).prepare(isolate=["j.bad"]) as simulation:
            assert simulation.run(set={"j.bad.fault": 0}).steps == 10  # from now on all is loaded
            signal.setitimer(signal.ITIMER_REAL, 1.0)
            with pytest.raises(TimeoutError, match="mine"):
                simulation.run()
            assert simulation.run(set={"j.bad.fault": 0}).steps == 10
    finally:
        signal.signal(signal.SIGALRM, before)


TABLE = ec.TimeSeries()
WRONG_TYPES: list[tuple[Callable[[ec.Simulation], Any], str]] = [
    (lambda _: ec.System.of({"a": 3}), "a is 3; it must be an FMU file, a block class or"),  # type: ignore
    (lambda _: ec.System.of({"a": "Reference"}, [3]), "'3' is not a connection"),  # type: ignore
    (lambda lift: lift.run(recorders=TABLE), "must be a list"),  # type: ignore
    (lambda lift: lift.run(recorders=3), "must be a list"),  # type: ignore
    (lambda lift: lift.run(recorders=[None]), "None is not a Recorder"),  # type: ignore
    (lambda lift: lift.run(recorders=[TABLE, TABLE]), "has a recorder twice"),
    (lambda lift: lift.run(stop_time=np.array([0.02, 0.03])), "must be a number"),
    (lambda lift: lift.advance("soon"), "the time to advance to is 'soon'; it must be a number"),
    (lambda lift: lift.advance(float("nan")), "t = nan s is not a communication point"),
    (lambda lift: lift[3], "'3' is not a variable"),  # type: ignore
    (lambda lift: lift.run()[3], "the signal '3' was not recorded"),  # type: ignore
    (lambda lift: lift.run().save(None), "the folder is None; it must be a text"),  # type: ignore
]


@pytest.mark.parametrize(("use", "words"), WRONG_TYPES, ids=[words for _, words in WRONG_TYPES])
def test_values_of_other_types_are_refused(
    use: Callable[[ec.Simulation], Any], words: str, lift: ec.Simulation
) -> None:
    with pytest.raises(ec.CommandError) as caught:
        use(lift)
    assert words in str(caught.value)
    assert lift.run(recorders=(r for r in [TABLE])).problem is None  # pyright: ignore[reportArgumentType]


def test_two_components_of_one_name_are_refused(faulty_fmu: Path) -> None:
    system = System(2 * (faulty("j.a", faulty_fmu),), ())
    with pytest.raises(ec.CommandError, match=r"there are two components 'j\.a'"):
        ec.load(system, stop_time=1.0, step_size=0.1).prepare()


def test_removed_working_folder_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(ec.CommandError, match="the current folder was removed"):
        ec.load("lift", stop_time=0.01).prepare()
