"""XML of the SSP standard: read with care, checked against the standard's schemas, written tidily."""

import re
from collections.abc import Iterable
from functools import cache
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from ..errors import CommandError
from ..units import BASE_UNITS, LinearTransformation, Unit
from .structure import TableTransformation, Transformation

XmlElement = Any

_ROOT = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = {
    "ssd": f"{_ROOT}Description",
    "ssc": f"{_ROOT}Common",
    "ssv": f"{_ROOT}ParameterValues",
    "ssm": f"{_ROOT}ParameterMapping",
}
_KINDS = {
    "ssd": "SystemStructureDescription",
    "ssv": "ParameterSet",
    "ssm": "ParameterMapping",
}
_TABLES = ("Boolean", "Integer", "Enumeration")


def parse(content: bytes, where: str, kind: str) -> XmlElement:
    """The root of a document of one kind: ssd, ssv or ssm.

    Entities are left alone and nothing is fetched. Raises CommandError, with `where`, for what is
    no such document by the standard's schema.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True)
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise CommandError(f"'{where}' is not well-formed XML: {error.msg}.") from error
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
    schema = _schema(f"{kind}2" if version.startswith("2.") else kind)
    if not schema.validate(root):
        first = schema.error_log[0]
        raise CommandError(f"'{where}' line {first.line} is not valid SSP: {_short(first.message)}")


@cache
def _schema(key: str) -> Any:
    from pyssp_standard.standard import ModelicaStandard  # takes a while

    return etree.XMLSchema(etree.parse(str(ModelicaStandard.schemas[key])))


def _short(text: str) -> str:
    """A message or tag without namespaces."""
    return re.sub(r"\{[^}]*\}", "", text)


def child(element: XmlElement, name: str) -> XmlElement | None:
    """The child of a name such as ssd:Elements, if there is one."""
    return element.find(name, NAMESPACES)


def children(element: XmlElement, *path: str) -> Iterable[XmlElement]:
    """The children at the end of a path of names."""
    return element.iterfind("/".join(path), NAMESPACES)


def local_name(element: XmlElement) -> str:
    """A tag without its namespace."""
    return etree.QName(element).localname


def read_units(root: XmlElement, owner: str) -> dict[str, Unit]:
    """The units that a document defines, by name; `owner` is the prefix of its own namespace."""
    units = {}
    for definition in children(root, f"{owner}:Units", "ssc:Unit"):
        base: Any = child(definition, "ssc:BaseUnit")
        exponents = tuple(int(base.get(b, "0")) for b in BASE_UNITS)
        factor, offset = float(base.get("factor", "1")), float(base.get("offset", "0"))
        units[definition.get("name")] = Unit(definition.get("name"), exponents, factor, offset)
    return units


def read_unit(element: XmlElement, units: dict[str, Unit], where: str) -> Unit | None:
    """The unit that an element names; CommandError if the document does not define it."""
    name = element.get("unit")
    if name is None:
        return None
    if name not in units:
        raise CommandError(
            f"'{where}' line {element.sourceline} names the unit '{name}', which it does not define."
        )
    return units[name]


def read_transformation(element: XmlElement) -> Transformation | None:
    """The transformation inside a connection or a mapping entry."""
    linear = child(element, "ssc:LinearTransformation")
    if linear is not None:
        return LinearTransformation(float(linear.get("factor", "1")), float(linear.get("offset", "0")))
    for kind in _TABLES:
        table = child(element, f"ssc:{kind}MappingTransformation")
        if table is not None:
            entries = tuple((e.get("source"), e.get("target")) for e in children(table, "ssc:MapEntry"))
            return TableTransformation(kind, entries)
    return None


def boolean(text: str | None) -> bool:
    """A Boolean attribute, false without one."""
    return text in ("true", "1")


def document(kind: str, more: dict[str, str] | None = None, /, **attributes: str | None) -> XmlElement:
    """The root of a new document, with all namespaces that it may need."""
    namespaces = {p: NAMESPACES[p] for p in ("ssd", "ssc", "ssv", "ssm")} | (more or {})
    root = etree.Element(f"{{{NAMESPACES[kind]}}}{_KINDS[kind]}", nsmap=namespaces)
    _set(root, {"version": "1.0", **attributes})
    return root


def add(parent: XmlElement, tag: str, /, **attributes: str | None) -> XmlElement:
    """A new child with a tag such as ssd:Elements; attributes that are None are left out."""
    prefix, local = tag.split(":")
    namespace = parent.nsmap[prefix]
    element = etree.SubElement(parent, f"{{{namespace}}}{local}")
    _set(element, attributes)
    return element


def _set(element: XmlElement, attributes: dict[str, str | None]) -> None:
    for name, value in attributes.items():
        if value is not None:
            element.set(name, value)


def add_units(parent: XmlElement, owner: str, units: Iterable[Unit | None]) -> None:
    """Define the units, each once and in the order of their names."""
    named = {unit.name: unit for unit in units if unit is not None}
    if not named:
        return
    group = add(parent, f"{owner}:Units")
    for name in sorted(named):
        unit = named[name]
        exponents = dict(zip(BASE_UNITS, unit.exponents or (), strict=False))
        base: dict[str, str | None] = {b: str(e) for b, e in exponents.items() if e}
        base |= {"factor": number(unit.factor)} if unit.factor != 1.0 else {}
        base |= {"offset": number(unit.offset)} if unit.offset != 0.0 else {}
        add(add(group, "ssc:Unit", name=name), "ssc:BaseUnit", **base)


def add_transformation(parent: XmlElement, transformation: Transformation | None) -> None:
    """The transformation inside a connection or a mapping entry."""
    if isinstance(transformation, LinearTransformation):
        factor, offset = transformation.factor, transformation.offset
        add(
            parent,
            "ssc:LinearTransformation",
            factor=number(factor),
            offset=number(offset) if offset else None,
        )
    elif transformation is not None:
        table = add(parent, f"ssc:{transformation.kind}MappingTransformation")
        for source, target in transformation.entries:
            add(table, "ssc:MapEntry", source=source, target=target)


def number(value: float) -> str:
    """A number with the digits that bring it back."""
    return repr(float(value)).removesuffix(".0")


def to_bytes(root: XmlElement) -> bytes:
    """A document as a file."""
    etree.cleanup_namespaces(root)
    etree.indent(root, space="  ")
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n"
