"""The file itself: an archive that does no harm."""

import zipfile

from ...fmu.unpack import UnsafeArchiveError, unpack
from ..check import check
from ..subject import Subject
from ..verdict import Clause, Outcome, failed, passed


@check(
    "archive.safe",
    "The archive can be unpacked, and does no harm",
    Clause("2.3", "An FMU is distributed in one zip file."),
    "Make the FMU anew with a zip tool that writes relative names with forward slashes.",
)
def safe(subject: Subject) -> Outcome:
    """It is a zip file, whole, whose entries all belong into its folder; it is unpacked there."""
    if not subject.path.is_file():
        return failed("There is no such file.", hint="Name an FMU file.")
    try:
        unpack(subject.path, subject.folder)
    except UnsafeArchiveError as error:
        return failed(f"It {error}.")
    except (zipfile.BadZipFile, NotImplementedError, ValueError, EOFError, RuntimeError) as error:
        return failed(f"It cannot be unpacked: {error}.")
    with zipfile.ZipFile(subject.path) as archive:
        return passed(f"Its {len(archive.infolist())} entries were unpacked.")
