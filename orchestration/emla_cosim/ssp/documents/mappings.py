"""Parameter mappings (SSM), and the transformations of values: reading and writing of XML."""

from collections.abc import Iterable

from ...base.errors import CommandError
from ...base.units import LinearTransformation
from ...fmu.parameters.ssp_xml import (
    VERSION_1,
    XmlElement,
    add,
    child,
    children,
    document,
    format_float,
    format_text,
    parse,
    parse_boolean,
    read_finite,
    to_bytes,
)
from .ssd_data import MappingEntry, TableTransformation, Transformation

_TABLES = ("Boolean", "Integer", "Enumeration")


def parse_mapping(content: bytes, where: str) -> tuple[MappingEntry, ...]:
    """Parse an SSM file.

    Args:
        content: The content of the file.
        where: Its name in error messages.

    Raises:
        CommandError: If it is not a valid SSM.
    """
    return read_mapping(parse(content, where, "ssm"), where)


def read_mapping(root: XmlElement, where: str) -> tuple[MappingEntry, ...]:
    """Read a ParameterMapping element.

    Args:
        root: The element.
        where: The name of its document in error messages.

    Raises:
        CommandError: If two entries have the same target.
    """
    entries: dict[str, MappingEntry] = {}
    for element in children(root, "ssm:MappingEntry"):
        source, target = element.get("source"), element.get("target")
        if target in entries:  # which of two values it gets would depend on the tool
            raise CommandError(
                f"'{where}' line {element.sourceline} maps '{source}' to '{target}', which is already the "
                f"target of '{entries[target].source}'."
            )
        suppress = parse_boolean(element.get("suppressUnitConversion"))
        entries[target] = MappingEntry(source, target, read_transformation(element, where), suppress)
    return tuple(entries.values())


def add_mapping(root: XmlElement, entries: Iterable[MappingEntry]) -> None:
    """Write mapping entries to a ParameterMapping element."""
    for entry in entries:
        suppress = "true" if entry.suppress_unit_conversion else None
        element = add(
            root,
            "ssm:MappingEntry",
            source=entry.source,
            target=entry.target,
            suppressUnitConversion=suppress,
        )
        add_transformation(element, entry.transformation)


def format_mapping(entries: Iterable[MappingEntry], version: str = VERSION_1) -> bytes:
    """Return mapping entries as an SSM file of a version of SSP."""
    root = document("ssm", version)
    add_mapping(root, entries)
    return to_bytes(root)


def read_transformation(element: XmlElement, where: str) -> Transformation | None:
    """Return the transformation of a connection or mapping entry, None without one.

    Raises:
        CommandError: If a number is not finite.
    """
    linear = child(element, "ssc:LinearTransformation")
    if linear is not None:
        return LinearTransformation(
            read_finite(linear, "factor", "1", where), read_finite(linear, "offset", "0", where)
        )
    for kind in _TABLES:
        table = child(element, f"ssc:{kind}MappingTransformation")
        if table is not None:
            convert = {"Boolean": parse_boolean, "Integer": int, "Enumeration": str}[kind]
            entries = children(table, "ssc:MapEntry")
            return TableTransformation(
                kind, tuple((convert(e.get("source")), convert(e.get("target"))) for e in entries)
            )
    return None


def add_transformation(parent: XmlElement, transformation: Transformation | None) -> None:
    """Add the transformation of a connection or mapping entry."""
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
