"""Packages and FMUs that are no honest zip files: refused, and nothing written outside."""

import io
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from emla_cosim.fmu.unpack import LARGEST, UnsafeArchiveError, unpack
from tests.support.refusals import Refused, refusals
from tests.support.ssp_documents import binding, component, description, folder, ssd, ssv, system

Archive = Callable[[Path], None]
GIB = 2**30


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Refused:
    return refusals(tmp_path, monkeypatch)


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


def lying(content: bytes, name: str, size: int, both: bool = True) -> bytes:
    """With another size of an entry in the directory, and in its header."""
    data = bytearray(content)
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        header = file.getinfo(name).header_offset
    directory = data.index(b"PK\x01\x02", data.rindex(name.encode()) - 46)
    struct.pack_into("<I", data, directory + 24, size)
    if both:
        struct.pack_into("<I", data, header + 22, size)
    return bytes(data)


def damaged(content: bytes, name: str) -> bytes:
    """With other bytes at the beginning of the packed data of an entry."""
    data = bytearray(content)
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        start = file.getinfo(name).header_offset + 30 + len(name)
    for i in range(12):
        data[start + i] ^= 0x07
    return bytes(data)


def encrypted(content: bytes) -> bytes:
    data = bytearray(content)
    for signature, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(signature) + flags] |= 1
    return bytes(data)


EXTRA = ("extra.txt", b"ha" * 5000)
BROKEN = {
    "above": (archive(("../evil.txt", b"x")), ["'../evil.txt'", "not a path inside"]),
    "far above": (archive(("a/../../../evil.txt", b"x")), ["evil.txt'", "not a path inside"]),
    "absolute": (archive(("/tmp/evil.txt", b"x")), ["'/tmp/evil.txt'", "not a path inside"]),
    "drive": (archive(("C:/evil.txt", b"x")), ["'C:/evil.txt'", "not a path inside"]),
    "backslash": (renamed(archive(("a/../evil", b"x")), "a/../evil", "a\\..\\evil"), ["not a path inside"]),
    "link": (archive(link("secret", "/etc/passwd")), ["'secret'", "is a symbolic link"]),
    "link and file": (archive(link("up", ".."), ("up/evil.txt", b"x")), ["'up'", "is a symbolic link"]),
    "huge": (lying(archive(EXTRA), "extra.txt", 0xFFFFFFFE), ["4.0 GiB", "limit is 4 GiB"]),
    "longer": (lying(archive(EXTRA), "extra.txt", 100), ["'extra.txt'"]),
    "longer in directory": (lying(archive(EXTRA), "extra.txt", 100, both=False), ["'extra.txt'"]),
    "shorter": (lying(archive(EXTRA), "extra.txt", 20000), ["extra.txt"]),
    "no zip": (b"This is no zip file.", ["not a zip"]),
    "empty": (b"", ["not a zip"]),
    "cut off": (archive(EXTRA)[:-30], ["not a zip"]),
    "cut in front": (archive(EXTRA)[60:], ["x.ssp'"]),
    "damaged": (damaged(archive(EXTRA), "extra.txt"), ["x.ssp'"]),
    "damaged bzip2": (damaged(archive(EXTRA, compression=zipfile.ZIP_BZIP2), "extra.txt"), ["x.ssp'"]),
    "damaged lzma": (damaged(archive(EXTRA, compression=zipfile.ZIP_LZMA), "extra.txt"), ["x.ssp'"]),
    "encrypted": (encrypted(archive(EXTRA)), ["encrypted"]),
    "file as folder": (archive(("a", b"x"), ("a/b", b"y")), ["x.ssp'"]),
    "no structure": (b"PK\x05\x06" + bytes(18), ["no 'SystemStructure.ssd'", "an SSP has one"]),
}  # fmt: skip


@pytest.mark.parametrize(("content", "words"), BROKEN.values(), ids=BROKEN)
def test_packages(content: bytes, words: list, refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "x.ssp").write_bytes(content)
    sentence = refused(tmp_path / "x.ssp")
    assert "x.ssp'" in sentence
    for word in words:
        assert word in sentence, sentence


def test_packages_inside(refused: Refused, tmp_path: Path) -> None:
    """The sentence says which of the two it is."""
    part = component("p", "inner.ssp", type="application/x-ssp-package")
    path = folder(tmp_path / "outer", root=ssd(system("s", part)), inner__ssp=BROKEN["above"][0])
    sentence = refused(path)
    assert "inner.ssp' has the entry '../evil.txt'" in sentence


def test_a_good_package_after_all(tmp_path: Path) -> None:
    """The ways of breaking them break nothing else."""
    for content in (archive(EXTRA), lying(archive(EXTRA), "extra.txt", 10000)):
        (tmp_path / "x.ssp").write_bytes(content)
        unpack(tmp_path / "x.ssp", tmp_path / "x")
        assert (tmp_path / "x" / "extra.txt").read_bytes() == EXTRA[1]


def many(tmp_path: Path, count: int) -> Path:
    """Entries that claim to have 1 GiB each."""
    content = archive(*((f"extra{i}.txt", b"x") for i in range(count)))
    for i in range(count):
        content = lying(content, f"extra{i}.txt", GIB)
    (tmp_path / "x.ssp").write_bytes(content)
    return tmp_path / "x.ssp"


def test_ten_gigabytes_in_small_entries(refused: Refused, tmp_path: Path) -> None:
    sentence = refused(many(tmp_path, 10))
    assert "10.0 GiB" in sentence and f"{LARGEST // GIB} GiB" in sentence


def test_nothing_is_written_before_all_names_are_checked(tmp_path: Path) -> None:
    (tmp_path / "x.ssp").write_bytes(archive(EXTRA, ("../evil.txt", b"x")))
    with pytest.raises(UnsafeArchiveError):
        unpack(tmp_path / "x.ssp", tmp_path / "x")
    assert not (tmp_path / "x").exists()


# ---- FMUs --------------------------------------------------------------------------------------


def fmu_with(*entries: tuple[str | zipfile.ZipInfo, bytes]) -> bytes:
    return archive(("modelDescription.xml", description("a", "k:parameter").encode()), *entries)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (fmu_with(("../evil.txt", b"x")), ["'../evil.txt'", "not a path inside"]),
        (fmu_with(link("binaries", "/usr/lib")), ["'binaries'", "is a symbolic link"]),
        (lying(fmu_with(EXTRA), "extra.txt", 0xFFFFFFFE), ["limit is 4 GiB"]),
        (lying(fmu_with(EXTRA), "modelDescription.xml", 0xFFFFFFFE), ["256 MiB"]),
        (damaged(fmu_with(EXTRA), "extra.txt"), ["not an FMU that can be read"]),
        (damaged(fmu_with(EXTRA), "modelDescription.xml"), ["not an FMU that can be read"]),
        (fmu_with(EXTRA)[:-30], ["not an FMU that can be read"]),
        (fmu_with(), ["no binary for"]),
    ],
)
def test_fmus(content: bytes, words: list, refused: Refused, tmp_path: Path) -> None:
    root = system("root", component("a", "a.fmu"))
    (tmp_path / "p.ssp").write_bytes(archive(("a.fmu", content)))
    for path in (
        folder(tmp_path / "ssp", root=ssd(root), a__fmu=content),
        _packed(tmp_path / "p.ssp", ssd(root), content),
    ):
        sentence = refused(path)
        for word in ("a.fmu'", *words):
            assert word in sentence, sentence


def _packed(path: Path, root: str, fmu: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("SystemStructure.ssd", root)
        file.writestr("a.fmu", fmu)
    return path


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda content: lying(content, "k.ssv", 10 * 2**20 * 10), ["'k.ssv' inside 'a.fmu'", "64 MiB"]),
        (lambda content: damaged(content, "k.ssv"), ["'k.ssv' inside 'a.fmu'"]),
    ],
)
def test_parameter_files_inside_fmus(
    change: Callable[[bytes], bytes], words: list, refused: Refused, tmp_path: Path
) -> None:
    root = system("root", component("a", "a.fmu", bindings=binding("k.ssv", source_base="component")))
    content = change(fmu_with(("k.ssv", ssv(k=1.0).encode())))
    sentence = refused(folder(tmp_path / "ssp", root=ssd(root), a__fmu=content))
    for word in words:
        assert word in sentence, sentence


def test_zlib_errors_are_no_bad_zip_files(tmp_path: Path) -> None:
    """Which is why readers catch all of them."""
    (tmp_path / "x.ssp").write_bytes(BROKEN["damaged"][0])
    with pytest.raises((zlib.error, zipfile.BadZipFile)):
        unpack(tmp_path / "x.ssp", tmp_path / "x")
