"""The XML files of an FMU as they are written, and attributes in them that cannot be read."""

import re
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from ..base.units import BASE_UNITS
from ..base.untrusted_xml import parse_xml
from ..base.wording import shorten_line
from .fmi_3_calls import FLOATS, INTEGERS, NUMBER_TYPES

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


_TYPES_2 = ("Real", "Integer", "Boolean", "String", "Enumeration")
_TYPES_3 = (*NUMBER_TYPES, "Boolean", "String", "Binary", "Enumeration", "Clock")
_UNKNOWNS_2 = "ModelStructure/*[self::Outputs or self::Derivatives or self::InitialUnknowns]/Unknown"
_UNKNOWNS_3 = (
    "ModelStructure/*[self::Output or self::ContinuousStateDerivative or self::ClockedState"
    " or self::InitialUnknown or self::EventIndicator]"
)
_ATTRIBUTE_KINDS = "ModelExchange | CoSimulation | ScheduledExecution"
_LONGEST = 60
"""Most letters of a value in a message."""


class _Number(NamedTuple):
    """What the text of an attribute must be."""

    description: str
    low: float = -np.inf
    high: float = np.inf
    is_whole: bool = True

    def accepts(self, text: str) -> bool:
        """Return whether a text is such a number."""
        try:
            return self.low <= int(text) <= self.high if self.is_whole else float(text) is not None
        except ValueError:
            return False


_DOUBLE = _Number("a number", is_whole=False)
_WHOLE_NUMBER = _Number("a whole number")


def _make_range(low: int, high: int) -> _Number:
    return _Number(f"a whole number from {low} to {high}", low, high)


_UNSIGNED = _make_range(0, 2**32 - 1)
_SIZE = _Number("a whole number, at least 0", 0)
_BY_TYPE = {
    **dict.fromkeys(("Real", *FLOATS), _DOUBLE),
    **{kind: _make_range(np.iinfo(kind.lower()).min, np.iinfo(kind.lower()).max) for kind in INTEGERS},
    "Integer": _make_range(-(2**31), 2**31 - 1),
    "Enumeration": _WHOLE_NUMBER,
}
"""What start values and limits must be, by the type of their variable."""


def find_attribute_fault(path: Path, fatal: bool = True) -> str | None:
    """Return the first attribute of a model description that cannot be used, as the end of a message.

    Args:
        path: The FMU file.
        fatal: Whether to leave out faults with which the FMU can be read.

    Returns:
        The element, the attribute and what would be right; None without such a fault, or if the file
        cannot be read at all.
    """
    try:
        root = FmuDocument(path).root
    except MemoryError:
        raise
    except Exception:  # zip and XML readers raise many types
        return None
    return next((text for is_fatal, text in _list_faults(root) if is_fatal or not fatal), None)


_Fault = tuple[bool, str]
"""Whether a fault is fatal, and its description."""


def _list_faults(root: Any) -> Iterator[_Fault]:
    """Yield the faults of a model description in the order of the standard."""
    version = root.get("fmiVersion")
    if version is None:
        yield True, f"{_describe(root)} has no fmiVersion; it needs 2.0 or 3.0"
        return
    if not version.startswith(("1.", "2.", "3.")):
        return  # the message on the version is better
    is_1, is_3 = version.startswith("1."), version.startswith("3.")
    yield from _check(root, "numberOfEventIndicators", _UNSIGNED)
    if is_1:
        yield from _check(root, "numberOfContinuousStates", _UNSIGNED, required=True)
    for element in () if is_1 else root.xpath(_ATTRIBUTE_KINDS):
        yield from _require(element, "modelIdentifier", "the name of the library")
        orders = ("maxOutputDerivativeOrder", "recommendedIntermediateInputSmoothness")
        yield from _check_all([element], orders, _WHOLE_NUMBER)
    times = ("startTime", "stopTime", "tolerance", "stepSize")
    yield from _check_all(root.iterfind("DefaultExperiment"), times, _DOUBLE)
    if not is_1:
        yield from _check_all(root.iterfind("UnitDefinitions/Unit/BaseUnit"), BASE_UNITS, _WHOLE_NUMBER)
        yield from _check_all(root.iterfind("UnitDefinitions/Unit/*"), ("factor", "offset"), _DOUBLE)
        yield from _check_types(root, is_3)
    variables = root.find("ModelVariables")
    if variables is None:
        yield True, f"{_describe(root)} has no element ModelVariables"
        return
    yield from _check_variables(variables, is_3)
    if is_3:
        yield from _check_references(root, variables)
    elif not is_1:
        yield from _check_indices(root, variables)
    for variable in list_variables_without_variability(root):
        yield False, describe_missing_variability(variable)


def list_variables_without_variability(root: Any) -> list[Any]:
    """Return the parameters of FMI 2.0 without `variability`, whose default is not allowed for them."""
    if not root.get("fmiVersion", "").startswith("2."):
        return []
    variables = root.iterfind("ModelVariables/ScalarVariable")
    kinds = ("parameter", "calculatedParameter")
    return [v for v in variables if v.get("causality") in kinds and v.get("variability") is None]


def describe_missing_variability(variable: Any) -> str:
    """Return the fault of a parameter without `variability`."""
    kind = "parameter" if variable.get("causality") == "parameter" else "calculated parameter"
    return (
        f"{_describe(variable)} is a {kind} without variability; it needs fixed or tunable, as the default, "
        "continuous, is not allowed for it"
    )


def _check_types(root: Any, is_3: bool) -> Iterator[_Fault]:
    """Yield faults of type definitions; a wrong item is fatal only if a variable has the type."""
    used = {element.get("declaredType") for element in root.iterfind("ModelVariables//*[@declaredType]")}
    for definition in root.iterfind("TypeDefinitions/*"):
        inner = definition if is_3 else next(definition.iterfind("*"), None)
        if inner is None:
            needed = ", ".join(_TYPES_2)
            yield True, f"{_describe(definition)} has no element with its type; it needs one of {needed}"
            continue
        yield from _check_limits(inner, inner.tag.removesuffix("Type"))
        for item in inner.iterfind("Item"):
            for _, text in _check(item, "value", _WHOLE_NUMBER, required=True):
                yield definition.get("name") in used, text


def _check_variables(variables: Any, is_3: bool) -> Iterator[_Fault]:
    """Yield faults of name, type, value reference, values and dimensions of each variable."""
    types = _TYPES_3 if is_3 else _TYPES_2
    for variable in variables.iterfind("*"):
        label = _describe(variable)
        if variable.get("name") is None:
            yield True, f"{label} has no name; it needs a unique one"
        inner = variable if is_3 else next((e for e in variable.iterfind("*") if e.tag in types), None)
        if inner is None:
            yield True, f"{label} has no type; it needs an element {', '.join(types[:-1])} or {types[-1]}"
            continue
        if inner.tag not in types:
            yield True, f"{label} is of the type {inner.tag}; it must be one of {', '.join(types)}"
            continue
        yield from _check(variable, "valueReference", _UNSIGNED, required=True)
        yield from _check_values(inner)
        for dimension in variable.iterfind("Dimension"):
            if dimension.get("start") is None and dimension.get("valueReference") is None:
                text = "has neither start nor valueReference; it needs one of them"
                yield True, f"{_describe(dimension)} {text}"
            yield from _check(dimension, "start", _SIZE)
            yield from _check(dimension, "valueReference", _UNSIGNED)
        if inner.tag == "Clock":
            variabilities = "constant, fixed, tunable, changing, countdown or triggered"
            for _, text in _require(inner, "intervalVariability", variabilities):
                yield False, text


def _check_values(inner: Any) -> Iterator[_Fault]:
    """Check numbers in the element with the type of a variable; arrays have several start values."""
    yield from _check(inner, "maxSize", _SIZE)
    start, number = inner.get("start", ""), _BY_TYPE.get(inner.tag)
    if inner.tag == "Boolean" and not all(w in ("true", "false", "1", "0") for w in start.lower().split()):
        yield True, f"{_describe(inner)} has start = '{_shorten(start)}'; it must be true or false"
    if number is not None and inner.find("Dimension") is None:
        yield from _check(inner, "start", number)
    elif number is not None and not all(number.accepts(word) for word in start.split()):
        yield (
            True,
            f"{_describe(inner)} has start = '{_shorten(start)}'; each value must be {number.description}",
        )
    yield from _check_limits(inner, inner.tag)


def _check_limits(element: Any, kind: str) -> Iterator[_Fault]:
    if (number := _BY_TYPE.get(kind)) is not None:
        yield from _check_all([element], ("min", "max"), number)
        yield from _check(element, "nominal", _DOUBLE)


def _check_references(root: Any, variables: Any) -> Iterator[_Fault]:
    """Check what refers to variables by value reference, in FMI 3.0."""
    by_reference = {_parse_reference(e.get("valueReference", "")): e for e in variables.iterfind("*")}
    for variable in variables.iterfind("*"):
        if variable.get("clocks") is not None:
            yield from _require(variable, "clocks", "value references of Clocks, or must be left out")
        yield from _check(variable, "derivative", _UNSIGNED)
        for name in ("derivative", "clocks"):
            yield from _check_targets(variable, name, by_reference)
        for dimension in variable.iterfind("Dimension"):
            if dimension.get("start") is not None:
                continue
            yield from _check_targets(dimension, "valueReference", by_reference)
            size = by_reference.get(_parse_reference(dimension.get("valueReference", "")))
            if size is not None:
                needed = f"{_describe(size)}, the size of {_describe(variable)},"
                yield from _check(size, "start", _SIZE, needed, required=True)
    for element in root.xpath(_UNKNOWNS_3):
        yield from _check(element, "valueReference", _UNSIGNED, required=True)
        for name in ("valueReference", "dependencies"):
            yield from _check_targets(element, name, by_reference)


def _parse_reference(text: str) -> int | str:
    """Return a value reference; other texts as they are."""
    return int(text) if _UNSIGNED.accepts(text) else text


def _check_targets(element: Any, name: str, by_reference: Mapping[int | str, Any]) -> Iterator[_Fault]:
    if any(_parse_reference(word) not in by_reference for word in element.get(name, "").split()):
        end = "no variable has this value reference"
        yield True, f"{_describe(element)} has {name} = '{_shorten(element.get(name))}'; {end}"


def _check_indices(root: Any, variables: Any) -> Iterator[_Fault]:
    """Check what refers to variables by their position, in FMI 2.0."""
    count = sum(1 for _ in variables.iterfind("*"))
    number = _Number(f"the position of a variable, from 1 to {count}", 1, count)
    yield from _check_all(variables.iterfind("*/Real"), ["derivative"], number)
    for element in root.xpath(_UNKNOWNS_2):
        yield from _check(element, "index", number, required=True)
        words = element.get("dependencies", "").split()
        if not all(number.accepts(word) for word in words if word != "0"):
            text = f"has dependencies = '{_shorten(element.get('dependencies'))}'; each must be "
            yield True, f"{_describe(element)} {text}{number.description}"


def _check_all(elements: Iterable[Any], names: Iterable[str], number: _Number) -> Iterator[_Fault]:
    for element in elements:
        for name in names:
            yield from _check(element, name, number)


def _check(
    element: Any, name: str, number: _Number, label: str = "", required: bool = False
) -> Iterator[_Fault]:
    """Check a number in an attribute."""
    text = element.get(name)
    if text is None:
        if required:
            yield True, f"{label or _describe(element)} has no {name}; it needs {number.description}"
    elif not number.accepts(text):
        yield (
            True,
            f"{label or _describe(element)} has {name} = '{_shorten(text)}'; it must be {number.description}",
        )


def _require(element: Any, name: str, expected: str) -> Iterator[_Fault]:
    """Check that an attribute is present and not empty."""
    if not (element.get(name) or "").strip():
        yield True, f"{_describe(element)} has no {name}; it needs {expected}"


def _describe(element: Any) -> str:
    """Return what messages call an element, with its line."""
    parent, tag, name = element.getparent(), element.tag, element.get("name")
    holder = "" if parent is None else parent.tag
    if holder in ("ScalarVariable", "SimpleType"):
        return _describe(parent)  # its type
    if tag == "Item":
        return f"Item '{name or ''}' of {_describe(parent)}"
    if holder == "Unit" or tag == "Dimension":
        return f"{tag} of {_describe(parent)}"
    label = f"{tag} of {holder}" if tag == "Unknown" else tag
    kind = {"ModelVariables": "variable", "TypeDefinitions": "type", "UnitDefinitions": "unit"}.get(holder)
    if kind is not None and (name is not None or kind == "unit"):
        label = f"the {kind} '{_shorten(name or '')}'"
    elif kind == "variable":
        label = f"variable {element.getparent().xpath('*').index(element) + 1}"
    return f"{label} (line {element.sourceline})"


def _shorten(text: str) -> str:
    return shorten_line(text, _LONGEST)
