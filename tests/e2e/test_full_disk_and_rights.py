"""A disk that is full or fails, no rights, no home: one error message, and whole files only.

Root may write everywhere. So tests of rights need root, and take away the rights that ignore permissions.
"""

import errno
import os
import pickle
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import pytest

import fmublock.cache as cache
import fmublock.files
from emla_cosim.base.errors import CommandError, CosimError, RunError, find_exit_code
from emla_cosim.sandbox.locking import exclusive_lock
from fmublock.files import write_atomically
from fmublock.platforms import host_platform
from tests.support.commands import Emla, sentence
from tests.support.full_disk import files_of_at_most
from tests.support.tiers import mostly_slow
from tests.support.whole_files import assert_whole, names

SHORT = ("--stop-time", "0.002")
RUN = ("run", "lift", *SHORT, "--no-plots", "--output", "out")
MINE = "years of work\n"

# ---- a full disk -------------------------------------------------------------------------------

COMMANDS: dict[str, tuple[str, ...]] = {
    "run": RUN,
    "plots": (*RUN[:-3], *RUN[-2:]),
    "report": (*RUN, "--report"),
    "parquet": (*RUN, "--output-format", "parquet"),
    "checkpoint": (*RUN, "--checkpoint", "c"),
    "rerun": ("rerun", "before.json", "--no-plots", "--output", "out"),
    "export": ("export", "lift", "x.ssp"),
    "info": ("info", "lift", "--json", "i.json"),
    "build": ("build", "Reference", "--platform", host_platform(), "--output", "built"),
    "trajectory": ("trajectory", "--knots", "10", "--points", "5", "--output", "t.json"),
    "verify": ("verify", "Reference.fmu", "--only", "archive.*", "--json", "v.json", "--html", "v.html"),
    "sweep": ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", *SHORT, "--output", "out"),
}


CALLS = ("write", "fsync", "chmod", "replace")


def fail(*_: Any) -> Any:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def break_call(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let one call of `write_atomically` fail."""
    if call == "write":
        opened = os.fdopen

        def open_full(handle: int, mode: str) -> BinaryIO:
            os.close(handle)
            return opened(os.open("/dev/full", os.O_WRONLY), mode)

        monkeypatch.setattr(fmublock.files.os, "fdopen", open_full)
    elif call == "fsync":
        monkeypatch.setattr(fmublock.files.os, "fsync", fail)
    else:
        monkeypatch.setattr(Path, call, fail)
        monkeypatch.setattr(Path, "hardlink_to", fail)


@pytest.mark.parametrize("call", CALLS)
def test_failing_call_leaves_the_earlier_file(
    call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "f"
    path.write_bytes(b"before")
    path.chmod(0o640)
    with monkeypatch.context() as patch:
        break_call(call, patch)
        with pytest.raises(OSError, match="No space left on device"), write_atomically(path) as stream:
            stream.write(b"after")
    assert path.read_bytes() == b"before"
    with pytest.raises(KeyError), write_atomically(path) as stream:
        stream.write(b"half")
        raise KeyError
    assert path.read_bytes() == b"before"
    with write_atomically(path) as stream:
        stream.write(b"after")
        stream.flush()
        assert path.read_bytes() == b"before"
    assert path.read_bytes() == b"after"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert [p.name for p in tmp_path.iterdir()] == ["f"]


@pytest.mark.usefixtures("on_one_cluster")
@pytest.mark.parametrize(
    ("command", "call"),
    mostly_slow(
        [*zip(COMMANDS, ("write", "fsync") * len(COMMANDS), strict=False), ("checkpoint", "fsync")],
        [("run", "write"), ("checkpoint", "write"), ("export", "write"), ("info", "fsync")],
    ),
)
def test_full_disk_is_one_error_message(
    command: str, call: str, emla: Emla, tmp_path: Path, fmu_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What an earlier command wrote stays, or is replaced whole; the command can be repeated."""
    shutil.copy(fmu_folder / "Reference/Reference.fmu", "Reference.fmu")
    if command == "rerun":
        assert emla(*RUN).exit_code == 0
        shutil.copy("out/run.json", "before.json")
    if command == "build":
        monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    else:
        assert emla(*COMMANDS[command]).exit_code == 0
    (tmp_path / "thesis.txt").write_text(MINE)
    single = [p for p in tmp_path.iterdir() if p.is_file()]
    before = {p: p.read_bytes() for p in single}
    with monkeypatch.context() as patch:
        break_call(call, patch)
        assert "No space left on device" in sentence(emla(*COMMANDS[command]), 1)
    shutil.rmtree(tmp_path / "cache", ignore_errors=True)
    (tmp_path / "thesis.txt").unlink()
    assert_whole(tmp_path)
    assert {p: p.read_bytes() for p in single if p.exists()} == {p: before[p] for p in single if p.exists()}
    assert emla(*COMMANDS[command]).exit_code == 0


def test_folder_is_locked_on_a_full_disk(tmp_path: Path) -> None:
    refused = pytest.raises(CommandError, match=r"another run writes to '[^']*'. Wait for it")
    with files_of_at_most(1), exclusive_lock(tmp_path), refused, exclusive_lock(tmp_path):
        pass
    assert not any(tmp_path.iterdir())


def chain(error: CosimError, *causes: Exception) -> CosimError:
    """An error with these causes, the outermost first."""
    last: BaseException = error
    for cause in causes:
        last.__cause__ = cause
        last = cause
    return error


FULL, MISSING = OSError(errno.ENOSPC, "full"), FileNotFoundError(errno.ENOENT, "missing")


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda: CommandError("x"), 2),
        (lambda: RunError("x"), 1),
        (lambda: chain(CommandError("x"), MISSING), 2),
        (lambda: chain(CommandError("x"), FULL), 1),
        (lambda: chain(CommandError("x"), CommandError("y"), FULL), 1),
    ],
)
def test_fault_of_the_machine_is_exit_code_1(make: Callable[[], CosimError], code: int) -> None:
    assert find_exit_code(make()) == code
    assert find_exit_code(pickle.loads(pickle.dumps(make()))) == code  # from another process


# ---- no rights ---------------------------------------------------------------------------------

ANOTHER = 65534
RIGHTS = "--bounding-set=-dac_override,-dac_read_search,-fowner"

needs_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0 or shutil.which("setpriv") is None,
    reason="Files of another user need root, and setpriv takes its rights.",
)


def emla_without_rights(*arguments: str, folder: Path) -> tuple[int, str]:
    """Run a command; return the exit code and the error message."""
    done = subprocess.run(
        ["setpriv", RIGHTS, sys.executable, "-m", "emla_cosim", *arguments],
        cwd=folder, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    if "setpriv:" in done.stderr:
        pytest.skip("Rights cannot be taken here.")
    assert "Traceback" not in done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("Error:")]
    assert len(errors) == (done.returncode != 0), done.stderr
    return done.returncode, "".join(errors)


@needs_root
@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "reason"), [(0o555, "Permission denied"), (0o1777, "Operation not permitted")]
)
def test_results_of_another_user_stay(mode: int, reason: str, emla: Emla, tmp_path: Path) -> None:
    assert emla(*RUN[:-1], "theirs/out").exit_code == 0
    assert emla("export", "lift", "theirs/x.ssp").exit_code == 0
    theirs = tmp_path / "theirs"
    for path in (theirs, *theirs.rglob("*")):
        os.chown(path, ANOTHER, ANOTHER)
    for folder in (theirs, theirs / "out"):
        folder.chmod(mode)
    before = {p: p.read_bytes() for p in theirs.rglob("*") if p.is_file()}
    for arguments in ((*RUN[:-1], "theirs/out"), ("export", "lift", "theirs/x.ssp")):
        code, message = emla_without_rights(*arguments, folder=tmp_path)
        assert code in (1, 2) and reason in message
        assert {p: p.read_bytes() for p in theirs.rglob("*") if p.is_file()} == before


@needs_root
@pytest.mark.slow
def test_unreadable_file_is_not_replaced(emla: Emla, tmp_path: Path) -> None:
    """Nobody can see whether an earlier command wrote it."""
    assert emla(*RUN).exit_code == 0
    file = tmp_path / "out/run.json"
    before = file.read_bytes()
    os.chown(file, ANOTHER, ANOTHER)
    file.chmod(0o600)
    code, message = emla_without_rights(*RUN, folder=tmp_path)
    assert code == 2 and "'out/run.json' was" in message
    assert file.read_bytes() == before


# ---- no home, no cache, few open files ---------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not use HOME.")
@pytest.mark.parametrize("home", [None, ""])
def test_commands_need_no_home(
    home: str | None, emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("HOME") if home is None else monkeypatch.setenv("HOME", home)
    for command in (RUN, COMMANDS["export"], COMMANDS["info"], ("list",)):
        assert emla(*command).exit_code == 0
    assert names(tmp_path) == {"out", "x.ssp", "i.json"}
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    cache._home_cache.cache_clear()
    try:  # zig cannot do without a folder for its cache
        folders = cache.tool_environment()
    finally:
        cache._home_cache.cache_clear()
    assert folders["ZIG_GLOBAL_CACHE_DIR"] == folders["ZIG_LOCAL_CACHE_DIR"] == str(tmp_path / "cache/zig")


@pytest.mark.slow
def test_unusable_cache_is_reported_once(fmu_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache/code").write_text("not a folder")
    command = [sys.executable, "-m", "emla_cosim", *RUN, "--fmus", str(fmu_folder)]
    environment = {**os.environ, cache.VARIABLE: str(tmp_path / "cache")}
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment, timeout=500
    )
    assert done.returncode == 0
    message = "The compiled loop could not be stored; the next run compiles it again: "
    assert done.stdout.count(message) == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limit.")
@pytest.mark.parametrize("files", [5, 6, 7, 8])
def test_too_few_open_files_are_reported(files: int, fmu_folder: Path, tmp_path: Path) -> None:
    """No file is called damaged because it could not be opened."""
    (tmp_path / "temporary").mkdir()
    command = [sys.executable, "-m", "emla_cosim", *RUN, "--fmus", str(fmu_folder)]
    limited = ["sh", "-c", f'ulimit -n {files}; exec "$@"', "sh", *command]
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    done = subprocess.run(
        limited, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment, timeout=300
    )
    assert done.returncode in (0, 1), done.stderr
    assert done.stderr.count("Error: ") == done.returncode and "Traceback" not in done.stderr
    assert done.returncode == 0 or "Too many open files" in done.stderr
    assert "not an FMU" not in done.stderr and "not written by emla" not in done.stderr
    assert not list((tmp_path / "temporary").iterdir())
