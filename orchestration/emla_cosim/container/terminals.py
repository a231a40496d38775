"""Terminals of the FMU of a system: those of its components whose variables the FMU has."""

from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element, SubElement

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from fmublock.description import format_xml

from ..base.untrusted_xml import parse_xml
from ..fmu.document import TERMINALS
from .plan import ContainerPlan, Library
from .variables import ContainerVariable


def write_terminals(plan: ContainerPlan, variables: Sequence[ContainerVariable]) -> bytes | None:
    """Return the file as UTF-8 XML, or None without terminals.

    Members keep their names, so that they connect with the terminals of other FMUs. The terminal `load` of
    the component `lift.plant` becomes `lift.plant.load`.
    """
    members = [dict(_read_members(library)) for library in plan.libraries]
    members_by_terminal: dict[str, dict[str, str]] = {}
    for variable in variables:
        part = plan.parts[variable.part]
        terminal_member = members[part.library].get(variable.origin.name)
        if terminal_member is not None and variable.causality in ("input", "output"):
            terminal, member = terminal_member
            members_by_terminal.setdefault(f"{part.name}.{terminal}", {}).setdefault(member, variable.name)
    if not members_by_terminal:
        return None
    root = Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    terminals = SubElement(root, "Terminals")
    for name, members_inside in members_by_terminal.items():
        terminal = SubElement(terminals, "Terminal", name=name, matchingRule="bus")
        for member, variable in members_inside.items():
            attributes = {"variableName": variable, "memberName": member, "variableKind": "signal"}
            SubElement(terminal, "TerminalMemberVariable", attributes)
    return format_xml(root)


def _read_members(library: Library) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield the variables in the terminals of an FMU, with the names of terminal and member.

    Terminals inside of others are left out, as are those whose members connect by their order: some may be
    missing outside.
    """
    content = library.content.get(TERMINALS)
    if content is None:
        return
    try:
        root = parse_xml(content)
    except etree.XMLSyntaxError:
        return  # terminals are optional, and the FMU runs without them
    for terminal in root.iterfind("Terminals/Terminal"):
        group = terminal.get("name")
        if terminal.get("matchingRule") != "bus" or not group:
            continue
        for member in terminal.iterfind("TerminalMemberVariable"):
            variable, name = member.get("variableName"), member.get("memberName")
            if variable and name and member.get("variableKind") == "signal":
                yield variable, (group, name)
