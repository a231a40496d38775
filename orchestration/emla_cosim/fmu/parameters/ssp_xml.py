"""XML of the SSP standard: safe reading, checks against the standard's schemas, and writing."""

import math
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from ...base.errors import CommandError
from ...base.faults import accept_if_lenient, note_fault
from ...base.units import BASE_UNITS, SiUnit

XmlElement = Any

VERSION_1, VERSION_2 = "1.0", "2.0"
"""The versions of SSP."""

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
"""Namespaces of the annotations with the step size for OMSimulator and libcosim."""

OWN_NAMESPACE = {"emla": "urn:emla-cosim:system"}
SYSTEM = "emla-cosim.system"
"""The type of the annotation of an experiment with content that the standard does not define."""

RENAMES = "emla-cosim.renames"
"""The type of the annotation of a binding whose mapping also applies to results."""

CORNERS = ("x1", "y1", "x2", "y2")
"""The attributes of a rectangle."""

_KINDS = {
    "ssd": "SystemStructureDescription",
    "ssv": "ParameterSet",
    "ssm": "ParameterMapping",
}
_SCHEMAS = Path(__file__).parent / "schemas"
"""The standard's schemas, by version and namespace."""


@cache
def _import_etree() -> Any:
    """Return the XML library, imported on first use so that other commands start faster."""
    from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

    return etree


def parse(content: bytes, where: str, kind: str) -> XmlElement:
    """Parse a document and return its root; nothing is downloaded.

    Args:
        content: The content of the file.
        where: Its name in error messages.
        kind: ssd, ssv or ssm.

    Raises:
        CommandError: If the document does not follow the schema, or has a document type, which can define
            entities.
    """
    etree = _import_etree()
    # entities and external documents could read files or fill the memory
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True)
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise CommandError(f"'{where}' is not well-formed XML: {_shorten(str(error.msg))}.") from error
    if root.getroottree().docinfo.doctype:
        raise CommandError(f"'{where}' has a document type (<!DOCTYPE), which SSP does not allow.")
    check(root, where, kind)
    return root


def check(root: XmlElement, where: str, kind: str) -> None:
    """Check an element against the schema of the standard.

    Args:
        root: The root element.
        where: The name of its document in error messages.
        kind: ssd, ssv or ssm.

    Raises:
        CommandError: If it is not valid.
    """
    expected = f"{{{NAMESPACES[kind]}}}{_KINDS[kind]}"
    if root.tag != expected:
        namespace, _, name = str(root.tag).rpartition("}")
        if name == _KINDS[kind]:
            raise CommandError(
                f"the root {name} of '{where}' is in the namespace '{namespace[1:]}'; SSP has it in "
                f"'{NAMESPACES[kind]}'."
            )
        raise CommandError(
            f"'{where}' is not a {_KINDS[kind]} of SSP, but has the root '{_shorten(root.tag)}'."
        )
    version = root.get("version", "")
    schema = _load_schema(VERSION_2 if version.startswith("2.") else VERSION_1, kind)
    if not schema.validate(root):
        _check_faults(schema.error_log, where)


def _check_faults(errors: Iterable[Any], where: str) -> None:
    """Accept violations of the schema, or raise CommandError for the first one that is not accepted.

    Nothing can be read where an attribute or element is missing or has no valid value. Only additional ones
    and those in another order can be accepted.
    """
    for error in errors:
        text = f"line {error.line} is not valid SSP: {_shorten(error.message).rstrip('.')}"
        if "attribute 'generationDateAndTime'" in error.message:
            note_fault(where, text)
        elif any(part in error.message for part in ("is not allowed", "This element is not expected")):
            accept_if_lenient(where, text, f"'{where}' {text}")
        else:
            raise CommandError(f"'{where}' {text}.")


@cache
def _load_schema(version: str, kind: str) -> Any:
    etree = _import_etree()
    name = NAMESPACES[kind].rpartition("/")[2]
    return etree.XMLSchema(etree.parse(str(_SCHEMAS / version / f"{name}.xsd")))


def _shorten(text: str) -> str:
    """Return a message or tag in one line, without namespaces."""
    return " ".join(re.sub(r"\{[^}]*\}", "", text).split())


def child(element: XmlElement, name: str) -> XmlElement | None:
    """Return the child with a name such as ssd:Elements, or None."""
    return element.find(name, NAMESPACES)


def children(element: XmlElement, *path: str) -> Iterable[XmlElement]:
    """Return the children at the end of a path of names."""
    return element.iterfind("/".join(path), NAMESPACES)


def local_name(element: XmlElement) -> str:
    """Return a tag without its namespace."""
    return _import_etree().QName(element).localname


def read_units(root: XmlElement, owner: str, where: str) -> dict[str, SiUnit]:
    """Return the units that a document defines, by name.

    Args:
        root: The root element.
        owner: The prefix of the document's namespace.
        where: The name of the document in error messages.

    Raises:
        CommandError: If a unit has an invalid factor or offset.
    """
    units = {}
    for definition in children(root, f"{owner}:Units", "ssc:Unit"):
        base: Any = child(definition, "ssc:BaseUnit")
        exponents = tuple(int(base.get(b, "0")) for b in BASE_UNITS)
        factor, offset = read_finite(base, "factor", "1", where), read_finite(base, "offset", "0", where)
        if factor == 0.0:
            raise CommandError(
                f"'{where}' line {base.sourceline} has a unit with the factor 0; it must be another number."
            )
        units[definition.get("name")] = SiUnit(definition.get("name"), exponents, factor, offset)
    return units


def read_unit(element: XmlElement, units: dict[str, SiUnit], where: str) -> SiUnit | None:
    """Return the unit of an element, None without one.

    A unit that the document does not define has no exponents: values with it cannot be converted.

    Args:
        element: The element.
        units: The units of the document.
        where: The name of the document in the list of accepted faults.
    """
    name = element.get("unit")
    if name is None:
        return None
    if name not in units:
        note_fault(where, f"it names the unit '{name}', which it does not define")
    return units.get(name, SiUnit(name, definer=f"the Units of '{where}'") if name else None)


def read_finite(element: XmlElement, attribute: str, default: str, where: str) -> float:
    """Return a finite number; raise CommandError for infinity and NaN, which the schema allows."""
    value = float(element.get(attribute, default))
    if not math.isfinite(value):
        raise CommandError(
            f"'{where}' line {element.sourceline} has the {attribute} {value}; it must be finite."
        )
    return value


def parse_boolean(text: str | None) -> bool:
    """Return the value of a Boolean attribute; default: false."""
    return text is not None and text.strip() in ("true", "1")


def document(
    kind: str, version: str, more: dict[str, str] | None = None, /, **attributes: str | None
) -> XmlElement:
    """Return the root of a new document, with all namespaces that it can need.

    Args:
        kind: ssd, ssv or ssm.
        version: The version of SSP.
        more: Additional namespaces.
        **attributes: The attributes of the root; None leaves one out.
    """
    namespaces = {p: NAMESPACES[p] for p in ("ssd", "ssc", "ssv", "ssm")} | (more or {})
    root = _import_etree().Element(f"{{{NAMESPACES[kind]}}}{_KINDS[kind]}", nsmap=namespaces)
    _set_attributes(root, {"version": version, **attributes})
    return root


def add(parent: XmlElement, tag: str, /, **attributes: str | None) -> XmlElement:
    """Add a child element and return it.

    Args:
        parent: The parent element.
        tag: A name such as ssd:Elements.
        **attributes: Its attributes; None leaves one out.
    """
    prefix, local = tag.split(":")
    namespace = parent.nsmap[prefix]
    element = _import_etree().SubElement(parent, f"{{{namespace}}}{local}")
    _set_attributes(element, attributes)
    return element


def _set_attributes(element: XmlElement, attributes: dict[str, str | None]) -> None:
    """Set attributes, without those that are None. Raise CommandError for a text that XML cannot hold."""
    for name, value in attributes.items():
        if value is None:
            continue
        try:
            element.set(name, value)
        except ValueError as error:  # control characters and surrogates
            raise CommandError(f"the {name} {value!r} has a character that XML cannot hold.") from error


def add_units(parent: XmlElement, owner: str, units: Iterable[SiUnit | None]) -> None:
    """Add definitions of units, each once and sorted by name."""
    by_name = {unit.name: unit for unit in units if unit is not None}
    if not by_name:
        return
    group = add(parent, f"{owner}:Units")
    for name in sorted(by_name):
        unit = by_name[name]
        base: dict[str, str | None] = {b: str(e) for b, e in unit.powers.items()}
        base |= {"factor": format_float(unit.factor)} if unit.factor != 1.0 else {}
        base |= {"offset": format_float(unit.offset)} if unit.offset != 0.0 else {}
        add(add(group, "ssc:Unit", name=name), "ssc:BaseUnit", **base)


def format_text(value: object) -> str:
    """Return a Boolean, a whole number or a text in XML syntax."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def format_float(value: float) -> str:
    """Return a number with all digits needed to restore it."""
    return repr(float(value)).removesuffix(".0")


def to_bytes(root: XmlElement) -> bytes:
    """Return a document as the content of a file."""
    etree = _import_etree()
    etree.cleanup_namespaces(root)
    etree.indent(root, space="  ")
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n"
