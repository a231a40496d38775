"""Repair an FMU: mend its text, check it before and after, and write the new archive."""

import io
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from importlib.metadata import version as find_version
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.errors import CommandError
from emla_cosim.base.output_files import OutputFile, has_mark
from emla_cosim.base.untrusted_xml import parse_xml
from emla_cosim.fmu.document import DESCRIPTION, TERMINALS

from ..c_sources import BUILD_DESCRIPTION
from ..catalogue import STATIC
from ..check import Verdict
from ..checks.description import find_schema_problems
from ..findings import Examined, Finding
from ..runner import verify
from ..subject import Subject
from .attribute_rules import (
    find_libraries,
    mend_annotations,
    mend_attributes,
    mend_encoding,
    mend_guid,
    mend_identifier,
)
from .record import Change, write_record
from .structure_rules import mend_structure

# The comment of a repaired archive. A key of our own FMUs must not stay, because the content is another.
_MARK = b"repaired by emla-cosim"

_SYSTEM = "SystemStructure.ssd"
# static checks that text cannot change; they load, parse or compile binaries and sources
_UNAFFECTED = ("symbols", "imports", "loads", "version", "compile")

_CHECKS = tuple(c.name for c in STATIC if c.name.partition(".")[2] not in _UNAFFECTED)

is_repaired = has_mark(_MARK)
"""Recognize FMUs that this module wrote."""


@dataclass(frozen=True)
class Repair:
    """What a repair changes, and the static checks before and after.

    Attributes:
        path: The FMU.
        content: The repaired FMU; the same bytes if nothing was changed.
        changes: The changes, in order.
        before: The findings about the FMU.
        after: The findings about the repaired FMU.
        version: The version of FMI, 2 or 3.
    """

    path: Path
    content: bytes
    changes: tuple[Change, ...]
    before: Examined
    after: Examined
    version: int

    @property
    def remaining(self) -> list[Finding]:
        """The failed checks after the repair."""
        return self.after.of(Verdict.FAILED)

    def save(self, target: OutputFile) -> None:
        """Write the repaired FMU. Raises RunError."""
        target.write(self.content)


def repair(path: Path) -> Repair:
    """Mend what is wrong in the text of an FMU and has one remedy. `Repair.save` writes the result.

    Args:
        path: The FMU, which is only read.

    Raises:
        CommandError: It does not exist, is not an FMU, or cannot be unpacked safely.
    """
    if path.is_dir():
        raise CommandError(f"'{path}' is a folder; emla repair takes FMUs. Repair each FMU in it.")
    if _is_system(path):
        message = f"'{path}' is a system (SSP); emla repair takes FMUs. Unpack it, and repair each FMU in it."
        raise CommandError(message)
    before = verify(path, only=_CHECKS).examined[0]
    if any(f.check == "archive.safe" for f in before.of(Verdict.FAILED)):
        safe = before["archive.safe"]
        takes = "emla repair takes FMUs that can be unpacked."
        raise CommandError(f"'{path}' cannot be repaired: {safe.sentence} {takes} {safe.hint}")
    original = path.read_bytes()
    with zipfile.ZipFile(io.BytesIO(original)) as archive, tempfile.TemporaryDirectory() as folder:
        texts, changes, version = _mend_texts(archive, Path(folder))
        if not changes:
            return Repair(path, original, (), before, before, version)
        content = _rewrite(archive, texts)
        (mended := Path(folder) / path.name).write_bytes(content)
        after = verify({str(path): mended}, only=_CHECKS).examined[0]
    return Repair(path, content, tuple(changes), before, after, version)


def _is_system(path: Path) -> bool:
    """Return whether a file is an SSP, which `verify` would examine as an FMU without a model description."""
    with suppress(Exception), zipfile.ZipFile(path) as archive:  # `archive.safe` reports what cannot be read
        return _SYSTEM in (names := archive.namelist()) and DESCRIPTION not in names
    return False


def _mend_texts(archive: zipfile.ZipFile, folder: Path) -> tuple[dict[str, bytes], list[Change], int]:
    """Return the files of an archive that change, the changes, and the version of FMI."""
    names = archive.namelist()
    if DESCRIPTION not in names:
        return {}, [], 2
    content, changes = mend_encoding(archive.read(DESCRIPTION))
    try:
        root = parse_xml(content)
    except SyntaxError:
        return {}, [], 2
    fmi_version = root.get("fmiVersion", "")
    version = 3 if fmi_version.startswith("3.") else 2
    if root.tag != "fmiModelDescription" or not fmi_version.startswith(("2.", "3.")):
        return {}, [], version
    texts = dict[str, bytes]()
    changes += mend_attributes(root, version)
    changes += mend_identifier(root, names)
    changes += mend_guid(root, version, {name: archive.read(name) for name in find_libraries(names)})
    changes += _mend_model_structure(root, version, folder)
    for name, check in ((TERMINALS, "description.terminals"), (BUILD_DESCRIPTION, "sources.description")):
        if version == 3 and name in names:
            changes += _mend_other(texts, name, archive.read(name), check)
    if changes:
        if root.find("ModelVariables") is not None:
            write_record(root, version, changes, find_version("emla-cosim"))
        texts[DESCRIPTION] = _serialize(root)
    return texts, changes, version


def _mend_model_structure(root: Any, version: int, folder: Path) -> list[Change]:
    """Mend ModelStructure, unless the model description is still invalid; return the changes."""
    if find_schema_problems(parse_xml(_serialize(root)), f"fmi{version}ModelDescription.xsd"):
        return []
    path = folder / "mended.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(DESCRIPTION, _serialize(root))
    subject = Subject(path, folder)
    subject.document.__dict__["root"] = root  # its lists are changed in place
    return list(mend_structure(subject))


def _mend_other(texts: dict[str, bytes], name: str, content: bytes, check: str) -> Iterator[Change]:
    """Mend annotations in another XML file, and keep its new text."""
    try:
        root = parse_xml(content)
    except SyntaxError:
        return
    if changes := list(mend_annotations(root, check)):
        texts[name] = _serialize(root)
        yield from changes


def _serialize(root: Any) -> bytes:
    return etree.tostring(root.getroottree(), encoding="UTF-8", xml_declaration=True) + b"\n"


def _rewrite(archive: zipfile.ZipFile, texts: dict[str, bytes]) -> bytes:
    """Return an archive with new texts; all other entries keep their bytes, order and times."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as target:
        for entry in archive.infolist():
            text = texts.get(entry.filename)
            # `writestr` changes the entry
            target.writestr(copy(entry), archive.read(entry) if text is None else text)
        target.comment = _MARK
    return stream.getvalue()
