"""The command where its streams, its memory or its end are not what one is used to."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.tiers import mostly_slow
from tests.support.waiting import has_rows, wait_for
from tests.support.whole_files import names

EMLA = [sys.executable, "-c", "from emla_cosim.cli.program import main; main()"]
RUN = ("run", "lift", "--no-plots", "--output", "out")
FULL = Path("/dev/full")


def surroundings(fmus: Path, folder: Path, **more: str) -> dict[str, str]:
    """An environment with temporary files in a folder of the test's."""
    (folder / "temporary").mkdir(exist_ok=True)
    return {**os.environ, "TMPDIR": str(folder / "temporary"), **more}


def ended(
    fmus: Path, folder: Path, *arguments: str, environment: dict[str, str] | None = None, **how: Any
) -> Any:
    """The command in a process of its own; its output is bytes."""
    return subprocess.run(
        [*EMLA, *arguments, "--fmus", str(fmus)],
        cwd=folder,
        env=surroundings(fmus, folder, **(environment or {})),
        check=False,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **how},
    )


ENCODINGS = ["ascii", "gbk", "shift_jis", "cp949", "latin-1", "utf-16"]


@pytest.mark.parametrize("encoding", mostly_slow(ENCODINGS, ["ascii", "utf-16"]))
def test_any_encoding_shows_the_table(encoding: str, fmu_folder: Path, tmp_path: Path) -> None:
    done = ended(
        fmu_folder, tmp_path, *RUN, "--stop-time", "0.35", environment={"PYTHONIOENCODING": encoding}
    )
    assert done.returncode == 0, done.stderr
    text = done.stdout.decode(encoding)
    assert "position error" in text
    assert "Wrote out/: results.csv" in text
    assert b"Traceback" not in done.stderr


@pytest.mark.skipif(
    not FULL.exists(), reason="There is no `/dev/full`, the device without space, on this machine."
)
def test_a_full_standard_output_is_told_and_the_files_are_there(fmu_folder: Path, tmp_path: Path) -> None:
    with FULL.open("wb") as full:
        done = ended(fmu_folder, tmp_path, *RUN, "--stop-time", "0.35", stdout=full)
        assert done.returncode == 1
        errors = [line for line in done.stderr.decode().splitlines() if line.startswith("Error")]
        assert errors == ["Error: the standard output cannot be written: No space left on device."]
        assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}
        quiet = ended(fmu_folder, tmp_path, *RUN, "--stop-time", "0.35", stderr=full)
        assert quiet.returncode == 0
        assert b"position error" in quiet.stdout


@pytest.mark.skipif(
    not FULL.exists(), reason="There is no `/dev/full`, the device without space, on this machine."
)
@pytest.mark.parametrize(
    "arguments", mostly_slow(["--help", "run --help", "list", "--version"], ["run --help", "list"])
)
def test_help_that_cannot_be_put_out_is_one_sentence(arguments: str) -> None:
    with FULL.open("wb") as full:
        done = subprocess.run([*EMLA, *arguments.split()], stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 1
    assert done.stderr == b"Error: the standard output cannot be written: No space left on device.\n"


def test_ctrl_c_while_a_command_is_imported_is_told() -> None:
    code = (
        "import emla_cosim.cli.app as c, signal as s\nc.import_module = lambda _: s.raise_signal(s.SIGINT)\n"
    )
    done = subprocess.run([sys.executable, "-c", code + EMLA[2], "list"], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (1, b"Interrupted.\n")


SIGNALS = ["SIGTERM", "SIGHUP", "SIGINT"]


@pytest.mark.parametrize("name", mostly_slow(SIGNALS, ["SIGTERM"]))
def test_what_is_done_cannot_be_ended_early(name: str) -> None:
    code = f"import atexit, signal; atexit.register(signal.raise_signal, signal.{name})\n{EMLA[2]}"
    done = subprocess.run([sys.executable, "-c", code, "list"], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


CLOSED = ["0<&-", "1>&-", "2>&-", "0<&- 1>&- 2>&-"]


@pytest.mark.parametrize("closed", mostly_slow(CLOSED, ["1>&-", "0<&- 1>&- 2>&-"]))
def test_closed_streams_harm_nobody(closed: str, fmu_folder: Path, tmp_path: Path) -> None:
    command = " ".join([f"exec '{sys.executable}' -c '{EMLA[2]}'", *RUN, "--stop-time 0.002", "--fmus", "$F"])
    environment = surroundings(fmu_folder, tmp_path, F=str(fmu_folder))
    done = subprocess.run(
        ["sh", "-c", f"{command} {closed}"], cwd=tmp_path, env=environment, check=False, capture_output=True
    )
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr
    assert (tmp_path / "out/run.json").exists()


@pytest.mark.parametrize("error", ["KeyboardInterrupt", "MemoryError", "ImportError('no such library')"])
def test_what_happens_while_importing_is_one_line(error: str, fmu_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken/typer.py").write_text(f"raise {error}\n")
    path = os.pathsep.join([str(tmp_path / "broken"), os.environ.get("PYTHONPATH", "")])
    done = ended(fmu_folder, tmp_path, "list", environment={"PYTHONPATH": path})
    assert done.returncode == 1
    assert len(done.stderr.decode().splitlines()) == 1
    assert done.stdout == b""


@pytest.mark.parametrize("name", mostly_slow(SIGNALS, ["SIGHUP"]))
@pytest.mark.parametrize("phase", ["preparing", "simulating"])
def test_a_polite_end_keeps_what_was_computed_and_tidies_up(
    name: str, phase: str, fmu_folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    arguments = [*RUN, "--stop-time", "100000", "--fmus", str(fmu_folder)]
    slowly = (
        "import emla_cosim.run.preparation as p, time\n"
        "original = p.build\n"
        "def build(*a, **k):\n"
        "    open('preparing', 'w').close(); time.sleep(20); return original(*a, **k)\n"
        "p.build = build\n"
    )
    code = (slowly if phase == "preparing" else "") + "from emla_cosim.cli.program import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=tmp_path,
        env=surroundings(fmu_folder, tmp_path),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        begun = (
            (tmp_path / "preparing").exists if phase == "preparing" else lambda: has_rows(out / "results.csv")
        )
        wait_for(begun)
        process.send_signal(signal.Signals[name])
        _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 1
    assert b"Traceback" not in errors
    assert not any((tmp_path / "temporary").iterdir())
    if phase == "simulating":
        assert b"interrupted at t = " in errors
        assert names(out) == {"results.csv", "metrics.json", "run.json"}
    else:
        assert b"Interrupted." in errors


@pytest.mark.parametrize("place", mostly_slow(["read-only", "a file", "missing"], ["a file"]))
def test_a_loop_that_cannot_be_kept_is_compiled_and_that_is_said_once(
    place: str, fmu_folder: Path, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    if place == "a file":
        cache.mkdir()
        (cache / "code").write_text("no folder")
    elif place == "read-only":
        (cache / "code").mkdir(parents=True)
        subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "none", cache / "code"], check=False)
    words = "The compiled loop could not be stored; the next run compiles it again: "
    try:
        done = ended(fmu_folder, tmp_path, *RUN, environment={"EMLA_COSIM_CACHE": str(cache)})
        text = done.stdout.decode()
        assert done.returncode == 0, done.stderr
        kept = any((cache / "code").glob("*.o"))
        assert text.count(words) == (0 if kept else 1)
        assert kept or place != "missing"
    finally:
        subprocess.run(["umount", cache / "code"], check=False, stderr=subprocess.DEVNULL)


@pytest.mark.parametrize("megabytes", mostly_slow([100, 300, 500, 700, 900, 1100], [300, 700]))
def test_too_little_memory_is_one_sentence(megabytes: int, fmu_folder: Path, tmp_path: Path) -> None:
    limit = f"--as={megabytes * 2**20}"
    command = ["prlimit", limit, *EMLA, *RUN, "--no-plots", "--fmus", str(fmu_folder)]
    try:
        done = subprocess.run(
            command,
            cwd=tmp_path,
            capture_output=True,
            check=False,
            env=surroundings(fmu_folder, tmp_path),
            timeout=120,
        )
    except subprocess.TimeoutExpired:
        pytest.skip("It did not end in 120 s: CPython can spin where it has no memory to raise an exception.")
    assert done.returncode in (0, 1, 2)
    assert b"Traceback (most" not in done.stderr
    # anywhere in a line: what ran out of memory may have been writing one
    assert done.stderr.count(b"Error: ") == (done.returncode > 0), done.stderr


@pytest.mark.parametrize("megabytes", mostly_slow([200, 250, 400, 900, 1100, 1500], [1100]))
def test_a_sweep_with_too_little_memory_is_one_sentence(
    megabytes: int, fmu_folder: Path, tmp_path: Path
) -> None:
    """Rust aborts and OpenBLAS complains where there is no memory; neither is seen."""
    sweep = ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", "--stop-time", "0.01", "--no-plots")
    command = ["prlimit", f"--as={megabytes * 2**20}", *EMLA, *sweep, "--output", "out", "--fmus", fmu_folder]
    environment = surroundings(fmu_folder, tmp_path)
    try:
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, check=False, env=environment, timeout=120
        )
    except subprocess.TimeoutExpired:
        pytest.skip("It did not end in 120 s: libraries can wait for threads that get no memory.")
    said = done.stderr.decode()
    assert done.returncode in (0, 1), said
    assert not any(
        word in said for word in ("Traceback", "panicked", "RUST", "OpenBLAS", "memory allocation")
    )
    assert said.count("Error: ") == done.returncode, said
    wait_for(lambda: not any((tmp_path / "temporary").iterdir()))  # the cluster ends after its command


FEW_FILES = [6, 7, 8]


@pytest.mark.parametrize("files", mostly_slow(FEW_FILES, [6, 7]))
def test_too_few_open_files_blame_no_file(files: int, fmu_folder: Path, tmp_path: Path) -> None:
    environment = surroundings(fmu_folder, tmp_path)
    command = [*EMLA, *RUN, "--stop-time", "0.002", "--fmus", str(fmu_folder)]
    whole = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False, env=environment)
    assert whole.returncode == 0, whole.stderr
    limited = ["sh", "-c", f'ulimit -n {files}; exec "$@"', "sh", *command]
    done = subprocess.run(limited, cwd=tmp_path, capture_output=True, check=False, env=environment)
    said = done.stderr.decode()
    assert done.returncode == 1, said
    assert said.count("Error: ") == 1 and "Too many open files" in said
    assert "not an FMU" not in said and "not written by emla" not in said


@pytest.mark.parametrize("end", ["os.abort()", "raise MemoryError", "os._exit(3)"])
def test_a_rescue_that_fails_too_is_one_sentence(end: str, tmp_path: Path) -> None:
    code = f"""
import os
from emla_cosim.sandbox.guard import run_supervised
def rescue(how):
    {end}
run_supervised(os.abort, rescue)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith(
        "Error: the run ended: SIGABRT. What it computed could not be saved: "
    )


def test_a_rescue_that_says_what_it_did_not_write_is_one_sentence(tmp_path: Path) -> None:
    """Standard output that takes nothing fails again when it is flushed."""
    code = """
import os, sys
from emla_cosim.sandbox.guard import run_supervised
def rescue(how):
    sys.stdout.write("what was computed")
    sys.stderr.write(f"Error: the run ended: {how}.")
run_supervised(os.abort, rescue)
"""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            env={**os.environ, "PYTHONUNBUFFERED": ""},
        )
    assert done.returncode == 1
    assert done.stderr == "Error: the run ended: SIGABRT."


def test_a_host_without_room_for_a_guard_runs_without_one(fmu_folder: Path, tmp_path: Path) -> None:
    without = (
        "import os\n"
        "def fork(): raise BlockingIOError(11, 'Resource temporarily unavailable')\n"
        "os.fork = fork\n"
        "from emla_cosim.cli.program import main; main()"
    )
    command = [sys.executable, "-c", without, *RUN, "--stop-time", "0.01", "--fmus", str(fmu_folder)]
    environment = surroundings(fmu_folder, tmp_path)
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert b"Wrote out/: results.csv" in done.stdout
    assert not any((tmp_path / "temporary").iterdir())


def test_a_guard_without_a_folder_of_its_own_removes_nobody_elses(fmu_folder: Path, tmp_path: Path) -> None:
    code = (
        "import os\n"
        "original = os.mkdir\n"
        "def mkdir(path, *more, **how):\n"
        "    if 'emla-run-' in str(path): raise OSError(28, 'No space left on device')\n"
        "    return original(path, *more, **how)\n"
        "os.mkdir = mkdir\n"
        "from emla_cosim.cli.program import main; main()"
    )
    environment = surroundings(fmu_folder, tmp_path)
    (tmp_path / "temporary" / "precious").write_text("mine")
    command = [sys.executable, "-c", code, *RUN, "--stop-time", "0.01", "--fmus", str(fmu_folder)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert [p.name for p in (tmp_path / "temporary").iterdir()] == ["precious"]
