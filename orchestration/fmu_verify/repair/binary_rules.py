"""Mend what a model description must have in common with the libraries, which are only read."""

import re
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

from .record import Change

_GUID = re.compile(r"\{?([0-9A-Fa-f-]{16,64})\}?")
_SUFFIXES = (".so", ".dll", ".dylib")
_KINDS = "ModelExchange | CoSimulation | ScheduledExecution"
_BUILD = "sources/buildDescription.xml"


def find_libraries(names: list[str]) -> list[str]:
    """Return the entries of an archive that are libraries of platforms."""
    paths = ((name, PurePosixPath(name)) for name in names)
    return [n for n, p in paths if len(p.parts) == 3 and p.parts[0] == "binaries" and p.suffix in _SUFFIXES]


def mend_identifier(root: Any, names: list[str]) -> Iterator[Change]:
    """Mend a modelIdentifier that differs from the names of all libraries in case only."""
    stems = {PurePosixPath(name).stem for name in find_libraries(names)}
    for kind in root.xpath(_KINDS) if _BUILD not in names else ():  # it has the identifier, too
        identifier = kind.get("modelIdentifier", "")
        near = [stem for stem in stems if stem.casefold() == identifier.casefold()]
        if identifier not in stems and len(near) == 1:
            kind.set("modelIdentifier", near[0])
            yield Change("binaries.present", f"modelIdentifier of {kind.tag}", identifier, near[0])


def mend_guid(root: Any, version: int, libraries: Mapping[str, bytes]) -> Iterator[Change]:
    """Mend a GUID that libraries have in another case, or with braces; all libraries must agree."""
    name = "instantiationToken" if version == 3 else "guid"
    guid = root.get(name, "")
    if (match := _GUID.fullmatch(guid)) is None:
        return
    # the end of a text in the data of a library, whose beginning need not follow a zero
    pattern = re.compile(rb"(?<![\w{-])(\{?" + re.escape(match[1].encode()) + rb"\}?)(?=\0)", re.IGNORECASE)
    spellings = {m[1].decode() for content in libraries.values() for m in pattern.finditer(content)}
    # a library without the GUID could have it in another form
    if len(spellings) == 1 and guid not in spellings and all(pattern.search(c) for c in libraries.values()):
        (after,) = spellings
        root.set(name, after)
        yield Change("instance.guid", name, guid, after)
