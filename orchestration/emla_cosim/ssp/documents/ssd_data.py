"""The content of an SSP as plain data, and identifiers that every tool accepts.

Names and meanings follow the standard.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ...base.units import LinearTransformation, SiUnit
from ...base.wording import find_free_name
from ...fmu.elements import format_index
from ...fmu.parameters.parameter_sets import ParameterSet
from ...fmu.parameters.ssp_xml import VERSION_1
from ...system.bond import Bond

DEFAULT_SSD = "SystemStructure.ssd"
"""The main SSD of a package; others are variants."""

FMU = "application/x-fmu-sharedlibrary"
SSD = "application/x-ssp-definition"
SSP = "application/x-ssp-package"


@dataclass(frozen=True)
class TableTransformation:
    """A mapping of single values; `kind` is Boolean, Integer or Enumeration."""

    kind: str
    entries: tuple[tuple[int | bool | str, int | bool | str], ...]


Transformation = LinearTransformation | TableTransformation


@dataclass(frozen=True)
class MappingEntry:
    """A rule that sets the parameter `target` of an element from the parameter `source` of a set."""

    source: str
    target: str
    transformation: Transformation | None = None
    suppress_unit_conversion: bool = False


@dataclass(frozen=True)
class FileReference:
    """The URI of a file in an SSD; `base` says to what it is relative, SSD or component."""

    source: str
    base: str = "SSD"


@dataclass(frozen=True)
class ParameterBinding:
    """The parameter set of an element, inline or as a file, and the mapping of its names.

    With `renames`, results call the variables by the sources of the mapping too.
    """

    values: ParameterSet | FileReference
    prefix: str = ""
    mapping: tuple[MappingEntry, ...] | FileReference | None = None
    renames: bool = False


@dataclass(frozen=True)
class Dimension:
    """A dimension of an array: a size, the connector that has the size, or neither."""

    size: int | None = None
    connector: str | None = None


@dataclass(frozen=True)
class Connector:
    """A connector of an element; `position` is relative to its corners, 0 to 1.

    `dimensions` are those of an array. `location` is the file and line for error messages.
    """

    name: str
    kind: str
    type: str | None = None
    unit: SiUnit | None = None
    position: tuple[float, float] | None = None
    dimensions: tuple[Dimension, ...] = ()
    location: str = field(default="", compare=False)


@dataclass(frozen=True)
class SsdConnection:
    """A connection of two connectors. The system's own have no element; `waypoints` are x, y in mm.

    Indices, which begin with 1, select one element of an array. `location` is the file and line for error
    messages.
    """

    start_element: str | None
    start_connector: str
    end_element: str | None
    end_connector: str
    transformation: Transformation | None = None
    suppress_unit_conversion: bool = False
    waypoints: tuple[tuple[float, float], ...] = ()
    start_indices: tuple[int, ...] = ()
    end_indices: tuple[int, ...] = ()
    location: str = field(default="", compare=False)

    def __str__(self) -> str:
        start = ".".join(filter(None, (self.start_element, self.start_connector)))
        end = ".".join(filter(None, (self.end_element, self.end_connector)))
        return f"{start}{format_index(self.start_indices)} -> {end}{format_index(self.end_indices)}"


@dataclass(frozen=True)
class Element:
    """Common fields of all elements. `extent` is x1, y1, x2, y2 in mm, `id` is unique in the file."""

    name: str
    connectors: tuple[Connector, ...] = ()
    bindings: tuple[ParameterBinding, ...] = ()
    extent: tuple[float, float, float, float] | None = None
    id: str | None = None


@dataclass(frozen=True)
class ComponentElement(Element):
    """An element with a source file: an FMU or another system, by the MIME types above.

    `structure` has values of structural parameters of the FMU, by name, which come from parameter bindings.
    """

    source: str = ""
    type: str = FMU
    implementation: str = "any"
    structure: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class DictionaryReference(Element):
    """A reference to a signal dictionary, whose signals are the same in all references."""

    dictionary: str = ""


@dataclass(frozen=True)
class SystemElement(Element):
    """The root system or a nested one."""

    elements: tuple[Element, ...] = ()
    connections: tuple[SsdConnection, ...] = ()
    dictionaries: tuple[str, ...] = ()


@dataclass(frozen=True)
class Structure:
    """An SSD: its root system, and optionally how to run it; times in s.

    Our own annotation lists the components that compute at communication points (`samples`), by full name,
    and the power bonds by name. `is_continuous` says that all components are for Model Exchange.
    """

    name: str
    system: SystemElement
    start_time: float | None = None
    stop_time: float | None = None
    step_size: float | None = None
    description: str = ""
    samples: tuple[str, ...] = ()
    bonds: Mapping[str, Bond] = field(default_factory=dict)
    id: str | None = None
    is_continuous: bool = False
    version: str = VERSION_1


_LETTERS = "A-Z_a-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u3001-\ud7ff"
"""Characters that an XML id can begin with, for a set of a regular expression."""

_NOT_IN_ID = rf"[^{_LETTERS}0-9.-]|^[^{_LETTERS}]|_(?=x)"  # compiling it is slow, and few names need it
_ESCAPED = re.compile("_x([0-9A-F]+)_")


def make_identifier(name: str) -> str:
    """Return a name with underscores in place of characters that not every tool accepts."""
    plain = re.sub("[^A-Za-z0-9_]", "_", name)
    return plain if re.match("[A-Za-z]", plain) else f"c_{plain}"


def make_identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return a different identifier for each name. Names that are identifiers keep theirs."""
    names = list(names)
    used = {name for name in names if make_identifier(name) == name}
    identifiers = {}
    for name in names:
        identifier = make_identifier(name)
        if identifier != name:
            identifier = find_free_name(identifier, used)
            used.add(identifier)
        identifiers[name] = identifier
    return identifiers


def format_id(identifier: str, name: str) -> str | None:
    """Return the id that says which name an identifier represents; None if they are the same.

    Characters that an XML id cannot have are written as their number, such as _x0020_ for a space.
    """
    if identifier == name:
        return None
    return re.sub(_NOT_IN_ID, lambda match: f"_x{ord(match[0]):04X}_", name)


def parse_id(identifier: str, id_: str | None) -> str:
    """Return the name that an identifier represents: the identifier itself unless the id says another."""
    if id_ is None:
        return identifier
    name = _ESCAPED.sub(_unescape, id_)
    # an id of another tool can be anything; ours becomes the identifier, perhaps with a number
    prefix = re.escape(make_identifier(name))
    return name if re.fullmatch(rf"{prefix}(_\d+)?", identifier) else identifier


def _unescape(match: re.Match[str]) -> str:
    number = int(match[1], 16)
    return chr(number) if number <= 0x10FFFF else match[0]
