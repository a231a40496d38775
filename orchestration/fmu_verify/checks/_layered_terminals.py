"""What FMI-LS-BUS and FMI-LS-STRUCT demand of terminals."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from emla_cosim.base.untrusted_xml import parse_xml
from emla_cosim.fmu.document import TERMINALS

from ..declarations import DeclaredVariable
from ..layered_manifest import STRUCT
from ..messages import Breach, Problem
from ..subject import Subject
from ..verdict import Clause

_bus = partial(Clause, document="FMI-LS-BUS 1.3.0-beta.1")
_struct = partial(Clause, document="FMI-LS-STRUCT 1.0.0-rc.1")

_NETWORK, _FRAME, _PDU = (f"org.fmi-ls-bus.{kind}-terminal" for kind in ("network", "frame", "pdu"))
_CONFIGURATION = f"{_NETWORK}.configuration"
_TRANSCEIVER = "org.fmi-ls-bus.transceiver"
_NETWORKS = _bus(
    "5.4.1",
    "Each network connected to the FMU must be described in terminalsAndIcons/terminalsAndIcons.xml as a "
    "<Terminal> element of <fmiTerminalsAndIcons><Terminals>.",
)
_MEMBERS = _bus(
    "5.4.1",
    "A Bus Terminal shall contain four <TerminalMemberVariable> elements with the following memberName "
    "attributes: Tx_Data, Tx_Clock, Rx_Data and Rx_Clock.",
)
_USED_ONCE = _bus("5.4.1", "The use of the same variable within different Bus Terminals is not allowed.")
_RX = _bus("5.3", "The Rx_Data variable is clocked by the Rx_Clock Clock, both with causality set to input.")
_TX = _bus("5.3", "The causality of the Tx_Data variable shall be output.")
_DATA = _bus(
    "5.3.3",
    "The Tx_Data/Rx_Data variables are of type fmi3Binary and may contain zero, one or multiple Bus "
    "Operations, as sent or received by the FMU.",
)
_MIME = _bus(
    "5.3.3",
    "The following table lists the MIME types to use for the Tx/Rx data variables within a Bus Terminal:",
)
_BUS_TYPE = re.compile(r"application/org\.fmi-standard\.fmi-ls-bus\.(\w+) *(;.*)?")
_CLOCKED = {"Rx": _RX, "Tx": _bus("5.3", "The Tx_Data variable is clocked by the Tx_Clock Clock.")}
_RULE = _bus("4.5.1", "matchingRule must be bus.")

_MAP = f"{STRUCT}.map."
_GRID, _IRREGULAR = f"{_MAP}rectilinearGrid", f"{_MAP}irregular"
_KINDS = _struct(
    "3.1.2",
    "Additional terminal member variables can be added to the terminal as related variables but if they do "
    "not fit into one of the above categories, they shall not have a variableKind starting with "
    "org.fmi-standard.fmi-ls-struct.",
)
_MAPS = _struct(
    "2",
    "The manifest file signals to the importer that the FMU supports this layered standard and enables the "
    "interpretation of the TerminalsAndIcons.xml file in the intended way.",
)
_ORDER = _struct(
    "3.1.2",
    "If present, this variable must be listed directly after the corresponding domain variable.",
)
_SAME_TYPE = _struct(
    "3.1.2",
    "The data type of a domainInput variable shall be identical to the data type of the corresponding domain "
    "variable.",
)
_SHAPE = _struct(
    "4.1",
    "The length of the i-th domain vector must be equal to length of the i-th codomain dimension.",
)
_POINTS = _struct(
    "5.1",
    "For each of the m dimensions of the codomain of the lookup table, a 1-dimensional array variable "
    "containing the sampling values of the lookup table must be referenced",
)
_DOMAIN = _struct(
    "3.1.2",
    "For each of the n dimensions of the domain set, a 1-dimensional array variable containing the "
    "coordinates (along this dimension) is provided.",
)
_VALUES = _struct(
    "3.1.2",
    "For each of the represented points in the domain set, the values to which they are mapped are provided.",
)
_MATCHING = _struct(
    "3.1.3",
    "The matching rule org.fmi-standard.fmi-ls-struct.map should be used for terminals that represent maps.",
)
_CAUSALITIES = {
    "domainInput": (
        ("input", "output", "local"),
        _struct("3.1.2", "The causality of such a variable can be input, output or local"),
    ),
    "codomainOutput": (
        ("output", "local"),
        _struct(
            "3.1.2",
            "The causality of such a variable can be output or local, since it represents a value computed "
            "from the map and cannot be driven from outside the FMU.",
        ),
    ),
}
_PAIRS = {"domainInput": "domain", "codomainOutput": "codomain"}
Member = tuple[str, DeclaredVariable]
"""Last part of the variableKind of a member of a map, and its variable."""


def _list_terminals(subject: Subject) -> list[Any]:
    path = subject.folder / TERMINALS
    try:
        root = parse_xml(path.read_bytes()) if path.is_file() else None
    except SyntaxError:  # `description.terminals` reports it
        return []
    return [] if root is None else list(root.iterfind("Terminals//Terminal"))


def _list_members(terminal: Any) -> list[Any]:
    return terminal.findall("TerminalMemberVariable")


def judge_buses(subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with the terminals of an FMU with the manifest of FMI-LS-BUS."""
    variables = {v.name: v for v in subject.declared.variables}
    terminals = _list_terminals(subject)
    networks = [t for t in terminals if t.get("terminalKind") == _NETWORK]
    if not networks:
        yield Breach(f"The FMU has no terminal of the kind {_NETWORK}.", _NETWORKS)
    terminals_by_variable: dict[str, list[str]] = defaultdict(list)
    for network in networks:
        if network.get("matchingRule") != _TRANSCEIVER:
            continue
        variable_names = {m.get("memberName"): m.get("variableName") for m in _list_members(network)}
        for name in variable_names.values():
            terminals_by_variable[name].append(network.get("name"))
        yield from _judge_transceiver(network.get("name"), variable_names, variables)
    for name, names in terminals_by_variable.items():
        if len(names) > 1:
            yield Breach(f"The bus terminals {names[0]} and {names[1]} both have {name}.", _USED_ONCE)
    for terminal in terminals:
        kind, rule = terminal.get("terminalKind"), terminal.get("matchingRule")
        allowed = ("bus", _TRANSCEIVER) if kind == _NETWORK else ("bus",)
        if kind in (_NETWORK, _FRAME, _PDU, _CONFIGURATION) and rule not in allowed:
            message = f"The terminal {terminal.get('name')} has the matchingRule {rule}, not"
            yield Breach(f"{message} {' or '.join(allowed)}.", _RULE)


def _judge_transceiver(
    name: str, variable_names: Mapping[str, str], variables: Mapping[str, DeclaredVariable]
) -> Iterator[Problem]:
    for member in ("Tx_Data", "Tx_Clock", "Rx_Data", "Rx_Clock"):
        if member not in variable_names:
            yield Breach(f"The bus terminal {name} has no member {member}.", _MEMBERS)
        elif (variable := variables.get(variable_names[member])) is not None:
            expected = "Binary" if member.endswith("Data") else "Clock"
            if variable.type != expected:
                message = f"{member} of the bus terminal {name} is of type {variable.type}, not {expected}."
                yield Breach(message, _DATA if expected == "Binary" else _RX)
            causality = {"Tx_Data": "output", "Tx_Clock": variable.causality}.get(member, "input")
            if variable.causality != causality:
                message = f"{member} of the bus terminal {name} has the causality {variable.causality}"
                yield Breach(f"{message}, not {causality}.", _TX if causality == "output" else _RX)
    binaries = [
        v for way in _CLOCKED if (v := variables.get(variable_names.get(f"{way}_Data", ""))) is not None
    ]
    types = [v.attributes.get("mimeType", "application/octet-stream") for v in binaries if v.type == "Binary"]
    buses = [match[1] for type_ in types if (match := _BUS_TYPE.fullmatch(type_))]
    if len(buses) < len(types):
        wrong_type = next(type_ for type_ in types if not _BUS_TYPE.fullmatch(type_))
        yield Breach(
            f"Data of the bus terminal {name} have the mimeType {wrong_type}, which is of no bus.", _MIME
        )
    elif len(set(buses)) > 1:
        yield Breach(f"Data of the bus terminal {name} have the mimeTypes of {' and '.join(buses)}.", _MIME)
    for way, clause in _CLOCKED.items():
        data, clock = (variables.get(variable_names.get(f"{way}_{of}", "")) for of in ("Data", "Clock"))
        if data is not None and clock is not None and clock.index not in (data.clocks or ()):
            message = f"{way}_Data of the bus terminal {name}, {data}, does not belong to its Clock {clock}."
            yield Breach(message, clause)


def judge_maps(subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with the terminals of an FMU with the manifest of FMI-LS-STRUCT."""
    variables = {v.name: v for v in subject.declared.variables}
    has_map = False
    for terminal in _list_terminals(subject):
        kind, name = terminal.get("terminalKind", ""), terminal.get("name")
        if not kind.startswith(STRUCT):
            continue
        has_map = True
        if kind not in (_GRID, _IRREGULAR):
            yield Breach(f"The terminal {name} has the unknown terminalKind {kind}.", _KINDS)
            continue
        members: list[Member] = []
        for member in _list_members(terminal):
            member_kind, variable = member.get("variableKind", ""), variables.get(member.get("variableName"))
            allowed = {*_PAIRS, *_PAIRS.values()}
            if member_kind.startswith(STRUCT) and member_kind.removeprefix(_MAP) not in allowed:
                message = (
                    f"{member.get('variableName')} of the terminal {name} has the variableKind {member_kind}"
                )
                yield Breach(f"{message}, which does not exist.", _KINDS)
            elif member_kind.startswith(_MAP) and variable is not None:
                members.append((member_kind.removeprefix(_MAP), variable))
        yield from _judge_map(name, members, kind == _GRID, subject)
    if not has_map:
        yield Breach(f"The FMU has no terminal of a kind of {STRUCT}.", _MAPS)


def doubt_maps(subject: Subject) -> Iterator[Problem]:
    """Yield terminals of maps with a matching rule that is not the recommended one."""
    rule = _MAP.removesuffix(".")
    for terminal in _list_terminals(subject):
        if terminal.get("terminalKind") in (_GRID, _IRREGULAR) and terminal.get("matchingRule") != rule:
            message = f"The map {terminal.get('name')} has the matchingRule {terminal.get('matchingRule')}"
            yield Breach(f"{message}, not {rule}.", _MATCHING)


def _judge_map(name: str, members: Sequence[Member], is_grid: bool, subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with the order, types and sizes of the members of a map."""
    for required, clause in (("domain", _DOMAIN), ("codomain", _VALUES)):
        if all(kind != required for kind, _ in members):
            yield Breach(f"The map {name} has no member of the variableKind {_MAP}{required}.", clause)
    previous: Member | None = None
    for kind, variable in members:
        causalities, clause = _CAUSALITIES.get(kind, ((variable.causality,), _KINDS))
        if variable.causality not in causalities:
            message = f"{variable} in the map {name} is a {kind}, but has the causality {variable.causality}."
            yield Breach(message, clause)
        if kind in _PAIRS and (previous is None or previous[0] != _PAIRS[kind]):
            yield Breach(f"{variable} in the map {name} does not follow a {_PAIRS[kind]}.", _ORDER)
        elif kind in _PAIRS and previous is not None and previous[1].type != variable.type:
            message = f"{variable} in the map {name} is of type {variable.type}, but {previous[1]} is of type"
            yield Breach(f"{message} {previous[1].type}.", _SAME_TYPE)
        previous = kind, variable
    shapes = {v.index: list(subject.declared.sizes(v)) for _, v in members}
    domains = [v for kind, v in members if kind == "domain"]
    for domain in domains:
        if len(domain.dimensions) != 1:
            message = f"{domain} has {len(domain.dimensions)} dimensions, but is a domain of the map {name}."
            yield Breach(message, _DOMAIN)
            return
    lengths = [shapes[v.index][0] for v in domains]
    for codomain in (v for kind, v in members if kind == "codomain"):
        expected = lengths if is_grid else lengths[:1]
        pairs = zip(shapes[codomain.index], expected, strict=False)
        is_other = any(None not in pair and pair[0] != pair[1] for pair in pairs)
        if is_other or len(shapes[codomain.index]) != len(expected):
            has = " x ".join(map(str, shapes[codomain.index])) or "1"
            message = f"{codomain} of the map {name} has the size {has}, but its domains have"
            yield Breach(f"{message} {', '.join(map(str, lengths))}.", _SHAPE if is_grid else _POINTS)
