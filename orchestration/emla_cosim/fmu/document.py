"""The XML files in an FMU that describe it as a whole, as they are written."""

import re
import zipfile
import zlib
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from ..base.untrusted_xml import parse_xml

DESCRIPTION = "modelDescription.xml"
TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
"""Names of the model description, and of the description of terminals of FMI 3.0."""

_LARGEST = 2**24
"""Largest size in bytes at which the description of terminals is read."""

_KINDS = ("CoSimulation", "ModelExchange", "ScheduledExecution")
_VERSION_3 = re.compile(r"3\.0(\.[0-9]+)?")


class FmuDocument:
    """The descriptions in an FMU file; properties read the file on first use.

    Args:
        path: The FMU file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @cached_property
    def root(self) -> Any:
        """The root element of the model description."""
        with zipfile.ZipFile(self.path) as archive:
            return parse_xml(archive.read(DESCRIPTION))

    @property
    def version(self) -> int:
        """The version of FMI: 3 for FMI 3.0, otherwise 2."""
        return 3 if _VERSION_3.fullmatch(self.root.get("fmiVersion", "")) else 2

    @property
    def kinds(self) -> list[str]:
        """The kinds of the FMU: `CoSimulation`, `ModelExchange`, and that of FMI 3.0, in this order."""
        names = _KINDS if self.version == 3 else _KINDS[:2]
        return [name for name in names if self.root.find(name) is not None]

    def list_flags(self, kind: str) -> tuple[str, ...]:
        """Return the attributes of the element of a kind that are true."""
        element = self.root.find(kind)
        attributes = {} if element is None else element.attrib
        return tuple(name for name, text in attributes.items() if text.strip() in ("true", "1"))

    @property
    def platforms(self) -> tuple[str, ...]:
        """The non-empty folders in binaries/."""
        with zipfile.ZipFile(self.path) as archive:
            parts = [PurePosixPath(e.filename).parts for e in archive.infolist() if not e.is_dir()]
        return tuple(sorted({p[1] for p in parts if len(p) > 2 and p[0] == "binaries"}))

    def read_terminals(self) -> tuple[str, ...]:
        """Return the names of all terminals, with those that they are in; none without their description.

        Raises:
            ValueError: The description cannot be read. The message has no full stop.
        """
        try:
            with zipfile.ZipFile(self.path) as archive:
                if TERMINALS not in archive.namelist():
                    return ()
                if archive.getinfo(TERMINALS).file_size > _LARGEST:
                    limit = f"{_LARGEST // 2**20} MiB"
                    raise ValueError(f"{TERMINALS} of '{self.path}' is larger than {limit} and was not read")
                root = parse_xml(archive.read(TERMINALS))
        except (OSError, RuntimeError, EOFError, zlib.error, zipfile.BadZipFile, SyntaxError) as error:
            raise ValueError(f"{TERMINALS} of '{self.path}' cannot be read: {error}") from error
        paths = ([*reversed([*t.iterancestors("Terminal")]), t] for t in root.iterfind(".//Terminal"))
        return tuple(".".join(str(part.get("name", "")) for part in path) for path in paths)
