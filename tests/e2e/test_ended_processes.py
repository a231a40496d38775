"""An FMU that ends its process: the run says which call did it, and nothing computed is lost."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
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
from emla_cosim.base.units import LinearTransformation
from emla_cosim.master.instances.call_codes import CALLS, code_of, decode_call
from emla_cosim.master.stepping.record_layout import PRESENT
from emla_cosim.sandbox import black_box
from emla_cosim.study.loading import load
from emla_cosim.system.model import Alias, System
from tests.support.command_server import Call, CommandServer
from tests.support.faulty_fmu import MARK, Fault, build_faulty_fmu
from tests.support.faulty_systems import line_with_a_fault
from tests.support.tiers import mostly_slow
from tests.support.waiting import has_rows, wait_for
from tests.support.whole_files import names

AT = 0.35
HANGING = "hanging"
"""File that says that an FMU does not return any more."""
DEADLY = {
    Fault.EXIT: "doStep at t = 0.3 s (exit code 0)",
    Fault.SEGFAULT: "doStep at t = 0.3 s (SIGSEGV)",
    Fault.ABORT: "doStep at t = 0.3 s (SIGABRT)",
    Fault.SEGFAULT_GET_REAL: "getReal (SIGSEGV)",
}
"""What ends the process while it steps, and how that is told."""
LATE = {
    Fault.SEGFAULT_TERMINATE: "terminate",
    Fault.SEGFAULT_FREE: "freeInstance",
    Fault.SEGFAULT_FREE_STATE: "freeFMUstate",
}
"""What ends it when the last step is done."""
STEPPED: dict[str, dict[str, Any]] = {
    "compiled": {},
    "interpreted": {"compiled": False},
    "strong": {"algorithm": "strong"},
    "error control": {"algorithm": "jacobi", "error_tolerance": 1e-3},
}
"""Options by the way of stepping that they choose."""


def line(fmu: Path) -> System:
    """Three components, of which j.bad ends its process if told to; one output is told in another unit."""
    system = line_with_a_fault(fmu, Fault.NONE, AT)
    *front, sink = system.components
    milli = {"y_milli": Alias("y", LinearTransformation(1e-3))}
    return replace(system, components=(*front, replace(sink, aliases=milli)))


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The line as a package, in steps of 0.1 s."""
    folder = tmp_path_factory.mktemp("line")
    return load(line(build_faulty_fmu(folder)), stop_time=1.0, step_size=0.1).export(folder / "line.ssp")


@pytest.fixture(scope="module")
def server(fmu_folder: Path) -> Iterator[CommandServer]:
    with CommandServer(fmu_folder) as found:
        yield found


def started(folder: Path, *arguments: object, **how: Any) -> subprocess.Popen[str]:
    """The command, as a person calls it, with its temporary files in the folder."""
    temporary = folder / "temporary"
    temporary.mkdir(exist_ok=True)
    return subprocess.Popen(
        [sys.executable, "-m", "emla_cosim", *map(str, arguments)],
        cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(temporary), MARK: str(folder / HANGING)}, **how,
    )  # fmt: skip


def running(folder: Path, package: Path, fault: Fault, *options: object) -> subprocess.Popen[str]:
    """A run of the line into the folder's `out`."""
    return started(folder, *of_the_line(package, fault), *options)


def of_the_line(package: Path, fault: Fault) -> tuple[str, ...]:
    given = ("--output", "out", "--no-plots", "--output-interval", "0.1")
    return ("run", str(package), *given, "--set", f"j.bad.fault={fault.value}")


def failed_soon(server: CommandServer, folder: Path, *arguments: str) -> str:
    """The sentence of the same command in a process that had everything imported, as of `failed`."""
    (folder / "temporary").mkdir()
    environment = {"TMPDIR": str(folder / "temporary")}
    ended = server.call(Call(list(arguments), str(folder), environment=environment, patience=60.0))
    assert ended.alone
    return the_sentence(ended.code, ended.stderr, folder)


def failed(process: subprocess.Popen[str], folder: Path) -> str:
    """The sentence with which it ended, and nothing else is left."""
    _, errors = process.communicate(timeout=60.0)
    return the_sentence(process.returncode, errors, folder)


def the_sentence(code: int, errors: str, folder: Path) -> str:
    assert code == 1, errors
    assert "Traceback" not in errors
    assert not any((folder / "temporary").iterdir())
    (sentence,) = (text for text in errors.splitlines() if text.startswith("Error:"))
    return sentence


def record(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "out/run.json").read_text())


def table(folder: Path) -> polars.DataFrame:
    return polars.read_csv(folder / "out/results.csv")


def flags(options: dict[str, Any]) -> list[str]:
    """Options as the command takes them."""
    return [
        "--no-kernel" if name == "compiled" else f"--{name.replace('_', '-')}={value}"
        for name, value in options.items()
    ]


def whole(package: Path, **options: Any) -> polars.DataFrame:
    """All rows of the line without a fault."""
    with load(package, output_interval=0.1, **options).prepare() as simulation:
        return simulation.run().to_polars()


WAYS = [(fault, stepped, isolated) for fault in DEADLY for stepped in STEPPED for isolated in (False, True)]
FEW_WAYS = [
    (Fault.EXIT, "compiled", False),
    (Fault.SEGFAULT, "compiled", True),
    (Fault.SEGFAULT, "interpreted", False),
    (Fault.ABORT, "strong", False),
    (Fault.EXIT, "strong", True),
    (Fault.SEGFAULT_GET_REAL, "error control", False),
    (Fault.SEGFAULT_GET_REAL, "compiled", True),
]
"""All faults, ways of stepping and kinds of processes, but not each with each."""


@pytest.mark.parametrize(("fault", "stepped", "isolated"), mostly_slow(WAYS, FEW_WAYS))
def test_an_fmu_that_ends_the_process_is_named_and_every_row_is_kept(
    fault: Fault, stepped: str, isolated: bool, package: Path, server: CommandServer, tmp_path: Path
) -> None:
    options = (*flags(STEPPED[stepped]), *(["--isolate", "j.bad"] if isolated else []))
    sentence = failed_soon(server, tmp_path, *of_the_line(package, fault), *options)
    call = DEADLY[fault]
    if stepped == "error control" and fault is not Fault.SEGFAULT_GET_REAL:
        call = call.partition(" at ")[0]  # its steps are of its own choice
    assert f"j.bad ended {'its' if isolated else 'the'} process in {call}" in sentence
    assert f"Error: {record(tmp_path)['status']} The results so far are in out." == sentence
    rows = table(tmp_path)
    assert rows[:4].equals(whole(package, **STEPPED[stepped])[:4])
    assert len(rows) == 4 or stepped == "error control"  # which ends between two rows that are due
    metrics = json.loads((tmp_path / "out/metrics.json").read_text())
    assert metrics["run"]["steps"] >= 3


@pytest.mark.parametrize("stepped", ["compiled", "interpreted", "strong"])
def test_rows_that_wait_behind_those_passed_on_are_kept(
    stepped: str, package: Path, server: CommandServer, tmp_path: Path
) -> None:
    """4000 rows make a block: of 5500 the first are passed on, and 1500 wait."""
    small = ("--step-size", "1e-4", "--output-interval", "1e-4", "--set", "j.bad.at=0.54995")
    failed_soon(server, tmp_path, *of_the_line(package, Fault.SEGFAULT), *small, *flags(STEPPED[stepped]))
    assert np.allclose(table(tmp_path)["time"], 1e-4 * np.arange(5500))


@pytest.mark.parametrize("at", [0.54995, 1.04995])
def test_rows_that_wait_for_a_slow_disk_are_kept(at: float, package: Path, tmp_path: Path) -> None:
    """The thread that stores them has stored none, or a part, when the process ends."""
    slow = (
        "import os, time, emla_cosim.recorders.csv_file as c, emla_cosim.cli.program as p\n"
        "whole = c.CsvFile.store\n"
        "def store(file, rows):\n"
        "    if len(rows) > 1000 and not os.path.exists('slow'):  # the process that saves the rest is fast\n"
        "        whole(file, rows[:500])\n"
        "        open('slow', 'w').close()\n"
        "        time.sleep(3.0)\n"
        "        whole(file, rows[500:])\n"
        "    else:\n"
        "        whole(file, rows)\n"
        "c.CsvFile.store = store\n"
        "p.main()"
    )
    small = (
        "--step-size",
        "1e-4",
        "--output-interval",
        "1e-4",
        "--set",
        f"j.bad.at={at}",
        "--stop-time",
        "2",
    )
    (tmp_path / "temporary").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", slow, *of_the_line(package, Fault.SEGFAULT)[:-2], *small,
         *of_the_line(package, Fault.SEGFAULT)[-2:]],
        cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path / "temporary")},
    )  # fmt: skip
    failed(process, tmp_path)
    assert (tmp_path / "slow").exists()
    rows = table(tmp_path)
    assert np.allclose(rows["time"], 1e-4 * np.arange(round(at * 1e4 + 0.5)))
    assert json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"] == len(rows) - 1


def test_an_fmu_that_ends_the_process_before_the_first_step(package: Path, tmp_path: Path) -> None:
    sentence = failed(running(tmp_path, package, Fault.SEGFAULT_INITIALIZATION), tmp_path)
    assert "before its first step: j.bad ended the process in exitInitializationMode (SIGSEGV)" in sentence
    assert record(tmp_path) == {"scenario": "system", "status": sentence[7:].partition(" The results")[0]}


@pytest.mark.parametrize("fault", LATE, ids=lambda f: f.name)
def test_results_are_complete_before_fmus_are_ended(
    fault: Fault, package: Path, server: CommandServer, tmp_path: Path
) -> None:
    sentence = failed_soon(server, tmp_path, *of_the_line(package, fault), "--algorithm", "strong")
    assert f"j.bad ended the process in {LATE[fault]} (SIGSEGV), when the results were complete." in sentence
    assert record(tmp_path)["status"] in sentence
    assert record(tmp_path)["components"]["j.bad"]["parameters"]["fault"] == str(fault.value)
    assert table(tmp_path).equals(whole(package, algorithm="strong"))
    assert json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"] == 10


def test_an_end_when_fmus_are_freed_hides_no_earlier_problem(
    package: Path, server: CommandServer, tmp_path: Path
) -> None:
    more = ("--set", f"j.sink.fault={Fault.SEGFAULT_FREE.value}")
    sentence = failed_soon(server, tmp_path, *of_the_line(package, Fault.ERROR), *more)
    assert "j.bad answered doStep at t = 0.3 s with fmi2Error" in sentence
    assert "Then j.sink ended the process in freeInstance (SIGSEGV)" in sentence
    assert record(tmp_path)["status"] in sentence


def test_a_run_that_is_killed_between_its_last_row_and_its_files_gets_them(
    package: Path, tmp_path: Path
) -> None:
    keep = (
        "import os, signal, emla_cosim.views.output_folder as o, emla_cosim.cli.program as p\n"
        "parent, whole = os.getpid(), o.OutputFolder.keep\n"
        "def keep(*given):\n"
        "    if os.getpid() != parent and not os.path.exists('killed'):  # another child saves what is left\n"
        "        open('killed', 'w').close()\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "    return whole(*given)\n"
        "o.OutputFolder.keep = keep\n"
        "p.main()"
    )
    arguments = ("run", str(package), "--output", "out", "--no-plots", "--output-interval", "0.3")
    (tmp_path / "temporary").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", keep, *arguments], cwd=tmp_path, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path / "temporary")},
    )  # fmt: skip
    assert "the run ended at t = 1 s: the process was killed" in failed(process, tmp_path)
    assert table(tmp_path)["time"].to_list() == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.0])
    assert json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"] == 10
    assert "killed" in record(tmp_path)["status"]


@pytest.mark.parametrize("fault", mostly_slow(LATE, [Fault.SEGFAULT_FREE]), ids=lambda f: f.name)
def test_an_isolated_fmu_may_end_as_it_likes(
    fault: Fault, package: Path, server: CommandServer, tmp_path: Path
) -> None:
    isolated = (*of_the_line(package, fault), "--algorithm", "strong", "--isolate", "j.bad")
    assert server.call(Call(list(isolated), str(tmp_path), patience=60.0)).code == 0
    assert record(tmp_path)["status"] == "completed"


def test_parquet_keeps_what_was_written_in_parts(
    package: Path, server: CommandServer, tmp_path: Path
) -> None:
    failed_soon(server, tmp_path, *of_the_line(package, Fault.SEGFAULT), "--output-format", "parquet")
    rows = polars.read_parquet(tmp_path / "out/results.parquet")
    assert rows["time"].to_list() == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert names(tmp_path / "out") == {"results.parquet", "metrics.json", "run.json"}


def test_a_run_that_was_continued_is_kept_too(package: Path, tmp_path: Path) -> None:
    first = running(tmp_path, package, Fault.SEGFAULT, "--stop-time", 0.2, "--checkpoint", "c")
    assert first.wait(60.0) == 0
    failed(running(tmp_path, package, Fault.SEGFAULT, "--resume", "c"), tmp_path)
    assert table(tmp_path).equals(whole(package)[:4])
    assert json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"] == 1


@pytest.mark.parametrize("isolated", [False, True], ids=["guarded", "isolated"])
def test_ctrl_c_twice_ends_an_fmu_that_does_not_return(isolated: bool, package: Path, tmp_path: Path) -> None:
    process = running(tmp_path, package, Fault.HANG, *(["--isolate", "j.bad"] if isolated else []))
    wait_for((tmp_path / HANGING).exists)
    for _ in range(2):
        process.send_signal(signal.SIGINT)
        time.sleep(0.5)
    sentence = failed(process, tmp_path)
    assert "doStep at t = 0.3 s" in sentence
    assert table(tmp_path)["time"].to_list() == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_a_run_that_is_killed_is_finished_by_its_parent(fmu_folder: Path, tmp_path: Path) -> None:
    process = started(tmp_path, "run", "lift", "--stop-time", 1e5, "--fmus", fmu_folder, "--output", "out")
    wait_for(lambda: has_rows(tmp_path / "out/results.csv"))
    (child,) = psutil.Process(process.pid).children()
    child.kill()
    sentence = failed(process, tmp_path)
    assert "killed" in sentence
    steps = json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"]
    rows = table(tmp_path)["time"].to_numpy()
    assert rows[-1] == pytest.approx(steps * 1e-4)
    assert np.allclose(np.diff(rows[:-1]), 1e-3)


@pytest.mark.parametrize("isolated", [False, True], ids=["guarded", "isolated"])
def test_nobody_survives_a_parent_that_is_killed(isolated: bool, package: Path, tmp_path: Path) -> None:
    process = running(tmp_path, package, Fault.HANG, *(["--isolate"] if isolated else []))
    wait_for((tmp_path / HANGING).exists)
    left = psutil.Process(process.pid).children(recursive=True)
    assert len(left) == (4 if isolated else 1)
    process.kill()
    process.communicate(timeout=60.0)
    assert not psutil.wait_procs(left, timeout=10.0)[1]


@pytest.mark.parametrize(
    ("options", "isolated"),
    [
        ({}, True),
        ({"algorithm": "jacobi", "extrapolation": "fmu"}, ["lift.plant"]),
        ({"algorithm": "strong"}, ["lift.plant"]),
        pytest.param({}, ["lift.plant"], marks=pytest.mark.slow),
        pytest.param({"algorithm": "jacobi", "extrapolation": "fmu"}, True, marks=pytest.mark.slow),
        pytest.param({"algorithm": "strong"}, True, marks=pytest.mark.slow),
    ],
)
def test_isolation_changes_no_bit(
    options: dict[str, Any], isolated: bool | list[str], fmu_folder: Path
) -> None:
    scenario = ec.load("lift", stop_time=0.02, fmus=fmu_folder, **options)
    results = []
    for isolate in (False, isolated):
        with scenario.prepare(isolate=isolate) as simulation:
            results += [simulation.run().to_polars(), simulation.run(fresh=True).to_polars()]
    assert all(results[0].equals(other) for other in results[1:])


def test_isolated_fmus_of_the_other_flavour(package: Path) -> None:
    scenario = ec.load("lift", stop_time=0.002, flavour="python")
    results = []
    for isolate in (False, True):
        with scenario.prepare(isolate=isolate) as simulation:
            results.append(simulation.run().to_polars())
    assert results[0].equals(results[1])


def test_a_checkpoint_of_isolated_fmus_is_one_of_any(fmu_folder: Path, tmp_path: Path) -> None:
    scenario = ec.load("lift", stop_time=0.02, fmus=fmu_folder)
    with scenario.prepare(isolate=True) as simulation:
        simulation.run(stop_time=0.01, checkpoint=tmp_path / "c")
    with scenario.prepare() as simulation:
        end = simulation.run(resume=tmp_path / "c").to_polars()
        assert end.equals(simulation.run().to_polars().tail(len(end)))


def test_a_simulation_goes_on_with_a_new_process(package: Path) -> None:
    with load(package, output_interval=0.1).prepare(isolate=["j.bad"]) as simulation:
        for _ in range(2):
            with pytest.raises(ec.RunError, match=r"j\.bad ended its process in doStep") as found:
                simulation.run(set={"j.bad.fault": Fault.SEGFAULT.value})
            assert found.value.fields["result"].time[-1] == pytest.approx(0.3)
        assert simulation.run().to_polars().equals(whole(package))


def test_what_an_isolated_fmu_refuses_is_told_as_ever(package: Path) -> None:
    found = []
    for isolate in (False, ["j.bad"]):
        with load(package).prepare(isolate=isolate) as simulation:
            for fault in (Fault.ERROR, Fault.GET_REAL, Fault.DISCARD, Fault.TERMINATE, Fault.SET_REAL):
                with pytest.raises(ec.RunError) as error:
                    simulation.run(set={"j.bad.fault": fault.value})
                found.append(str(error.value))
    assert found[:5] == found[5:]


def test_isolate_takes_names_patterns_and_all(package: Path, server: CommandServer, tmp_path: Path) -> None:
    with pytest.raises(ec.CommandError, match=r"no component matches 'j\.bat'; did you mean j\.bad"):
        load(package).prepare(isolate=["j.bat"])
    file = tmp_path / "isolated.toml"
    file.write_text(f'system = "{package}"\nisolate = true\n')
    assert load(file).options.isolated == ["*"]
    for options in (["--isolate"], ["--isolate", "j.s*", "--no-plots"], ["--isolate=j.bad"]):
        arguments = [*of_the_line(package, Fault.NONE), *options]
        ended = server.call(Call(arguments, str(tmp_path), patience=60.0))
        assert ended.code == 0, ended.stderr
        assert len(record(tmp_path)["settings"]["isolate"]) == 1


@given(st.integers(0, 10_000), st.sampled_from(CALLS[1:]))
def test_a_code_says_which_slave_and_which_call(slave: int, call: str) -> None:
    present = black_box.Activity(code=code_of(slave, call), time=0.5)
    assert decode_call(present) == (slave, f"{call} at t = 0.5 s" if call == "doStep" else call)


def test_compiled_code_has_the_same_memory() -> None:
    fields = {name: getattr(black_box.Activity, name).offset for name, _ in black_box.Activity._fields_}
    assert {n: PRESENT.fields[n][1] for n in fields} == fields
    assert decode_call(black_box.Activity())[0] is None


def test_results_are_kept_although_a_copy_of_the_run_holds_the_lock(package: Path, tmp_path: Path) -> None:
    process = running(tmp_path, package, Fault.ORPHAN)
    assert process.wait(60.0) == 1
    assert record(tmp_path)["status"].endswith(
        "j.bad ended the process in doStep at t = 0.3 s (exit code 3)."
    )
    assert table(tmp_path).equals(whole(package)[:4])


def test_the_end_of_an_isolated_fmu_is_seen_although_a_copy_holds_its_streams(
    package: Path, tmp_path: Path
) -> None:
    with load(package, output_interval=0.1).prepare(isolate=["j.bad"]) as simulation:
        began = time.monotonic()
        with pytest.raises(ec.RunError, match=r"j\.bad ended its process in doStep .* \(exit code 3\)"):
            simulation.run(set={"j.bad.fault": Fault.ORPHAN.value})
        assert time.monotonic() - began < 30.0  # the copy ends after 40


def test_what_an_fmu_writes_to_the_streams_of_its_process_is_no_answer(package: Path) -> None:
    with load(package, output_interval=0.1).prepare(isolate=["j.bad"]) as simulation:
        with pytest.raises(ec.RunError, match="something else wrote to the stream") as found:
            simulation.run(set={"j.bad.fault": Fault.GARBLE.value})
        assert found.value.fields["result"].time[-1] == pytest.approx(0.3)
        assert simulation.run().to_polars().equals(whole(package))


def test_an_isolated_fmu_has_so_long_to_terminate(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emla_cosim.master.instances.isolated_instance._TIMEOUT", 0.5)
    with load(package).prepare(
        isolate=["j.bad"], set={"j.bad.fault": Fault.HANG_TERMINATE.value}
    ) as simulation:
        simulation.run()
        began = time.monotonic()
    assert time.monotonic() - began < 10.0


def test_an_isolated_fmu_whose_parent_is_gone_says_nothing(package: Path, tmp_path: Path) -> None:
    process = running(tmp_path, package, Fault.NONE, "--isolate", "--stop-time", 1000.0)
    wait_for(lambda: (tmp_path / "out/results.csv").exists())
    (child,) = psutil.Process(process.pid).children()
    child.kill()
    _, errors = process.communicate(timeout=60.0)
    assert "Traceback" not in errors
    assert "killed" in errors or "SIGKILL" in errors


def test_a_run_that_has_no_memory_left_keeps_what_it_has(package: Path) -> None:
    class Hungry(ec.Recorder):
        def pause(self, run: Any) -> None:
            if run.stepping.steps:
                raise MemoryError

    kept = ec.TimeSeries()
    with load(package, output_interval=0.1).prepare() as simulation:
        with pytest.raises(ec.RunError, match="there is not enough memory") as found:
            simulation.run(recorders=[Hungry(), kept])
        assert len(kept.rows) == found.value.fields["result"].steps + 1


ASKED = """
import os, signal, sys
from emla_cosim.views.output_folder import OutputFolder
write = OutputFolder.save
def interrupted(*arguments, **options):
    os.kill(os.getpid(), signal.SIGTERM)
    return write(*arguments, **options)
OutputFolder.save = interrupted
from emla_cosim.cli.program import main
main()
"""


def test_what_asks_for_the_end_after_the_last_step_waits_for_the_files(package: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", ASKED, "run", str(package), "--output", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    assert record(tmp_path)["status"] == "completed"
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"metrics.json", "run.json", "results.csv"}


@pytest.mark.parametrize("after", mostly_slow([0.2, 0.3, 0.5, 0.8, 1.1], [0.3, 0.8]))
def test_a_run_that_is_ended_while_it_starts_says_so(after: float, package: Path, tmp_path: Path) -> None:
    process = running(tmp_path, package, Fault.NONE)
    wait_for(lambda: any((tmp_path / "temporary").iterdir()) or process.poll() is not None)
    time.sleep(after - 0.2)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode in (0, 1)
    assert process.returncode == 0 or "nterrupted" in errors
    assert "Traceback" not in errors
    assert not any((tmp_path / "temporary").iterdir())


def test_many_signals_are_one_request(package: Path, tmp_path: Path) -> None:
    process = running(tmp_path, package, Fault.NONE, "--stop-time", 1e7)
    wait_for(lambda: has_rows(tmp_path / "out/results.csv"))
    while process.poll() is None:
        process.send_signal(signal.SIGTERM)
        time.sleep(0.01)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 1
    assert "Traceback" not in errors
    assert record(tmp_path)["status"].startswith("interrupted at t = ")


SERVER = """
import time
from pathlib import Path
from emla_cosim.sandbox.server import serve

serve(lambda request, send: (Path("going").touch(), time.sleep(600.0)))
"""

PARENT = """
import time
from emla_cosim.sandbox.server import Server

process = Server("never_answers")
process.send("anything")
time.sleep(600.0)
"""


@pytest.mark.skipif(os.name != "posix", reason="Windows does not have SIGKILL.")
def test_a_process_whose_call_never_returns_ends_with_its_parent(tmp_path: Path) -> None:
    (tmp_path / "never_answers.py").write_text(SERVER)
    (tmp_path / "parent.py").write_text(PARENT)
    parent = subprocess.Popen([sys.executable, "parent.py"], cwd=tmp_path)
    try:
        wait_for((tmp_path / "going").exists)
        children = psutil.Process(parent.pid).children()
    finally:
        parent.kill()
        parent.wait()
    assert children and not psutil.wait_procs(children, timeout=15)[1]
