"""Packages and FMUs that are not sound zip files are refused, and nothing is written outside."""

import io
import stat
import struct
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from emla_cosim.cli.app import app
from emla_cosim.fmu.file import LARGEST, UnsafeArchiveError, unpack
from tests.support.refusals import problem_of
from tests.support.ssp_documents import binding, component, description, folder, ssd, ssv, system

GIB = 2**30


def archive(*entries: tuple[str | zipfile.ZipInfo, bytes], **more: int) -> bytes:
    """A zip file with a good structure and these entries."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", more.get("compression", zipfile.ZIP_DEFLATED)) as file:
        file.writestr("SystemStructure.ssd", ssd(system("root")))
        for name, content in entries:
            file.writestr(name, content)
    return stream.getvalue()


def link(name: str, target: str) -> tuple[zipfile.ZipInfo, bytes]:
    entry = zipfile.ZipInfo(name)
    entry.create_system = 3
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry, target.encode()


def renamed(content: bytes, old: str, new: str) -> bytes:
    """With another name of the same length, as zipfile would not write it."""
    assert len(old) == len(new) and content.count(old.encode()) == 2
    return content.replace(old.encode(), new.encode())


def resized(content: bytes, name: str, size: int, header: bool = True) -> bytes:
    """With a wrong size of an entry in the directory, and in its header."""
    data = bytearray(content)
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        offset = file.getinfo(name).header_offset
    directory = data.index(b"PK\x01\x02", data.rindex(name.encode()) - 46)
    struct.pack_into("<I", data, directory + 24, size)
    if header:
        struct.pack_into("<I", data, offset + 22, size)
    return bytes(data)


def damaged(content: bytes, name: str) -> bytes:
    """With other bytes at the beginning of the packed data of an entry."""
    data = bytearray(content)
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        start = file.getinfo(name).header_offset + 30 + len(name)
    data[start : start + 12] = bytes(x ^ 0x07 for x in data[start : start + 12])
    return bytes(data)


def encrypted(content: bytes) -> bytes:
    data = bytearray(content)
    for signature, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(signature) + flags] |= 1
    return bytes(data)


EXTRA = ("extra.txt", b"ha" * 5000)
OUTSIDE, LINK = "not a path inside", "is a symbolic link"
BROKEN = {
    "above": (archive(("../evil.txt", b"x")), ["'../evil.txt'", OUTSIDE]),
    "far above": (archive(("a/../../../evil.txt", b"x")), ["evil.txt'", OUTSIDE]),
    "absolute": (archive(("/tmp/evil.txt", b"x")), ["'/tmp/evil.txt'", OUTSIDE]),
    "drive": (archive(("C:/evil.txt", b"x")), ["'C:/evil.txt'", OUTSIDE]),
    "backslash": (renamed(archive(("a/../evil", b"x")), "a/../evil", "a\\..\\evil"), [OUTSIDE]),
    "link": (archive(link("secret", "/etc/passwd")), ["'secret'", LINK]),
    "link and file": (archive(link("up", ".."), ("up/evil.txt", b"x")), ["'up'", LINK]),
    "huge": (resized(archive(EXTRA), "extra.txt", 0xFFFFFFFE), ["4.0 GiB", "limit is 4 GiB"]),
    "longer": (resized(archive(EXTRA), "extra.txt", 100), ["'extra.txt'"]),
    "longer in directory": (resized(archive(EXTRA), "extra.txt", 100, header=False), ["'extra.txt'"]),
    "shorter": (resized(archive(EXTRA), "extra.txt", 20000), ["extra.txt"]),
    "not a zip": (b"This is not a zip file.", ["not a zip"]),
    "empty": (b"", ["not a zip"]),
    "cut off": (archive(EXTRA)[:-30], ["not a zip"]),
    "cut in front": (archive(EXTRA)[60:], []),
    "damaged": (damaged(archive(EXTRA), "extra.txt"), []),
    "damaged bzip2": (damaged(archive(EXTRA, compression=zipfile.ZIP_BZIP2), "extra.txt"), []),
    "damaged lzma": (damaged(archive(EXTRA, compression=zipfile.ZIP_LZMA), "extra.txt"), []),
    "encrypted": (encrypted(archive(EXTRA)), ["encrypted"]),
    "file as folder": (archive(("a", b"x"), ("a/b", b"y")), []),
    "no structure": (b"PK\x05\x06" + bytes(18), ["no 'SystemStructure.ssd'", "an SSP has one"]),
}


@pytest.mark.parametrize(("content", "words"), BROKEN.values(), ids=BROKEN)
def test_broken_package_is_refused(content: bytes, words: list, tmp_path: Path) -> None:
    (tmp_path / "x.ssp").write_bytes(content)
    problem_of(tmp_path / "x.ssp", "x.ssp'", *words)


def test_command_prints_one_line_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for path in (tmp_path / "temporary", tmp_path / "work"):
        path.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.chdir(tmp_path / "work")
    (tmp_path / "x.ssp").write_bytes(BROKEN["damaged"][0])
    result = CliRunner().invoke(app, ["run", "../x.ssp", "--stop-time", "1", "--step-size", "0.1"])
    assert (result.exit_code, result.stdout) == (2, "")
    (line,) = [x for x in result.stderr.splitlines() if x.strip() and not x.endswith("-:--:--")]
    assert line.startswith("Error: ") and "temporary" not in line
    assert {p.name for p in tmp_path.rglob("*")} == {"temporary", "work", "x.ssp"}


def test_broken_package_inside_another_is_named(tmp_path: Path) -> None:
    part = component("p", "inner.ssp", type="application/x-ssp-package")
    path = folder(tmp_path / "outer", root=ssd(system("s", part)), inner__ssp=BROKEN["above"][0])
    problem_of(path, "inner.ssp' has the entry '../evil.txt'")


def test_total_size_of_a_package_is_limited(tmp_path: Path) -> None:
    content = archive(*((f"extra{i}.txt", b"x") for i in range(10)))
    for i in range(10):
        content = resized(content, f"extra{i}.txt", GIB)
    (tmp_path / "x.ssp").write_bytes(content)
    problem_of(tmp_path / "x.ssp", "10.0 GiB", f"{LARGEST // GIB} GiB")


def test_all_names_are_checked_before_anything_is_written(tmp_path: Path) -> None:
    (tmp_path / "x.ssp").write_bytes(archive(EXTRA, ("../evil.txt", b"x")))
    with pytest.raises(UnsafeArchiveError):
        unpack(tmp_path / "x.ssp", tmp_path / "x")
    assert not (tmp_path / "x").exists()


def fmu_with(*entries: tuple[str | zipfile.ZipInfo, bytes]) -> bytes:
    return archive(("modelDescription.xml", description("a", "k:parameter").encode()), *entries)


UNREADABLE = "not an FMU that can be read"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (fmu_with(("../evil.txt", b"x")), ["'../evil.txt'", OUTSIDE]),
        (fmu_with(link("binaries", "/usr/lib")), ["'binaries'", LINK]),
        (resized(fmu_with(EXTRA), "extra.txt", 0xFFFFFFFE), ["limit is 4 GiB"]),
        (resized(fmu_with(EXTRA), "modelDescription.xml", 0xFFFFFFFE), ["256 MiB"]),
        (damaged(fmu_with(EXTRA), "extra.txt"), [UNREADABLE]),
        (damaged(fmu_with(EXTRA), "modelDescription.xml"), [UNREADABLE]),
        (fmu_with(EXTRA)[:-30], [UNREADABLE]),
        (fmu_with(), ["no binary for"]),
    ],
)
def test_broken_fmu_is_refused(content: bytes, words: list, tmp_path: Path) -> None:
    root = ssd(system("root", component("a", "a.fmu")))
    problem_of(folder(tmp_path / "ssp", root=root, a__fmu=content), "a.fmu'", *words)
    with zipfile.ZipFile(tmp_path / "p.ssp", "w") as file:
        file.writestr("SystemStructure.ssd", root)
        file.writestr("a.fmu", content)
    problem_of(tmp_path / "p.ssp", "a.fmu'", *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [(lambda x: resized(x, "k.ssv", 100 * 2**20), ["64 MiB"]), (lambda x: damaged(x, "k.ssv"), [])],
)
def test_broken_parameter_file_in_fmu_is_refused(
    change: Callable[[bytes], bytes], words: list, tmp_path: Path
) -> None:
    root = system("root", component("a", "a.fmu", bindings=binding("k.ssv", source_base="component")))
    content = change(fmu_with(("k.ssv", ssv(k=1.0).encode())))
    path = folder(tmp_path / "ssp", root=ssd(root), a__fmu=content)
    problem_of(path, "'k.ssv' inside 'a.fmu'", *words)
