"""terminalsAndIcons.xml: groups of inputs and outputs that are connected together.

FMI 2.0.4 adopts this file from FMI 3.0 (section 2.4.9 there).
"""

from xml.etree.ElementTree import Element, SubElement

from .block import Block
from .description import format_xml
from .variables import ScalarVariable


def terminals_and_icons(block: Block) -> bytes:
    """Return the file as UTF-8 XML. Terminals of the same name connect members of the same name."""
    root = Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = SubElement(root, "GraphicalRepresentation")
    square = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    SubElement(graphics, "CoordinateSystem", square, suggestedScalingFactorTo_mm="0.1")
    SubElement(graphics, "Icon", square)
    groups: dict[str, list[tuple[str, ScalarVariable]]] = {}
    for scalar in block.layout().scalars:
        if scalar.variable.terminal is not None:
            terminal, _, member = scalar.variable.terminal.partition(".")
            groups.setdefault(terminal, []).append((member or scalar.name, scalar))
    if groups:
        terminals = SubElement(root, "Terminals")
        for name, members in groups.items():
            terminal = SubElement(terminals, "Terminal", name=name, matchingRule="bus")
            for member, scalar in members:
                SubElement(
                    terminal,
                    "TerminalMemberVariable",
                    variableName=scalar.name,
                    memberName=member,
                    variableKind="signal",
                )
    return format_xml(root)
