"""FMU files that cannot be opened: one message each, before any of their code is loaded."""

import errno
import os
import struct
import sys
import zipfile
from pathlib import Path

import fmpy
import lief
import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.file import missing_bytes, open_fmu
from fmublock.archive import write_archive
from tests.support.commands import Emla, sentence
from tests.support.full_disk import files_of_at_most

BINARY = f"binaries/{fmpy.platform}/Faulty{fmpy.sharedLibraryExtension}"
linux = pytest.mark.skipif(
    sys.platform != "linux", reason="Loaders other than that of Linux search in other places."
)


def with_library(fmu: Path, target: Path, library: bytes) -> Path:
    """The FMU with another library, in an archive without a fault."""
    with zipfile.ZipFile(fmu) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    assert BINARY in content
    write_archive(target, {**content, BINARY: library})
    return target


def library_of(fmu: Path) -> bytes:
    with zipfile.ZipFile(fmu) as archive:
        return archive.read(BINARY)


def loaded_end(library: bytes) -> int:
    """Where the last byte is that the loader maps, as LIEF reads it."""
    elf = lief.ELF.parse(list(library))
    assert isinstance(elf, lief.ELF.Binary)
    segments = [s for s in elf.segments if s.type == lief.ELF.Segment.TYPE.LOAD]
    return max(s.file_offset + s.physical_size for s in segments)


@linux
def test_library_is_needed_to_the_last_loaded_byte(faulty_fmu: Path, tmp_path: Path) -> None:
    library = library_of(faulty_fmu)
    end = loaded_end(library)
    truncated = with_library(faulty_fmu, tmp_path / "Short.fmu", library[:end])
    assert open_fmu(truncated, tmp_path / "short" / "0").library.is_file()
    cut = with_library(faulty_fmu, tmp_path / "Cut.fmu", library[: end - 1])
    with pytest.raises(CommandError) as refused:
        open_fmu(cut, tmp_path / "cut" / "0")
    assert str(refused.value) == (
        f"the library '{fmpy.platform}/Faulty.so' of the FMU '{cut}' is truncated: "
        "its last 1 byte is missing. Download or build the FMU again."
    )


@linux
def test_library_truncated_anywhere_is_refused(faulty_fmu: Path, emla: Emla, tmp_path: Path) -> None:
    library = library_of(faulty_fmu)
    for size in (0, 63, 64, 200, len(library) // 2):
        cut = with_library(faulty_fmu, tmp_path / "Cut.fmu", library[:size])
        text = sentence(emla("run", str(cut), "--stop-time", "1", "--step-size", "0.1"), 2)
        assert "Cut.fmu" in text, size


@linux
def test_invalid_headers_are_left_to_the_loader(faulty_fmu: Path, tmp_path: Path) -> None:
    library = bytearray(library_of(faulty_fmu))
    path = tmp_path / "library"
    for offset, form, value in ((32, "<Q", 2**63), (54, "<H", 0), (54, "<H", 57), (56, "<H", 2**16 - 1)):
        lying = library.copy()
        struct.pack_into(form, lying, offset, value)
        path.write_bytes(lying)
        missing_bytes(path)  # whatever it is, it comes without an error
    path.write_bytes(b"MZ not of this machine")
    assert missing_bytes(path) == 0


def test_full_temporary_folder_is_reported(faulty_fmu: Path, tmp_path: Path) -> None:
    folder = tmp_path / "temporary" / "emla-x" / "0"
    with files_of_at_most(1000), pytest.raises(CommandError) as refused:
        open_fmu(faulty_fmu, folder)
    full = f"cannot be unpacked to '{tmp_path / 'temporary'}': {os.strerror(errno.EFBIG)}"
    assert str(refused.value) == f"the FMU '{faulty_fmu}' {full}. Set TMPDIR to another folder."
