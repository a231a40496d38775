"""What may be replaced: a table of what is in the way of a file or in an output folder, and what happens."""

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.folder_lock import exclusive_lock
from emla_cosim.base.output_files import RECORDS, OutputFile, has_format
from emla_cosim.views.folder import Folder
from emla_cosim.views.output_folder import OutputFolder

USER_CONTENT, OURS, NEW = b"years of work", b'{"format": "emla-test"}', b"new"
RUN = b'{"scenario": "lift", "status": "unfinished"}'

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such files.")


def link(target: str) -> Callable[[Path], None]:
    return lambda path: path.symlink_to(path.parent.parent / "outside" / target)


def bind_socket(path: Path) -> None:
    before = Path.cwd()
    os.chdir(path.parent)  # names of sockets are short
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path.name)
    finally:
        os.chdir(before)


def write(content: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content)


NEVER: dict[str, Callable[[Path], object]] = {
    "link to a file": link("mine"),
    "link to a file of ours": link("ours"),
    "link to nothing": link("gone"),
    "link to a folder": link(""),
    "link to itself": lambda path: path.symlink_to(path.name),
    "link to a device": lambda path: path.symlink_to("/dev/null"),
    "folder": lambda path: path.mkdir(),
    "pipe": lambda path: os.mkfifo(path),
    "socket": bind_socket,
}
"""What is never replaced, by its name."""

FILES: dict[str, Callable[[Path], object]] = {
    "nothing": lambda path: None,
    "empty file": write(b""),
    "file of ours": write(OURS),
    "file of the user": write(USER_CONTENT),
    "large file": write(USER_CONTENT * 100_000),
    "file of another format": write(b'{"format": "emla"}'),
}
"""What may be replaced, also only with --overwrite."""

NAMES = ["-o", "a\nb\tc\x1b[31m", "trailing ", "'\"", "\N{GRINNING FACE}" * 63, "x" * 255, "\udcff"]


def states(folder: Path) -> dict[str, object]:
    """What everything in a folder is, without reading pipes and devices."""
    return {
        str(path.relative_to(folder)): (os.lstat(path).st_mode, path.read_bytes())
        if path.is_file() and not path.is_symlink()
        else (os.lstat(path).st_mode, str(path.readlink()) if path.is_symlink() else "")
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture
def folder_path(tmp_path: Path) -> Path:
    """A folder beside another one with files."""
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside/mine").write_bytes(USER_CONTENT)
    (tmp_path / "outside/ours").write_bytes(OURS)
    (tmp_path / "folder").mkdir()
    return tmp_path / "folder"


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("kind", [*NEVER, *FILES])
def test_which_single_files_are_replaced(kind: str, overwrite: bool, folder_path: Path) -> None:
    path = folder_path / "out.json"
    (NEVER | FILES)[kind](path)
    before = states(folder_path.parent)
    if kind in NEVER or not (overwrite or kind in ("nothing", "empty file", "file of ours")):
        words = "cannot be written: it is a" if kind in NEVER else "was not written by emla.*--overwrite"
        with pytest.raises(CommandError, match=words):
            OutputFile(path, "the file", has_format("emla-test"), overwrite)
        assert states(folder_path.parent) == before
        return
    OutputFile(path, "the file", has_format("emla-test"), overwrite).write(NEW)
    assert path.read_bytes() == NEW
    assert [p.name for p in folder_path.iterdir()] == ["out.json"]


@pytest.mark.parametrize("name", NAMES)
def test_names_of_single_files(name: str, folder_path: Path) -> None:
    for content in (b"1", b"2"):
        OutputFile(folder_path / name, "the file", lambda path: path.read_bytes() == b"1").write(content)
    with pytest.raises(CommandError, match="was not written by emla"):
        OutputFile(folder_path / name, "the file", lambda _: False)
    assert [p.name for p in folder_path.iterdir()] == [name]


class RunFolder(Folder):
    """A folder for three files."""

    subject, record_file, files, pictures = "results", "run.json", ("run.json", "a.csv"), ("a.png",)


HOLDERS: dict[str, dict[str, bytes]] = {
    "new": {},
    "empty": {},
    "empty files": {"run.json": b"", "a.csv": b""},
    "hidden": {".emla.json": b"{}", ".unfinished-abcdefgh": b"", ".DS_Store": b"x"},
    "ours": {"run.json": RUN, "thesis.txt": USER_CONTENT},
    "ours, changed by hand": {"run.json": RUN, "a.csv": USER_CONTENT},
    "of another command": {"size.json": b'{"format": "emla-sizing"}'},
    "of another command, with files of these names": {
        "size.json": b'{"format": "emla-sizing"}',
        "a.csv": USER_CONTENT,
    },
    "of the user": {"thesis.txt": USER_CONTENT},
    "with a file of these names": {"a.csv": USER_CONTENT},
    "with a picture of these names": {"a.png": USER_CONTENT},
    "with a record that is not ours": {"run.json": b'{"scenario": 1}'},
    "with a damaged record": {"run.json": RUN[:-1]},
    "with a record of another name": {"mine.json": RUN},
}
"""Contents of folders."""

ALLOWED = list(HOLDERS)[:7]


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("kind", HOLDERS)
def test_which_folders_are_written(kind: str, overwrite: bool, folder_path: Path) -> None:
    for name, content in HOLDERS[kind].items():
        (folder_path / name).write_bytes(content)
    if kind == "new":
        folder_path.rmdir()
    before = states(folder_path.parent)
    if not (overwrite or kind in ALLOWED):
        with pytest.raises(CommandError, match=r"has '.*', which was not written by emla.*--overwrite"):
            RunFolder(folder_path)
        assert states(folder_path.parent) == before
        return
    folder = RunFolder(folder_path, overwrite)
    with folder.reserve():
        folder.write("run.json", RUN)
        folder.write("a.csv", NEW)
    assert (folder_path / "a.csv").read_bytes() == NEW
    ours = {"run.json", "a.csv", ".unfinished-abcdefgh"}
    after = states(folder_path)
    assert all(after[name] == before[f"folder/{name}"] for name in HOLDERS[kind].keys() - ours)


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("name", ["run.json", "a.csv", "a.png"])
@pytest.mark.parametrize("kind", NEVER)
def test_special_files_in_a_folder(kind: str, name: str, overwrite: bool, folder_path: Path) -> None:
    if name != "run.json":
        (folder_path / "run.json").write_bytes(RUN)
    NEVER[kind](folder_path / name)
    before = states(folder_path.parent)
    with pytest.raises(CommandError, match="cannot be written: it is a"):
        RunFolder(folder_path, overwrite)
    assert states(folder_path.parent) == before


@pytest.mark.parametrize(
    "kind", ["file", "link to a file", "link to nothing", "link to itself", "pipe", "socket"]
)
def test_output_folder_that_is_not_a_folder(kind: str, folder_path: Path) -> None:
    ({"file": write(USER_CONTENT)} | NEVER)[kind](folder_path / "out")
    before = states(folder_path.parent)
    for folder in (RunFolder, OutputFolder):
        with pytest.raises(CommandError, match=r"the output folder '.*' cannot be written: (it is|Sym)"):
            folder(folder_path / "out", overwrite=True)
    assert states(folder_path.parent) == before


@pytest.mark.parametrize("name", NAMES)
def test_names_of_folders(name: str, folder_path: Path) -> None:
    for _ in range(2):
        folder = RunFolder(folder_path / name)
        with (
            folder.reserve(),
            pytest.raises(CommandError, match="another run writes to"),
            exclusive_lock(folder_path / name),
        ):
            pass
        with folder.reserve():
            folder.write("run.json", RUN)
    assert [p.name for p in folder_path.rglob("*")] == [name, "run.json"]


@pytest.mark.parametrize("name", [".running", ".running.json"])
@pytest.mark.parametrize("kind", [*NEVER, "file of the user"])
def test_lock_replaces_no_file(kind: str, name: str, folder_path: Path) -> None:
    (NEVER | FILES)[kind](folder_path / name)
    before = states(folder_path.parent)
    with pytest.raises(CommandError, match=name), RunFolder(folder_path, overwrite=True).reserve():
        pass
    assert states(folder_path.parent) == before


def test_files_that_appear_later_stay(folder_path: Path) -> None:
    folder, file = RunFolder(folder_path), OutputFile(folder_path / "single", "the file", lambda _: False)
    for name in ("run.json", "single"):
        (folder_path / name).write_bytes(USER_CONTENT)
    for writer in (lambda: folder.write("run.json", RUN), lambda: file.write(NEW)):
        with pytest.raises(Exception, match="appeared while emla ran, and emla did not write it"):
            writer()
    folder.remove(["run.json"])
    content = {path.name: path.read_bytes() for path in folder_path.iterdir()}
    assert content == {"run.json": USER_CONTENT, "single": USER_CONTENT}


def test_every_record_is_recognized_as_earlier_versions_wrote_it(tmp_path: Path) -> None:
    written: dict[str, object] = {
        "run.json": {"scenario": "lift", "status": "completed"},
        "sweep.json": {"identity": {}, "status": "completed"},
        "comparison.json": {"entrants": [], "runs": []},
        "tune.json": {"plan": {}, "best": {}, "runs": 3},
        "identify.json": {"format": "emla-identification"},
        "size.json": {"format": "emla-sizing"},
        "linearize.json": {"format": "emla-linearization"},
        "certificate.csv": "gains,figure,unit,lift\n",
    }
    assert written.keys() == RECORDS.keys()
    for name, content in written.items():
        (tmp_path / name).write_text(content if isinstance(content, str) else json.dumps(content))
        assert RECORDS[name](tmp_path / name)
        (tmp_path / name).write_bytes(USER_CONTENT)
        assert not RECORDS[name](tmp_path / name)
