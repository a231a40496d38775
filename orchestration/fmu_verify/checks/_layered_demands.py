"""What FMI-LS-BUS, FMI-LS-STRUCT and FMI-LS-XCP demand of terminals, files and variables."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from emla_cosim.base.untrusted_xml import parse_xml
from emla_cosim.fmu.document import TERMINALS

from ..check import quote
from ..declarations import DeclaredVariable, find_repeated
from ..layered_manifest import STRUCT, XCP_ROLES, LayeredManifest
from ..libraries import list_platforms
from ..messages import Breach, Problem
from ..subject import Subject

_NETWORK, _FRAME, _PDU = (f"org.fmi-ls-bus.{kind}-terminal" for kind in ("network", "frame", "pdu"))
_CONFIGURATION = f"{_NETWORK}.configuration"
_TRANSCEIVER = "org.fmi-ls-bus.transceiver"
_USED_ONCE = quote("bus.used_once")
_RX = quote("bus.rx")
_TX = quote("bus.tx")
_MIME = quote("bus.mime")
_BUS_TYPE = re.compile(r"application/org\.fmi-standard\.fmi-ls-bus\.(\w+) *(;.*)?")
_CLOCKED = {"Rx": _RX, "Tx": quote("bus.tx_clock")}

_MAP = f"{STRUCT}.map."
_GRID, _IRREGULAR = f"{_MAP}rectilinearGrid", f"{_MAP}irregular"
_KINDS = quote("struct.kinds")
_ORDER = quote("struct.order")
_SHAPE = quote("struct.shape")
_POINTS = quote("struct.points")
_DOMAIN = quote("struct.domain")
_CAUSALITIES = {
    "domainInput": (("input", "output", "local"), quote("struct.domain_input")),
    "codomainOutput": (("output", "local"), quote("struct.codomain_output")),
}
_PAIRS = {"domainInput": "domain", "codomainOutput": "codomain"}
Member = tuple[str, DeclaredVariable]
"""Last part of the variableKind of a member of a map, and its variable."""


def _list_terminals(subject: Subject) -> list[Any]:
    """Return all terminals, also inner ones; none if there is no description of them, or it is not XML."""
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
        yield Breach(f"The FMU has no terminal of the kind {_NETWORK}.", quote("bus.networks"))
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
            yield Breach(f"{message} {' or '.join(allowed)}.", quote("bus.rule"))


def _judge_transceiver(
    name: str, variable_names: Mapping[str, str], variables: Mapping[str, DeclaredVariable]
) -> Iterator[Problem]:
    """Yield what is wrong with a bus terminal; `variable_names` has its variables by member."""
    for member in ("Tx_Data", "Tx_Clock", "Rx_Data", "Rx_Clock"):
        if member not in variable_names:
            yield Breach(f"The bus terminal {name} has no member {member}.", quote("bus.members"))
        elif (variable := variables.get(variable_names[member])) is not None:
            expected = "Binary" if member.endswith("Data") else "Clock"
            if variable.type != expected:
                message = f"{member} of the bus terminal {name} is of type {variable.type}, not {expected}."
                yield Breach(message, quote("bus.data") if expected == "Binary" else _RX)
            causality = {"Tx_Data": "output", "Tx_Clock": variable.causality}.get(member, "input")
            if variable.causality != causality:
                message = f"{member} of the bus terminal {name} has the causality {variable.causality}"
                yield Breach(f"{message}, not {causality}.", _TX if causality == "output" else _RX)
    binaries = [v for way in _CLOCKED if (v := variables.get(variable_names.get(f"{way}_Data", "")))]
    types = [v.attributes.get("mimeType", "application/octet-stream") for v in binaries if v.type == "Binary"]
    buses = [match[1] for type_ in types if (match := _BUS_TYPE.fullmatch(type_))]
    if len(buses) < len(types):
        wrong_type = next(type_ for type_ in types if not _BUS_TYPE.fullmatch(type_))
        message = f"Data of the bus terminal {name} have the mimeType {wrong_type}, which is of no bus."
        yield Breach(message, _MIME)
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
            member_kind, label = member.get("variableKind", ""), member.get("variableName")
            allowed, variable = {*_PAIRS, *_PAIRS.values()}, variables.get(label)
            if member_kind.startswith(STRUCT) and member_kind.removeprefix(_MAP) not in allowed:
                message = f"{label} of the terminal {name} has the variableKind {member_kind}"
                yield Breach(f"{message}, which does not exist.", _KINDS)
            elif member_kind.startswith(_MAP) and variable is not None:
                members.append((member_kind.removeprefix(_MAP), variable))
        yield from _judge_map(name, members, kind == _GRID, subject)
    if not has_map:
        yield Breach(f"The FMU has no terminal of a kind of {STRUCT}.", quote("struct.maps"))


def list_unusual_matching_rules(subject: Subject) -> Iterator[Problem]:
    """Yield terminals of maps with a matching rule that is not the recommended one."""
    rule = _MAP.removesuffix(".")
    for terminal in _list_terminals(subject):
        if terminal.get("terminalKind") in (_GRID, _IRREGULAR) and terminal.get("matchingRule") != rule:
            message = f"The map {terminal.get('name')} has the matchingRule {terminal.get('matchingRule')}"
            yield Breach(f"{message}, not {rule}.", quote("struct.matching"))


def _judge_map(name: str, members: Sequence[Member], is_grid: bool, subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with the order, types and sizes of the members of a map."""
    for required, clause in (("domain", _DOMAIN), ("codomain", quote("struct.values"))):
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
            yield Breach(f"{message} {previous[1].type}.", quote("struct.same_type"))
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


_DEFINITION = quote("xcp.definition")
_VALID = quote("xcp.valid")
_SINGLE_FILE = quote("xcp.single_file")
_INCLUDE = re.compile(rb"^[ \t]*/include\b", re.MULTILINE | re.IGNORECASE)
_ALLOWED = quote("xcp.allowed")
_COMBINATIONS = {
    ("structuralParameter", "fixed"),
    ("parameter", "fixed"),
    ("output", "constant"),
    ("calculatedParameter", "fixed"),
    ("calculatedParameter", "tunable"),
}


def judge_xcp(manifest: LayeredManifest, subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with the interfaces of the manifest of FMI-LS-XCP."""
    interfaces = list(manifest.root.iter("{*}Interface"))
    for interface in interfaces:
        yield from _judge_xcp_interface(interface, manifest.path.parent, subject)
    names = [e.get("name") for e in manifest.root.iter("{*}Variable")]
    for name in find_repeated(names):
        yield Breach(f"{manifest.label} has more than one Variable {name}.", quote("xcp.variable_once"))
    by_name = {name: v for v in subject.declared.variables for name in (v.name, *v.aliases)}
    for element in manifest.root.iter("{*}Variable"):
        yield from _judge_xcp_variable(element, by_name.get(element.get("name")))


def _judge_xcp_interface(interface: Any, folder: Path, subject: Subject) -> Iterator[Problem]:
    """Yield what is wrong with an interface: its A2L files, flags, types and roles."""
    definition = interface.get("definition")
    who = f"The interface {definition}"
    parts = unquote(definition).split("/")
    if urlsplit(definition).scheme or definition.startswith("/") or {".", ".."}.intersection(parts):
        yield Breach(f"{who} must have a relative path without . and .. as its definition.", _DEFINITION)
    else:
        targets = [folder, *(folder / path.name for path in list_platforms(subject))]
        files = [file for target in targets if (file := target.joinpath(*parts)).is_file()]
        if not files:
            yield Breach(f"{who} has no such file, also not in the folder of a platform.", _VALID)
        for file in files:
            if _INCLUDE.search(file.read_bytes()):
                message = f"{file.relative_to(folder).as_posix()} includes another A2L file."
                yield Breach(message, _SINGLE_FILE)
    flags = ("containsXCPService", "supportsDirectMemoryAccess")
    if not any(interface.get(flag) in ("true", "1") for flag in flags):
        yield Breach(f"{who} sets neither {flags[0]} nor {flags[1]}.", _VALID)
    for kind in interface.get("types", "").split():
        if kind not in subject.kinds:
            yield Breach(f"{who} is for {kind}, which the FMU is not.", quote("xcp.types"))
    for role in find_repeated(e.get("role") for e in interface.iterfind("{*}Variable")):
        yield Breach(f"{who} has more than one Variable with the role {role}.", quote("xcp.role_once"))


def _judge_xcp_variable(element: Any, variable: DeclaredVariable | None) -> Iterator[Problem]:
    """Yield what is wrong with a variable of a manifest; `variable` is None if the FMU lacks it."""
    role = element.get("role")
    if variable is None:
        message = f"The role {role} is of {element.get('name')}, which is not a variable of the FMU."
        yield Breach(message, quote("xcp.name"))
        return
    if variable.type not in XCP_ROLES[role]:
        types = " or ".join(XCP_ROLES[role])
        yield Breach(f"{variable} has the role {role}, but the type {variable.type}, not {types}.", _ALLOWED)
    if (variable.causality, variable.variability) not in _COMBINATIONS or variable.dimensions:
        shape = "an array" if variable.dimensions else f"a {variable.variability} {variable.causality}"
        yield Breach(f"{variable} has the role {role}, but is {shape}.", _ALLOWED)
