"""The command with closed or full streams, any encoding, little memory, and signals at its start and end."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.tiers import mostly_slow
from tests.support.waiting import wait_for
from tests.support.whole_files import names

EMLA = "from emla_cosim.cli.program import main; main()"
RUN = ("run", "lift", "--no-plots", "--output", "out", "--stop-time")
FULL = Path("/dev/full")

needs_full_device = pytest.mark.skipif(not FULL.exists(), reason="There is no `/dev/full` on this machine.")


def call(folder: Path, *arguments: object, code: str = "", before: tuple[str, ...] = (), **how: Any) -> Any:
    """Call the command in a process; its output is bytes. `code` runs before it, in Python."""
    (folder / "temporary").mkdir(exist_ok=True)
    environment = {**os.environ, "TMPDIR": str(folder / "temporary"), **how.pop("environment", {})}
    return subprocess.run(
        [*before, sys.executable, "-c", code + EMLA, *map(str, arguments)],
        cwd=folder,
        env=environment,
        check=False,
        timeout=300,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **how},
    )


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "gbk", "latin-1", "utf-16"])
def test_tables_are_shown_in_any_encoding(encoding: str, fmu_folder: Path, tmp_path: Path) -> None:
    environment = {"PYTHONIOENCODING": encoding}
    done = call(tmp_path, *RUN, "0.35", "--fmus", fmu_folder, environment=environment)
    assert done.returncode == 0 and b"Traceback" not in done.stderr
    text = done.stdout.decode(encoding)
    assert "position error" in text and "Wrote out/: results.csv" in text


@needs_full_device
@pytest.mark.parametrize("arguments", mostly_slow(["list", "--help", "run --help", "run"], ["list"]))
def test_full_standard_output_is_reported(arguments: str, fmu_folder: Path, tmp_path: Path) -> None:
    more = (*RUN[1:], "0.01", "--fmus", fmu_folder) if arguments == "run" else ()
    with FULL.open("wb") as full:
        done = call(tmp_path, *arguments.split(), *more, stdout=full)
        assert done.returncode == 1
        message = b"Error: the standard output cannot be written: No space left on device.\n"
        assert done.stderr.endswith(message) and done.stderr.count(b"Error") == 1
        if more:
            assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}
            assert call(tmp_path, "run", *more, stderr=full).returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("closed", ["0<&-", "1>&-", "2>&-", "0<&- 1>&- 2>&-"])
def test_closed_streams(closed: str, fmu_folder: Path, tmp_path: Path) -> None:
    shell = ("sh", "-c", f'exec "$@" {closed}', "sh")
    done = call(tmp_path, *RUN, "0.002", "--fmus", fmu_folder, before=shell)
    assert done.returncode == 0 and b"Traceback" not in done.stderr
    assert (tmp_path / "out/run.json").exists()


IMPORT = "import emla_cosim.cli.app as c, signal as s; c.import_module = lambda _: s.raise_signal(s.SIGINT)\n"
EXIT = "import atexit, signal; atexit.register(signal.raise_signal, signal.SIGTERM)\n"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows does not have the signals of POSIX.")
@pytest.mark.parametrize(("code", "end"), [(IMPORT, (1, b"Interrupted.\n")), (EXIT, (0, b""))])
def test_signal_at_the_start_and_end_of_a_command(code: str, end: tuple[int, bytes], tmp_path: Path) -> None:
    done = call(tmp_path, "list", code=code)
    assert (done.returncode, done.stderr) == end


@pytest.mark.slow
@pytest.mark.parametrize("error", ["KeyboardInterrupt", "MemoryError", "ImportError('no such library')"])
def test_failed_import_is_one_line(error: str, tmp_path: Path) -> None:
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken/typer.py").write_text(f"raise {error}\n")
    path = os.pathsep.join([str(tmp_path / "broken"), os.environ.get("PYTHONPATH", "")])
    done = call(tmp_path, "list", environment={"PYTHONPATH": path})
    assert done.returncode == 1 and done.stdout == b""
    assert len(done.stderr.decode().splitlines()) == 1


SWEEP = ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", "--no-plots", "--output", "out")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="Only Linux has `prlimit`.")
@pytest.mark.parametrize(
    ("command", "megabytes"), [("run", 100), ("run", 700), ("sweep", 250), ("sweep", 1100)]
)
def test_too_little_memory_is_one_message(
    command: str, megabytes: int, fmu_folder: Path, tmp_path: Path
) -> None:
    """What libraries write about it, such as Rust and OpenBLAS, does not appear."""
    arguments = (*RUN, "0.01") if command == "run" else (*SWEEP, "--stop-time", "0.01")
    limit = ("prlimit", f"--as={megabytes * 2**20}")
    try:
        done = call(tmp_path, *arguments, "--fmus", fmu_folder, before=limit)
    except subprocess.TimeoutExpired:
        pytest.skip("Python and libraries can wait forever for memory.")
    errors = done.stderr.decode()
    assert done.returncode in (0, 1, 2)
    words = ("Traceback (most", "panicked", "RUST", "OpenBLAS", "memory allocation")
    assert command == "run" or not any(word in errors for word in words), errors
    assert "Traceback (most" not in errors
    # anywhere in a line: the command may run out of memory while it writes one
    assert errors.count("Error: ") == (done.returncode > 0), errors
    wait_for(lambda: not any((tmp_path / "temporary").iterdir()))  # a cluster ends after its command
