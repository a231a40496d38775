"""What FMI-LS-XCP demands of the files and variables that its manifest names."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from ..declarations import DeclaredVariable, find_repeated
from ..layered_manifest import XCP_ROLES, LayeredManifest
from ..libraries import list_platforms
from ..messages import Breach, Problem
from ..subject import Subject
from ..verdict import quote

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
        yield from _judge_interface(interface, manifest.path.parent, subject)
    names = [e.get("name") for e in manifest.root.iter("{*}Variable")]
    for name in find_repeated(names):
        yield Breach(f"{manifest.label} has more than one Variable {name}.", quote("xcp.variable_once"))
    by_name = {name: v for v in subject.declared.variables for name in (v.name, *v.aliases)}
    for element in manifest.root.iter("{*}Variable"):
        yield from _judge_variable(element, by_name.get(element.get("name")))


def _judge_interface(interface: Any, folder: Path, subject: Subject) -> Iterator[Problem]:
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


def _judge_variable(element: Any, variable: DeclaredVariable | None) -> Iterator[Problem]:
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
