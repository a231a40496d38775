"""The variables of the FMU of a system, and its terminals."""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from fmpy.model_description import ModelVariable
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from fmublock.description import format_xml

from ..base.errors import CommandError
from ..base.untrusted_xml import parse_xml
from ..base.wording import select_names
from ..fmu.document import TERMINALS
from ..fmu.elements import ElementVariable
from .plan import ContainerPlan, Library

LETTERS = {"Real": "R", "Integer": "I", "Enumeration": "I", "Boolean": "B", "String": "S"}
"""The types of variables of FMI 2.0 as letters in C."""

_LETTERS_3 = {
    "Float64": "R",
    "Float32": "r",
    "Int8": "b",
    "UInt8": "c",
    "Int16": "s",
    "UInt16": "t",
    "Int32": "I",
    "UInt32": "u",
    "Int64": "E",
    "UInt64": "U",
    "Boolean": "B",
    "String": "S",
}
"""Those of FMI 3.0."""


def find_letter(variable: ModelVariable) -> str:
    """Return the type of a variable of a part as a letter in C; see shim/part_types.h."""
    if isinstance(variable, ElementVariable):
        return _LETTERS_3[variable.data_type]
    return LETTERS[str(variable.type)]


_HIDDEN = ("independent", "structuralParameter")
"""Causalities of variables that the FMU does not have: the sizes of its arrays are fixed."""


@dataclass(frozen=True)
class ContainerVariable:
    """A variable of the FMU, and the variable of the part that it represents.

    Attributes:
        name: its name in the system.
        part: position of the component.
        origin: the variable of the component's FMU.
        causality: input, output, parameter, calculatedParameter or local.
        start: its start value, None if it has none.
        is_overridden: whether the start value differs from that of the FMU.
        signal: position among the signals; -1 without one.
    """

    name: str
    part: int
    origin: ModelVariable
    causality: str
    start: Any
    is_overridden: bool
    signal: int

    def letter(self, fmi: int) -> str:
        """Return its type in C for a host of this version of FMI."""
        if fmi == 2:
            return LETTERS[str(self.origin.type)]
        return "E" if self.origin.type == "Enumeration" else find_letter(self.origin)

    @property
    def size(self) -> int:
        """Return the number of elements of its array; 1 for a scalar."""
        return self.origin.size if isinstance(self.origin, ElementVariable) else 1

    @property
    def variability(self) -> str:
        """Return its variability; that of an input that became a parameter is `tunable`."""
        if self.causality == "parameter" and self.origin.causality == "input":
            return "tunable"
        return str(self.origin.variability)

    @property
    def initial(self) -> str | None:
        """Return how it is initialized."""
        if self.causality == "input":
            return None
        return "exact" if self.causality == "parameter" else self.origin.initial or "calculated"

    @property
    def is_settable(self) -> bool:
        """Return whether a host may set it."""
        if self.variability == "constant":
            return False
        return self.causality in ("input", "parameter") or self.initial in ("exact", "approx")


def list_variables(
    plan: ContainerPlan, inputs: Collection[str], outputs: Collection[str], defaults: Sequence[str]
) -> list[ContainerVariable]:
    """Return all variables, in the order of the components.

    Args:
        plan: The system.
        inputs: Names or patterns of the inputs, among those that nothing drives. Default: all of these.
        outputs: Names or patterns of the outputs, among those of the components.
        defaults: The outputs without `outputs`. Default: all.

    Raises:
        CommandError: A name or pattern matches nothing, or two variables have one name.
    """
    variables = list[ContainerVariable]()
    names = plan.network.names
    for p, part in enumerate(plan.parts):
        driven = {v.name for v in part.instance.read}
        first = plan.network.parts[p].start
        signal_of = {v.name: first + k for k, v in enumerate(part.instance.written)}
        values = {v.name: value for v, value in part.starts}
        for origin in part.instance.file.variables.values():
            if origin.name in driven or origin.causality in _HIDDEN or origin.type not in LETTERS:
                continue
            signal = signal_of.get(origin.name, -1)
            system_name = plan.system_names[part.name].get(origin.name, origin.name)
            name = names[signal] if signal >= 0 else _make_full_name(part.name, system_name)
            # a start value of the system replaces that of the FMU
            start = values.get(origin.name, origin.start)
            variables.append(
                ContainerVariable(
                    name, p, origin, str(origin.causality), start, origin.name in values, signal
                )
            )
    duplicates = [name for name, count in Counter(v.name for v in variables).items() if count > 1]
    if duplicates:
        raise CommandError(
            f"two variables have the name '{duplicates[0]}'; rename a component.", name=duplicates[0]
        )
    open_inputs = [v.name for v in variables if v.causality == "input"]
    all_outputs = [v.name for v in variables if v.causality == "output"]
    selected = {
        *_select_names("input", inputs, open_inputs),
        *_select_names("output", outputs or defaults, all_outputs),
    }
    return [_hide_if_unselected(v, selected) for v in variables]


def choose_time_name(variables: Sequence[ContainerVariable]) -> str:
    """Return a name for the time, which is a variable in FMI 3.0, that no other variable has."""
    names, name = {v.name for v in variables}, "time"
    while name in names:
        name += "_"
    return name


def _make_full_name(part: str, name: str) -> str:
    """Return the name of a variable in the container; the derivative of a.x[1] is der(a.x[1])."""
    inner = re.fullmatch(r"der\((.*)\)(\[[\d,]+\])?", name)
    return f"{part}.{name}" if inner is None else f"der({part}.{inner[1]}{inner[2] or ''})"


def _hide_if_unselected(variable: ContainerVariable, selected: Collection[str]) -> ContainerVariable:
    """Return the variable; an output that is not selected becomes local, such an input a parameter."""
    if variable.causality not in ("input", "output") or variable.name in selected:
        return variable
    # a host can still set the input, as a tunable parameter
    causality = "local" if variable.causality == "output" else "parameter"
    return replace(variable, causality=causality)


def _select_names(kind: str, patterns: Collection[str], names: Sequence[str]) -> list[str]:
    """Return the names that match patterns, all without patterns. Raise CommandError if one matches none."""
    hint = "see `emla info` for the outputs."
    if kind == "input":
        hint = f"nothing drives {', '.join(names)}." if names else "every input is connected."
    selected = select_names(patterns, names, kind, hint=hint)
    return [name for name in names if not patterns or name in selected]


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
