"""XML of the SSP standard: read with care, checked against the standard's schemas, written tidily."""

import math
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from ...base.errors import CommandError
from ...base.units import BASE_UNITS, LinearTransformation, SiUnit
from .ssd_data import TableTransformation, Transformation

XmlElement = Any

_ROOT = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = {
    "ssd": f"{_ROOT}Description",
    "ssc": f"{_ROOT}Common",
    "ssv": f"{_ROOT}ParameterValues",
    "ssm": f"{_ROOT}ParameterMapping",
}
ANNOTATION_NAMESPACES = {
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
}
"""Namespaces of the annotations in which OMSimulator and libcosim look for the step size."""

OWN_NAMESPACE = {"emla": "urn:emla-cosim:system"}
SYSTEM = "emla-cosim.system"
"""The type of the annotation of an experiment with what the standard has no element for."""

RENAMES = "emla-cosim.renames"
"""The type of the annotation of a binding whose mapping holds for results, too."""

CORNERS = ("x1", "y1", "x2", "y2")
"""Attributes of a rectangle."""

_KINDS = {
    "ssd": "SystemStructureDescription",
    "ssv": "ParameterSet",
    "ssm": "ParameterMapping",
}
_SCHEMAS = Path(__file__).parent / "schemas"
"""The standard's own schemas, by version and by namespace."""

_TABLES = ("Boolean", "Integer", "Enumeration")


@cache
def _etree() -> Any:
    """The XML library, loaded with the first document: commands without one start faster."""
    from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

    return etree


def parse(content: bytes, where: str, kind: str) -> XmlElement:
    """The root of a document of one kind: ssd, ssv or ssm.

    Nothing is fetched. Raises CommandError, with `where`, for what is no such document by the
    standard's schema, and for a document type, which may hold entities.
    """
    etree = _etree()
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True)
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise CommandError(f"'{where}' is not well-formed XML: {_short(str(error.msg))}.") from error
    if root.getroottree().docinfo.doctype:
        raise CommandError(f"'{where}' has a document type (<!DOCTYPE), which SSP has not.")
    check(root, where, kind)
    return root


def check(root: XmlElement, where: str, kind: str) -> None:
    """Raise CommandError unless this is a document of the kind, as the standard's schema says."""
    expected = f"{{{NAMESPACES[kind]}}}{_KINDS[kind]}"
    if root.tag != expected:
        raise CommandError(
            f"'{where}' is not a {_KINDS[kind]} of SSP, but has the root '{_short(root.tag)}'."
        )
    version = root.get("version", "")
    schema = _schema("2.0" if version.startswith("2.") else "1.0", kind)
    if not schema.validate(root):
        first = schema.error_log[0]
        raise CommandError(f"'{where}' line {first.line} is not valid SSP: {_short(first.message)}")


@cache
def _schema(version: str, kind: str) -> Any:
    etree = _etree()
    name = NAMESPACES[kind].rpartition("/")[2]
    return etree.XMLSchema(etree.parse(str(_SCHEMAS / version / f"{name}.xsd")))


def _short(text: str) -> str:
    """A message or tag without namespaces, in one line."""
    return " ".join(re.sub(r"\{[^}]*\}", "", text).split())


def child(element: XmlElement, name: str) -> XmlElement | None:
    """The child of a name such as ssd:Elements, if there is one."""
    return element.find(name, NAMESPACES)


def children(element: XmlElement, *path: str) -> Iterable[XmlElement]:
    """The children at the end of a path of names."""
    return element.iterfind("/".join(path), NAMESPACES)


def local_name(element: XmlElement) -> str:
    """A tag without its namespace."""
    return _etree().QName(element).localname


def read_units(root: XmlElement, owner: str, where: str) -> dict[str, SiUnit]:
    """The units that a document defines, by name; `owner` is the prefix of its own namespace.

    Raises CommandError, with `where`, for units that nothing can be converted to.
    """
    units = {}
    for definition in children(root, f"{owner}:Units", "ssc:Unit"):
        base: Any = child(definition, "ssc:BaseUnit")
        exponents = tuple(int(base.get(b, "0")) for b in BASE_UNITS)
        factor, offset = _finite(base, "factor", "1", where), _finite(base, "offset", "0", where)
        if factor == 0.0:
            raise CommandError(f"'{where}' line {base.sourceline} has a unit with the factor 0.")
        units[definition.get("name")] = SiUnit(definition.get("name"), exponents, factor, offset)
    return units


def read_unit(element: XmlElement, units: dict[str, SiUnit], where: str) -> SiUnit | None:
    """The unit that an element names; CommandError if the document does not define it."""
    name = element.get("unit")
    if name is None:
        return None
    if name not in units:
        raise CommandError(
            f"'{where}' line {element.sourceline} names the unit '{name}', which it does not define."
        )
    return units[name]


def _finite(element: XmlElement, attribute: str, default: str, where: str) -> float:
    """A number that is neither infinite nor NaN, as the schema would allow; CommandError otherwise."""
    value = float(element.get(attribute, default))
    if not math.isfinite(value):
        raise CommandError(f"'{where}' line {element.sourceline} has the {attribute} {value}.")
    return value


def read_transformation(element: XmlElement, where: str) -> Transformation | None:
    """The transformation inside a connection or a mapping entry; CommandError if it is not finite."""
    linear = child(element, "ssc:LinearTransformation")
    if linear is not None:
        return LinearTransformation(
            _finite(linear, "factor", "1", where), _finite(linear, "offset", "0", where)
        )
    for kind in _TABLES:
        table = child(element, f"ssc:{kind}MappingTransformation")
        if table is not None:
            one = {"Boolean": parse_boolean, "Integer": int, "Enumeration": str}[kind]
            entries = children(table, "ssc:MapEntry")
            return TableTransformation(
                kind, tuple((one(e.get("source")), one(e.get("target"))) for e in entries)
            )
    return None


def parse_boolean(text: str | None) -> bool:
    """A Boolean attribute, false without one."""
    return text is not None and text.strip() in ("true", "1")


def document(kind: str, more: dict[str, str] | None = None, /, **attributes: str | None) -> XmlElement:
    """The root of a new document, with all namespaces that it may need."""
    namespaces = {p: NAMESPACES[p] for p in ("ssd", "ssc", "ssv", "ssm")} | (more or {})
    root = _etree().Element(f"{{{NAMESPACES[kind]}}}{_KINDS[kind]}", nsmap=namespaces)
    _set(root, {"version": "1.0", **attributes})
    return root


def add(parent: XmlElement, tag: str, /, **attributes: str | None) -> XmlElement:
    """A new child with a tag such as ssd:Elements; attributes that are None are left out."""
    prefix, local = tag.split(":")
    namespace = parent.nsmap[prefix]
    element = _etree().SubElement(parent, f"{{{namespace}}}{local}")
    _set(element, attributes)
    return element


def _set(element: XmlElement, attributes: dict[str, str | None]) -> None:
    for name, value in attributes.items():
        if value is None:
            continue
        try:
            element.set(name, value)
        except ValueError as error:  # control characters, and halves of others
            raise CommandError(f"the {name} {value!r} has a character that XML cannot hold.") from error


def add_units(parent: XmlElement, owner: str, units: Iterable[SiUnit | None]) -> None:
    """Define the units, each once and in the order of their names."""
    named = {unit.name: unit for unit in units if unit is not None}
    if not named:
        return
    group = add(parent, f"{owner}:Units")
    for name in sorted(named):
        unit = named[name]
        base: dict[str, str | None] = {b: str(e) for b, e in unit.powers.items()}
        base |= {"factor": format_float(unit.factor)} if unit.factor != 1.0 else {}
        base |= {"offset": format_float(unit.offset)} if unit.offset != 0.0 else {}
        add(add(group, "ssc:Unit", name=name), "ssc:BaseUnit", **base)


def add_transformation(parent: XmlElement, transformation: Transformation | None) -> None:
    """The transformation inside a connection or a mapping entry."""
    if isinstance(transformation, LinearTransformation):
        factor, offset = transformation.factor, transformation.offset
        add(
            parent,
            "ssc:LinearTransformation",
            factor=format_float(factor),
            offset=format_float(offset) if offset else None,
        )
    elif transformation is not None:
        table = add(parent, f"ssc:{transformation.kind}MappingTransformation")
        for source, target in transformation.entries:
            add(table, "ssc:MapEntry", source=format_text(source), target=format_text(target))


def format_text(value: object) -> str:
    """A Boolean, a whole number or a text as XML has it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def format_float(value: float) -> str:
    """A number with the digits that bring it back."""
    return repr(float(value)).removesuffix(".0")


def to_bytes(root: XmlElement) -> bytes:
    """A document as a file."""
    etree = _etree()
    etree.cleanup_namespaces(root)
    etree.indent(root, space="  ")
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n"
