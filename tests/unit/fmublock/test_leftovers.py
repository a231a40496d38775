"""Files and folders of killed processes are removed by the next process, and no others."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import pytest

from fmublock import files
from fmublock.files import (
    UNFINISHED,
    make_temporary_folder,
    mark_of_process,
    remove_folder,
    remove_leftovers,
    write_atomically,
)

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="The system has no `/proc`.")

PRINT_MARK = "from fmublock.files import mark_of_process; print(mark_of_process())"


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture(scope="module")
def dead() -> str:
    """The mark of a process that has ended."""
    return subprocess.run(
        [sys.executable, "-c", PRINT_MARK], capture_output=True, text=True, check=True
    ).stdout.strip()


def test_folders_of_ended_processes_are_removed(temporary: Path, dead: str) -> None:
    own_folder = make_temporary_folder("run")
    abandoned = temporary / f"emla-run-{dead}-abcdefgh"
    abandoned.mkdir(mode=0o700)
    (abandoned / "inside").mkdir()
    (abandoned / "inside" / "a").write_text("left")
    remove_leftovers()
    assert list(temporary.iterdir()) == [own_folder]


def test_processes_with_one_id_differ_in_their_start(temporary: Path) -> None:
    process, start, host = mark_of_process().split("-")
    assert int(start) == round(
        (psutil.Process().create_time() - psutil.boot_time()) * os.sysconf("SC_CLK_TCK")
    )
    earlier = temporary / f"emla-run-{process}-{int(start) - 1}-{host}-abcdefgh"
    earlier.mkdir(mode=0o700)
    remove_leftovers()
    assert not earlier.exists()


def test_files_of_other_owners_stay(temporary: Path, dead: str, monkeypatch: pytest.MonkeyPatch) -> None:
    process, start, _ = dead.split("-")
    outside = temporary / "outside"
    for path in (
        temporary / f"emla-run-{process}-{start}-{'0' * 8}-abcdefgh",  # of another machine or container
        temporary / f"emla-thesis-of-mine-{dead}-abcdefgl",
        outside,
    ):
        path.mkdir(mode=0o700)
    shared = temporary / f"emla-run-{dead}-abcdefgi"
    shared.mkdir()
    shared.chmod(0o777)
    (temporary / f"emla-run-{dead}-abcdefgj").write_text("a file")
    (temporary / f"emla-run-{dead}-abcdefgk").symlink_to(outside)
    before = set(temporary.iterdir())
    remove_leftovers()
    assert set(temporary.iterdir()) == before
    leftover = temporary / f"emla-run-{dead}-abcdefgm"
    leftover.mkdir(mode=0o700)
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)  # as if another user looked at it
    remove_leftovers()
    assert leftover.exists()


def test_links_in_a_folder_are_removed_and_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "thesis").write_text("years of work")
    for rmtree in (files.shutil.rmtree, lambda *arguments, **how: None):  # as with too few open files
        monkeypatch.setattr(files.shutil, "rmtree", rmtree)
        folder = tmp_path / "folder"
        (folder / "a/b").mkdir(parents=True)
        (folder / "a/b/file").touch()
        (folder / "a/link").symlink_to(outside)
        remove_folder(folder)
        assert not folder.exists()
        assert (outside / "thesis").exists()


def test_incomplete_files_of_ended_processes_are_removed(tmp_path: Path, dead: str) -> None:
    leftover = tmp_path / f"{UNFINISHED}{dead}-abcdefgh"
    living = tmp_path / f"{UNFINISHED}{mark_of_process()}-abcdefgh"
    foreign = tmp_path / f"{UNFINISHED}thesis"
    for path in (leftover, living, foreign):
        path.write_text("half")
    with write_atomically(tmp_path / "new") as stream:
        stream.write(b"whole")
    assert {p.name for p in tmp_path.iterdir()} == {"new", living.name, foreign.name}


@pytest.mark.slow
def test_compiler_ends_with_the_process_that_needs_it(tmp_path: Path) -> None:
    """Also what the compiler itself has started."""
    slow = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(60)'])"
    code = (
        "import os, subprocess, sys\n"
        "subprocess.Popen([sys.executable, '-m', 'fmublock.compiling', str(os.getpid()),"
        f" sys.executable, '-c', {slow!r}], process_group=0).wait()"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as process:
        parent, family = psutil.Process(process.pid), list[psutil.Process]()
        until = time.monotonic() + 30.0
        while len(family) < 3 and time.monotonic() < until:
            family = parent.children(recursive=True)
            time.sleep(0.05)
        assert len(family) == 3
        process.send_signal(signal.SIGKILL)
    assert not psutil.wait_procs(family, timeout=10.0)[1]
