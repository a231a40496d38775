"""The command with closed or full streams, in any encoding, with little memory, and with early signals."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.processes import call
from tests.support.tiers import mostly_slow
from tests.support.waiting import wait_for
from tests.support.whole_files import names

RUN = ("run", "lift", "--no-plots", "--output", "out", "--stop-time")
FULL = Path("/dev/full")

needs_full_device = pytest.mark.skipif(not FULL.exists(), reason="There is no `/dev/full` on this machine.")


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "gbk", "latin-1", "utf-16"])
def test_tables_are_shown_in_any_encoding(encoding: str, fmu_folder: Path, tmp_path: Path) -> None:
    arguments = (*RUN, "0.35", "--fmus", fmu_folder)
    code, text, errors = call(
        tmp_path, *arguments, environment={"PYTHONIOENCODING": encoding}, encoding=encoding
    )
    assert code == 0 and "Traceback" not in errors
    assert "position error" in text and "Wrote out/: results.csv" in text


@needs_full_device
@pytest.mark.parametrize("arguments", mostly_slow(["list", "--help", "run --help", "run"], ["list"]))
def test_full_standard_output_is_reported(arguments: str, fmu_folder: Path, tmp_path: Path) -> None:
    more = (*RUN[1:], "0.01", "--fmus", fmu_folder) if arguments == "run" else ()
    with FULL.open("wb") as full:
        code, _, errors = call(tmp_path, *arguments.split(), *more, stdout=full)
        assert code == 1
        message = "Error: the standard output cannot be written: No space left on device.\n"
        assert errors.endswith(message) and errors.count("Error") == 1
        if more:
            assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}
            assert call(tmp_path, "run", *more, stderr=full)[0] == 0


@pytest.mark.slow
@pytest.mark.parametrize("closed", ["0<&-", "1>&-", "2>&-", "0<&- 1>&- 2>&-"])
def test_closed_streams(closed: str, fmu_folder: Path, tmp_path: Path) -> None:
    shell = ("sh", "-c", f'exec "$@" {closed}', "sh")
    code, _, errors = call(tmp_path, *RUN, "0.002", "--fmus", fmu_folder, before=shell)
    assert code == 0 and "Traceback" not in errors
    assert (tmp_path / "out/run.json").exists()


IMPORT = "import emla_cosim.cli.app as c, signal as s; c.import_module = lambda _: s.raise_signal(s.SIGINT)\n"
EXIT = "import atexit, signal; atexit.register(signal.raise_signal, signal.SIGTERM)\n"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows does not have the signals of POSIX.")
@pytest.mark.parametrize(("code", "end"), [(IMPORT, (1, "Interrupted.\n")), (EXIT, (0, ""))])
def test_signal_at_the_start_and_end_of_a_command(code: str, end: tuple[int, str], tmp_path: Path) -> None:
    ended, _, errors = call(tmp_path, "list", code=code)
    assert (ended, errors) == end


@pytest.mark.slow
@pytest.mark.parametrize("error", ["KeyboardInterrupt", "MemoryError", "ImportError('no such library')"])
def test_failed_import_is_one_line(error: str, tmp_path: Path) -> None:
    (tmp_path / "broken/click").mkdir(parents=True)
    (tmp_path / "broken/click/__init__.py").write_text(f"raise {error}\n")
    path = os.pathsep.join([str(tmp_path / "broken"), os.environ.get("PYTHONPATH", "")])
    code, output, errors = call(tmp_path, "list", environment={"PYTHONPATH": path})
    assert code == 1 and output == "" and len(errors.splitlines()) == 1


SWEEP = ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", *RUN[2:])


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="Only Linux has `prlimit`.")
@pytest.mark.parametrize(("command", "megabytes"), [(RUN, 100), (RUN, 700), (SWEEP, 250), (SWEEP, 1100)])
def test_too_little_memory_is_one_message(
    command: tuple[str, ...], megabytes: int, fmu_folder: Path, tmp_path: Path
) -> None:
    """What libraries write about it, such as Rust and OpenBLAS, does not appear."""
    limit = ("prlimit", f"--as={megabytes * 2**20}")
    try:
        code, _, errors = call(tmp_path, *command, "0.01", "--fmus", fmu_folder, before=limit)
    except subprocess.TimeoutExpired:
        pytest.skip("Python and libraries can wait forever for memory.")
    assert code in (0, 1, 2) and "Traceback (most" not in errors
    words = ("panicked", "RUST", "OpenBLAS", "memory allocation")
    assert command is RUN or not any(word in errors for word in words), errors
    # anywhere in a line: the command may run out of memory while it writes one
    assert errors.count("Error: ") == (code > 0), errors
    wait_for(lambda: not any((tmp_path / "temporary").iterdir()))  # a cluster ends after its command
