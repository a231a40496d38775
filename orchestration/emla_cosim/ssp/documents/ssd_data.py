"""The contents of an SSP as plain data: structure (SSD), parameter sets (SSV), mappings (SSM).

Names and meanings are those of the standard.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ...base.units import LinearTransformation, SiUnit
from ...system.bond import Bond

DEFAULT_SSD = "SystemStructure.ssd"
"""The SSD that a package has at its top; others are variants."""

FMU = "application/x-fmu-sharedlibrary"
SSD = "application/x-ssp-definition"
SSP = "application/x-ssp-package"


@dataclass(frozen=True)
class TableTransformation:
    """A mapping of single values: of Boolean, Integer or Enumeration `kind`."""

    kind: str
    entries: tuple[tuple[int | bool | str, int | bool | str], ...]


Transformation = LinearTransformation | TableTransformation


@dataclass(frozen=True)
class SsvParameter:
    """A named value; `type` is the SSV element, such as Real."""

    name: str
    type: str
    value: float | int | bool | str
    unit: SiUnit | None = None


@dataclass(frozen=True)
class ParameterSet:
    """An SSV: values by name."""

    name: str
    parameters: tuple[SsvParameter, ...]
    description: str = ""


@dataclass(frozen=True)
class MappingEntry:
    """The parameter `source` of a set is the parameter `target` of an element."""

    source: str
    target: str
    transformation: Transformation | None = None
    suppress_unit_conversion: bool = False


@dataclass(frozen=True)
class FileReference:
    """A file that an SSD names by its URI; `base` is SSD or component."""

    source: str
    base: str = "SSD"


@dataclass(frozen=True)
class ParameterBinding:
    """A parameter set that applies to an element, itself or as a file, and how names are mapped.

    With `renames` the sources of the mapping are what results call the variables, too.
    """

    values: ParameterSet | FileReference
    prefix: str = ""
    mapping: tuple[MappingEntry, ...] | FileReference | None = None
    renames: bool = False


@dataclass(frozen=True)
class Connector:
    """A variable that an element shows; `position` is relative to its corners, 0 to 1."""

    name: str
    kind: str
    type: str | None = None
    unit: SiUnit | None = None
    position: tuple[float, float] | None = None


@dataclass(frozen=True)
class SsdConnection:
    """Two connectors joined; the system's own have no element. `waypoints` are x, y in mm."""

    start_element: str | None
    start_connector: str
    end_element: str | None
    end_connector: str
    transformation: Transformation | None = None
    suppress_unit_conversion: bool = False
    waypoints: tuple[tuple[float, float], ...] = ()

    def __str__(self) -> str:
        start = ".".join(filter(None, (self.start_element, self.start_connector)))
        return f"{start} -> {'.'.join(filter(None, (self.end_element, self.end_connector)))}"


@dataclass(frozen=True)
class Element:
    """What all elements of a system have. `extent` is x1, y1, x2, y2 in mm, `id` unique in the file."""

    name: str
    connectors: tuple[Connector, ...] = ()
    bindings: tuple[ParameterBinding, ...] = ()
    extent: tuple[float, float, float, float] | None = None
    id: str | None = None


@dataclass(frozen=True)
class ComponentElement(Element):
    """An element that is a file: an FMU, or another system (see the MIME types above)."""

    source: str = ""
    type: str = FMU
    implementation: str = "any"


@dataclass(frozen=True)
class DictionaryReference(Element):
    """An element that stands for a signal dictionary: signals that are the same wherever it is named."""

    dictionary: str = ""


@dataclass(frozen=True)
class SystemElement(Element):
    """A system, the root or one inside another."""

    elements: tuple[Element, ...] = ()
    connections: tuple[SsdConnection, ...] = ()
    dictionaries: tuple[str, ...] = ()


@dataclass(frozen=True)
class Structure:
    """An SSD: its root system, and how to run it if it says so; times in s.

    An annotation of ours has the full names of components that compute at communication points, `samples`,
    and power bonds by name.
    """

    name: str
    system: SystemElement
    start_time: float | None = None
    stop_time: float | None = None
    step_size: float | None = None
    description: str = ""
    samples: tuple[str, ...] = ()
    bonds: Mapping[str, Bond] = field(default_factory=dict)
