"""A disk that is full or fails, no rights, no home: one error message, and whole files only.

Root may write everywhere. So tests of rights need root, and take away the rights that ignore permissions.
"""

import errno
import os
import pickle
import shutil
import stat
import sys
from pathlib import Path
from typing import Any, BinaryIO

import pytest

import fmublock.cache as cache
import fmublock.files
from emla_cosim.base.errors import CommandError, find_exit_code
from emla_cosim.base.folder_lock import exclusive_lock
from fmublock.files import write_atomically
from fmublock.platforms import host_platform
from tests.support.commands import Emla, sentence
from tests.support.full_disk import files_of_at_most
from tests.support.prebuilt import without_prebuilt
from tests.support.processes import call
from tests.support.tiers import mostly_slow
from tests.support.whole_files import assert_whole, names

STOP_TIME = ("--stop-time", "0.002")
RUN = ("run", "lift", *STOP_TIME, "--no-plots", "--output", "out")
USER_TEXT = "years of work\n"

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
    "sweep": ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", *STOP_TIME, "--output", "out"),
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
    (tmp_path / "thesis.txt").write_text(USER_TEXT)
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


def test_table_is_kept_as_far_as_the_disk_has_room(emla: Emla, tmp_path: Path) -> None:
    with files_of_at_most(200_000):
        message = sentence(emla("run", "lift", "--stop-time", "2", "--no-plots", "--output", "out"), 1)
    assert "results.csv cannot be written: File too large" in message
    assert 100_000 < (tmp_path / "out/results.csv").stat().st_size <= 200_000
    assert_whole(tmp_path / "out")
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}


def test_full_disk_of_another_process_is_exit_code_1() -> None:
    """Also as the cause of a cause, which pickle does not keep by itself."""
    error, missing = CommandError("x"), CommandError("x")
    error.__cause__ = CommandError("y")
    error.__cause__.__cause__ = OSError(errno.ENOSPC, "full")
    missing.__cause__ = FileNotFoundError(errno.ENOENT, "missing")
    assert [find_exit_code(pickle.loads(pickle.dumps(e))) for e in (error, missing)] == [1, 2]


# ---- no rights ---------------------------------------------------------------------------------

ANOTHER = 65534
RIGHTS = "--bounding-set=-dac_override,-dac_read_search,-fowner"

needs_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0 or shutil.which("setpriv") is None,
    reason="Files of another user need root, and setpriv takes its rights.",
)


def emla_without_rights(*arguments: str, folder: Path) -> tuple[int, str]:
    """Run a command; return the exit code and the error message."""
    code, _, errors = call(folder, *arguments, before=("setpriv", RIGHTS))
    if "setpriv:" in errors:
        pytest.skip("Rights cannot be taken here.")
    assert "Traceback" not in errors
    messages = [line for line in errors.splitlines() if line.startswith("Error:")]
    assert len(messages) == (code != 0), errors
    return code, "".join(messages)


@needs_root
@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "reason"), [(0o555, "Permission denied"), (0o1777, "Operation not permitted")]
)
def test_results_of_another_user_stay(mode: int, reason: str, emla: Emla, tmp_path: Path) -> None:
    assert emla(*RUN[:-1], "theirs/out").exit_code == 0
    assert emla("export", "lift", "theirs/x.ssp").exit_code == 0
    folder_of_other = tmp_path / "theirs"
    for path in (folder_of_other, *folder_of_other.rglob("*")):
        os.chown(path, ANOTHER, ANOTHER)
    for folder in (folder_of_other, folder_of_other / "out"):
        folder.chmod(mode)
    before = {p: p.read_bytes() for p in folder_of_other.rglob("*") if p.is_file()}
    for arguments in ((*RUN[:-1], "theirs/out"), ("export", "lift", "theirs/x.ssp")):
        code, message = emla_without_rights(*arguments, folder=tmp_path)
        assert code in (1, 2) and reason in message
        assert {p: p.read_bytes() for p in folder_of_other.rglob("*") if p.is_file()} == before


@needs_root
@pytest.mark.slow
def test_unreadable_file_is_not_replaced(emla: Emla, tmp_path: Path) -> None:
    """The command cannot see who wrote it."""
    assert emla(*RUN).exit_code == 0
    file = tmp_path / "out/run.json"
    before = file.read_bytes()
    os.chown(file, ANOTHER, ANOTHER)
    file.chmod(0o600)
    code, message = emla_without_rights(*RUN, folder=tmp_path)
    assert code == 2 and "the output folder 'out' cannot be read: Permission denied" in message
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
    cache._find_home_cache.cache_clear()
    try:  # zig cannot do without a folder for its cache
        folders = cache.tool_environment()
    finally:
        cache._find_home_cache.cache_clear()
    assert folders["ZIG_GLOBAL_CACHE_DIR"] == folders["ZIG_LOCAL_CACHE_DIR"] == str(tmp_path / "cache/zig")


@pytest.mark.slow
def test_unusable_cache_is_reported_once(fmu_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache/code").write_text("not a folder")
    environment = {cache.VARIABLE: str(tmp_path / "cache"), **without_prebuilt(tmp_path / "site")}
    code, output, _ = call(tmp_path, *RUN, "--fmus", fmu_folder, environment=environment)
    assert code == 0
    assert output.count("The stepper in C could not be stored; the next run compiles it again: ") == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limit.")
@pytest.mark.parametrize("files", [8, 9, 10])  # with fewer, libraries fail first
def test_too_few_open_files_are_reported(files: int, fmu_folder: Path, tmp_path: Path) -> None:
    """No file is called damaged because it could not be opened."""
    limit = ("sh", "-c", f'ulimit -n {files}; exec "$@"', "sh")
    code, _, errors = call(tmp_path, *RUN, "--fmus", fmu_folder, before=limit)
    assert code in (0, 1) and errors.count("Error: ") == code and "Traceback" not in errors, errors
    assert code == 0 or "Too many open files" in errors
    assert "not an FMU" not in errors and "not written by emla" not in errors
    assert not list((tmp_path / "temporary").iterdir())
