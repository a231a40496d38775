"""What FMI-LS-BUS and FMI-LS-STRUCT demand of terminals."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

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
_ONCE = _bus("5.4.1", "The use of the same variable within different Bus Terminals is not allowed.")
_RX = _bus("5.3", "The Rx_Data variable is clocked by the Rx_Clock Clock, both with causality set to input.")
_TX = _bus("5.3", "The causality of the Tx_Data variable shall be output.")
_DATA = _bus(
    "5.3.3",
    "The Tx_Data/Rx_Data variables are of type fmi3Binary and may contain zero, one or multiple Bus "
    "Operations, as sent or received by the FMU.",
)
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
_AFTER = _struct(
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
_PAIRS = {"domainInput": "domain", "codomainOutput": "codomain"}
Member = tuple[str, DeclaredVariable]
"""Last part of the variableKind of a member of a map, and its variable."""


def _list_terminals(subject: Subject) -> list[Any]:
    path = subject.folder / TERMINALS
    try:
        root = parse_xml(path.read_bytes()) if path.is_file() else None
    except etree.XMLSyntaxError:  # `description.terminals` reports it
        return []
    return [] if root is None else list(root.iterfind("Terminals//Terminal"))


def _members(terminal: Any) -> list[Any]:
    return terminal.findall("TerminalMemberVariable")


def judge_buses(subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with the terminals of an FMU with the manifest of FMI-LS-BUS."""
    variables = {v.name: v for v in subject.declared.variables}
    terminals = _list_terminals(subject)
    networks = [t for t in terminals if t.get("terminalKind") == _NETWORK]
    if not networks:
        yield Breach(f"The FMU has no terminal of the kind {_NETWORK}.", _NETWORKS)
    used: dict[str, list[str]] = defaultdict(list)
    for network in networks:
        if network.get("matchingRule") != _TRANSCEIVER:
            continue
        found = {m.get("memberName"): m.get("variableName") for m in _members(network)}
        for name in found.values():
            used[name].append(network.get("name"))
        yield from _judge_transceiver(network.get("name"), found, variables)
    for name, names in used.items():
        if len(names) > 1:
            yield Breach(f"The bus terminals {names[0]} and {names[1]} both have {name}.", _ONCE)
    for terminal in terminals:
        kind, rule = terminal.get("terminalKind"), terminal.get("matchingRule")
        allowed = ("bus", _TRANSCEIVER) if kind == _NETWORK else ("bus",)
        if kind in (_NETWORK, _FRAME, _PDU, _CONFIGURATION) and rule not in allowed:
            what = f"The terminal {terminal.get('name')} has the matchingRule {rule}, not"
            yield Breach(f"{what} {' or '.join(allowed)}.", _RULE)


def _judge_transceiver(
    name: str, found: Mapping[str, str], variables: Mapping[str, DeclaredVariable]
) -> Iterator[Problem]:
    for member in ("Tx_Data", "Tx_Clock", "Rx_Data", "Rx_Clock"):
        if member not in found:
            yield Breach(f"The bus terminal {name} has no member {member}.", _MEMBERS)
        elif (variable := variables.get(found[member])) is not None:
            wanted = "Binary" if member.endswith("Data") else "Clock"
            if variable.type != wanted:
                what = f"{member} of the bus terminal {name} is of type {variable.type}, not {wanted}."
                yield Breach(what, _DATA if wanted == "Binary" else _RX)
            causality = {"Tx_Data": "output", "Tx_Clock": variable.causality}.get(member, "input")
            if variable.causality != causality:
                what = f"{member} of the bus terminal {name} has the causality {variable.causality}"
                yield Breach(f"{what}, not {causality}.", _TX if causality == "output" else _RX)


def judge_maps(subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with the terminals of an FMU with the manifest of FMI-LS-STRUCT."""
    variables = {v.name: v for v in subject.declared.variables}
    is_found = False
    for terminal in _list_terminals(subject):
        kind, name = terminal.get("terminalKind", ""), terminal.get("name")
        if not kind.startswith(STRUCT):
            continue
        is_found = True
        if kind not in (_GRID, _IRREGULAR):
            yield Breach(f"The terminal {name} has the unknown terminalKind {kind}.", _KINDS)
            continue
        members: list[Member] = []
        for member in _members(terminal):
            of, variable = member.get("variableKind", ""), variables.get(member.get("variableName"))
            if of.startswith(STRUCT) and of.removeprefix(_MAP) not in {*_PAIRS, *_PAIRS.values()}:
                what = f"{member.get('variableName')} of the terminal {name} has the variableKind {of}"
                yield Breach(f"{what}, which does not exist.", _KINDS)
            elif of.startswith(_MAP) and variable is not None:
                members.append((of.removeprefix(_MAP), variable))
        yield from _judge_map(name, members, kind == _GRID, subject)
    if not is_found:
        yield Breach(f"The FMU has no terminal of a kind of {STRUCT}.", _MAPS)


def _judge_map(name: str, members: Sequence[Member], is_grid: bool, subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with the order, types and sizes of the members of a map."""
    before: Member | None = None
    for kind, variable in members:
        if kind in _PAIRS and (before is None or before[0] != _PAIRS[kind]):
            yield Breach(f"{variable} in the map {name} does not follow a {_PAIRS[kind]}.", _AFTER)
        elif kind in _PAIRS and before is not None and before[1].type != variable.type:
            what = f"{variable} in the map {name} is of type {variable.type}, but {before[1]} is of type"
            yield Breach(f"{what} {before[1].type}.", _SAME_TYPE)
        before = kind, variable
    shapes = {v.index: list(subject.declared.sizes(v)) for _, v in members}
    domains = [v for kind, v in members if kind == "domain"]
    for domain in domains:
        if len(domain.dimensions) != 1:
            what = f"{domain} has {len(domain.dimensions)} dimensions, but is a domain of the map {name}."
            yield Breach(what, _DOMAIN)
            return
    lengths = [shapes[v.index][0] for v in domains]
    for codomain in (v for kind, v in members if kind == "codomain"):
        wanted = lengths if is_grid else lengths[:1]
        pairs = zip(shapes[codomain.index], wanted, strict=False)
        is_other = any(None not in pair and pair[0] != pair[1] for pair in pairs)
        if is_other or len(shapes[codomain.index]) != len(wanted):
            has = " x ".join(map(str, shapes[codomain.index])) or "1"
            what = f"{codomain} of the map {name} has the size {has}, but its domains have"
            yield Breach(f"{what} {', '.join(map(str, lengths))}.", _SHAPE if is_grid else _POINTS)
