"""What a command leaves in a folder: every file whole, whatever happened to the command."""

import csv
import json
import tomllib
import zipfile
from io import StringIO
from pathlib import Path

import polars

_PICTURE = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"


def names(folder: Path) -> set[str]:
    """The names of everything in an output folder."""
    return {path.name for path in folder.iterdir()}


def assert_whole(folder: Path, killed: bool = False) -> int:
    """All files of a folder, and of folders in it, are whole; how many there are.

    Files that were not ready are gone, unless no process was left to remove them.
    """
    files = [p for p in folder.rglob("*") if p.is_file() and not p.is_symlink()]
    unfinished = [p for p in files if p.name.startswith(".")]
    assert killed or not unfinished, unfinished
    for path in set(files) - set(unfinished):
        _assert_whole(path)
    return len(files) - len(unfinished)


def _assert_whole(path: Path) -> None:
    if zipfile.is_zipfile(path):  # checkpoints and packages may have any name
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None, path
    elif path.suffix == ".json":
        json.loads(path.read_text(encoding="utf-8"))
    elif path.suffix == ".toml":
        tomllib.loads(path.read_text(encoding="utf-8"))
    elif path.suffix in (".opt", ".md", ".txt"):
        assert path.read_text(encoding="utf-8").endswith("\n"), path
    elif path.suffix == ".html":
        assert path.read_text(encoding="utf-8").rstrip().endswith("</html>"), path
    elif path.suffix == ".csv":
        assert_whole_rows(path)
    elif path.suffix == ".png":
        content = path.read_bytes()
        assert content.startswith(_PICTURE[0]) and content.endswith(_PICTURE[1]), path
    elif path.suffix == ".parquet":
        polars.read_parquet(path)
    elif (text := path.read_text(encoding="utf-8")).startswith("{"):  # in place of an empty file
        json.loads(text)
    elif text.startswith("<"):
        assert text.rstrip().endswith(("</html>", "</testsuites>")), path
    else:
        raise AssertionError(f"{path} is nothing that is known")


def assert_whole_rows(path: Path) -> None:
    """A table ends with an end of line, and its rows are as long as its header."""
    text = path.read_text(encoding="utf-8")
    assert text == "" or text.endswith("\n"), path
    header, *rows = csv.reader(StringIO(text, newline="")) if text else [[]]
    assert {len(row) for row in rows} <= {len(header)}, path
