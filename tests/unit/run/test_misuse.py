"""A program of the user's own that goes about it wrongly: refused in one sentence, and nothing is lost."""

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
from tests.support.faulty_fmu import Fault
from tests.support.faulty_systems import faulty, line_with_a_fault

Array = np.ndarray


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift", stop_time=0.02, fmus=fmu_folder).prepare() as simulation:
        yield simulation


def rows(result: ec.Result) -> bytes:
    """All bits of all rows."""
    return np.column_stack(list(result.read(["time", *result.names]).values())).tobytes()


def test_simulations_in_threads_do_not_meet(fmu_folder: Path) -> None:
    scenario = ec.load("lift", stop_time=0.5, fmus=fmu_folder)
    found: list[bytes] = []

    def run() -> None:
        with scenario.prepare() as simulation:
            found.append(rows(simulation.run()))

    threads = [threading.Thread(target=run) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    run()
    assert len(found) == 7
    assert len(set(found)) == 1


def test_threads_that_prepare_stay_where_they_are(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The working folder belongs to all of them, and a library is loaded from a folder of its own."""
    load = fmpy.fmi1.cdll.LoadLibrary

    def slowly(path: str) -> Any:
        time.sleep(0.02)
        return load(path)

    monkeypatch.setattr(fmpy.fmi1.cdll, "LoadLibrary", slowly)
    monkeypatch.chdir(tmp_path)
    scenario, seen = ec.load("lift", stop_time=0.01, fmus=fmu_folder), set[Path]()

    def prepare() -> None:
        with scenario.prepare():
            seen.add(get_working_folder())

    threads = [threading.Thread(target=prepare) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert seen == {tmp_path}
    assert Path.cwd() == tmp_path


def test_a_library_that_cannot_be_loaded_leaves_the_working_folder(
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


@pytest.mark.parametrize("where", ["begin", "write", "pause", "end"])
@pytest.mark.parametrize("error", [ValueError("mine"), SystemExit(3), KeyboardInterrupt()], ids=repr)
def test_an_error_of_a_recorder_is_told_and_spoils_nothing(
    where: str, error: BaseException, lift: ec.Simulation
) -> None:
    before, ended = ec.TimeSeries(), []

    class Last(ec.TimeSeries):
        def end(self) -> None:
            ended.append(len(self.rows))

    with pytest.raises(type(error)) as found:
        lift.run(recorders=[before, Failing(where, error), Last()])
    assert found.value is error
    if where != "begin":
        assert ended == [len(before.rows)]
        assert len(before.rows) == (1 if where == "pause" else 21)
    assert lift.run().problem is None


def test_a_simulation_whose_recorder_is_broken_can_be_closed(fmu_folder: Path) -> None:
    simulation = ec.load("lift", stop_time=0.01, fmus=fmu_folder).prepare()
    simulation.start(recorders=[Failing("pause", ValueError("mine"))])
    with pytest.raises(ValueError, match="mine"):
        simulation.close()
    with pytest.raises(ec.CommandError, match="the simulation is closed"):
        simulation.run()


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "strong"])
@pytest.mark.parametrize("use", ["run", "attempt", "start", "finish", "close", "advance"])
@pytest.mark.parametrize("where", ["begin", "write", "pause", "end"])
def test_a_recorder_cannot_run_what_it_records(
    use: str, where: str, algorithm: str, lift: ec.Simulation
) -> None:
    refused: list[str] = []

    def meddle(*_: Any) -> None:
        with pytest.raises(ec.CommandError) as found:
            getattr(lift, use)(*((0.01,) if use == "advance" else ()))
        refused.append(str(found.value))

    recorder = ec.Recorder()
    setattr(recorder, where, meddle)
    plain = rows(lift.run(algorithm=algorithm))
    assert rows(lift.run(algorithm=algorithm, recorders=[recorder, ec.TimeSeries()])) == plain
    assert set(refused) == {"the simulation is running; a recorder cannot run, end or close it."}


def test_a_recorder_may_look_at_values(lift: ec.Simulation) -> None:
    found: list[float] = []

    class Looking(ec.Recorder):
        def write(self, rows: Array) -> None:
            found.append(lift["lift.plant.x_L"])

    result = lift.run(recorders=[Looking(), ec.TimeSeries()])
    assert found[-1] == result["lift.plant.x_L"][-1]


def test_rows_cannot_be_changed_on_their_way(lift: ec.Simulation) -> None:
    class Scribbling(ec.Recorder):
        def write(self, rows: Array) -> None:
            rows[:] = 0.0

    with pytest.raises(ValueError, match="read-only"):
        lift.run(recorders=[Scribbling()])


def test_recorders_are_a_list_of_recorders(lift: ec.Simulation) -> None:
    table = ec.TimeSeries()
    assert len(lift.run(recorders=(r for r in [table])).time) == 21  # pyright: ignore[reportArgumentType]
    for wrong, words in (
        (table, "must be a list"),
        (3, "must be a list"),
        ([None], "None is no Recorder"),
        ([table, table], "has a recorder twice"),
    ):
        with pytest.raises(ec.CommandError, match=words):
            lift.run(recorders=wrong)  # pyright: ignore[reportArgumentType]


def test_no_other_thread_reads_values_or_ends_the_run(lift: ec.Simulation) -> None:
    refused: list[str] = []

    def meddle() -> None:
        for use in (lambda: lift["lift.plant.x_L"], lambda: lift.__setitem__("a.b", 1), lift.finish):
            with pytest.raises(ec.CommandError) as found:
                use()
            refused.append(str(found.value))

    class Waiting(ec.Recorder):
        def end(self) -> None:
            thread = threading.Thread(target=meddle)
            thread.start()
            thread.join()

    assert lift.run(recorders=[Waiting()]).problem is None
    assert len(refused) == 3
    assert {text.partition(";")[0] for text in refused} == {"another thread uses this simulation"}


MISTAKES: dict[str, Callable[[ec.Simulation], Any]] = {
    "read": lambda lift: lift["lift.plant.nothing"],
    "set": lambda lift: lift.__setitem__("lift.plant.nothing", 1.0),
    "set a parameter": lambda lift: lift.__setitem__("lift.plant.motor.R_s", 1.0),
    "advance": lambda lift: lift.advance(1.5e-4),
    "run": lambda lift: lift.run(nothing=1),
    "run with a value": lambda lift: lift.run(set={"lift.plant.nothing": 1.0}),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_keeps_no_other_thread_away(mistake: str, lift: ec.Simulation) -> None:
    with pytest.raises(ec.CommandError):
        MISTAKES[mistake](lift)
    with ThreadPoolExecutor(1) as other:
        assert other.submit(lift.run, stop_time=1e-3).result().problem is None
        assert other.submit(lambda: lift["lift.plant.x_L"]).result() > 0.0


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


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no `fork`.")
def test_a_process_that_divides_takes_nothing_with_it(fmu_folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", DIVIDING, str(fmu_folder)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "the FMU of lift.plant belongs to another process. Prepare it in this process.\n"


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="Windows has no `setitimer`.")
def test_a_late_answer_is_not_taken_for_another(faulty_fmu: Path) -> None:
    """What is raised while an FMU's process is at work leaves its answer in the pipe."""

    def ring(*_: object) -> None:
        raise TimeoutError("mine")

    before = signal.signal(signal.SIGALRM, ring)
    system = line_with_a_fault(faulty_fmu, Fault.HANG, 0.35)
    try:
        with ec.load(system, stop_time=1.0, step_size=0.1).prepare(isolate=["j.bad"]) as simulation:
            signal.setitimer(signal.ITIMER_REAL, 2.0)
            with pytest.raises(TimeoutError, match="mine"):
                simulation.run()
            assert simulation.run(set={"j.bad.fault": 0}).steps == 10
    finally:
        signal.signal(signal.SIGALRM, before)


def test_values_of_other_types_are_one_sentence(lift: ec.Simulation, tmp_path: Path) -> None:
    with pytest.raises(ec.CommandError, match="must be a number"):
        lift.run(stop_time=np.array([0.02, 0.03]))
    for folder in (None, 3, b"x"):
        with pytest.raises(ec.CommandError, match=r"the folder is .* must be a text"):
            lift.run().save(folder)  # pyright: ignore[reportArgumentType]


def test_a_working_folder_that_is_gone_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(ec.CommandError, match="the current folder was removed"):
        ec.load("lift", stop_time=0.01).prepare()


def test_two_components_have_two_names(faulty_fmu: Path) -> None:
    system = System(2 * (faulty("j.a", faulty_fmu),), ())
    with pytest.raises(ec.CommandError, match=r"there are two components 'j\.a'"):
        ec.load(system, stop_time=1.0, step_size=0.1).prepare()
