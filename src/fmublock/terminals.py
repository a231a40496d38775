"""terminalsAndIcons.xml: groups of inputs and outputs that are connected together.

FMI 2.0.4 adopts this file from FMI 3.0 (section 2.4.9 there).
"""

from xml.etree.ElementTree import Element, SubElement

from .block import Block
from .description import format_xml


def terminals_and_icons(block: Block, has_arrays: bool = False) -> bytes:
    """Return the file as UTF-8 XML. Terminals of the same name connect members of the same name.

    Args:
        block: The block.
        has_arrays: Whether the FMU's variables are arrays; otherwise they are their elements.
    """
    root = Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = SubElement(root, "GraphicalRepresentation")
    square = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    SubElement(graphics, "CoordinateSystem", square, suggestedScalingFactorTo_mm="0.1")
    SubElement(graphics, "Icon", square)
    groups: dict[str, list[tuple[str, str]]] = {}
    for scalar in block.layout().scalars:
        if scalar.variable.terminal is None or (has_arrays and any(scalar.index)):
            continue
        name = str(scalar.variable.name) if has_arrays else scalar.name
        terminal, _, member = scalar.variable.terminal.partition(".")
        groups.setdefault(terminal, []).append((member or name, name))
    if groups:
        terminals = SubElement(root, "Terminals")
        for group, members in groups.items():
            terminal = SubElement(terminals, "Terminal", name=group, matchingRule="bus")
            for member, variable in members:
                SubElement(
                    terminal,
                    "TerminalMemberVariable",
                    variableName=variable,
                    memberName=member,
                    variableKind="signal",
                )
    return format_xml(root)
