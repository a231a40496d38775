"""What FMI-LS-XCP demands of the files and variables that its manifest names."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from ..declarations import DeclaredVariable, find_repeated
from ..layered_manifest import XCP_ROLES, LayeredManifest
from ..libraries import list_platforms
from ..messages import Breach, Problem
from ..subject import Subject
from ..verdict import Clause

_xcp = partial(Clause, document="FMI-LS-XCP 1.0.0")

_DEFINITION = _xcp(
    "2",
    "It may not contain any dot segments, that is, complete path segments consisting only of . or ...",
)
_VALID = _xcp(
    "2",
    "The FMU must provide a valid definition attribute and must set at least one of the attributes "
    "containsXCPService or supportsDirectMemoryAccess to true to comply with this layered standard.",
)
_NAME = _xcp("2", "Name of a variable defined in the modelDescription.xml of the FMU.")
_VARIABLE_ONCE = _xcp("2", "No variable shall occur in more than one Variable entry.")
_ROLE_ONCE = _xcp(
    "2",
    "No role shall occur in more than one Variable entry of one Interface, but can occur again in Variable "
    "entries of a different Interface.",
)
_TYPES = _xcp("2", "The value is provided as a list of interface type names to which this interface applies.")
_SINGLE_FILE = _xcp(
    "3.3",
    "This layered standard forbids the use of the including mechanism of additional A2L files to simplify "
    "complete extraction and copying of the A2L file to a location where it is accessible by the MCD tool.",
)
_INCLUDE = re.compile(rb"^[ \t]*/include\b", re.MULTILINE | re.IGNORECASE)
_ALLOWED = _xcp(
    "4.1",
    "All variables that are defined must be defined as scalars with one of the following "
    "causality/variability combinations:",
)
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
        yield Breach(f"{manifest.label} has more than one Variable {name}.", _VARIABLE_ONCE)
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
                yield Breach(
                    f"{file.relative_to(folder).as_posix()} includes another A2L file.", _SINGLE_FILE
                )
    flags = ("containsXCPService", "supportsDirectMemoryAccess")
    if not any(interface.get(flag) in ("true", "1") for flag in flags):
        yield Breach(f"{who} sets neither {flags[0]} nor {flags[1]}.", _VALID)
    for kind in interface.get("types", "").split():
        if kind not in subject.kinds:
            yield Breach(f"{who} is for {kind}, which the FMU is not.", _TYPES)
    for role in find_repeated(e.get("role") for e in interface.iterfind("{*}Variable")):
        yield Breach(f"{who} has more than one Variable with the role {role}.", _ROLE_ONCE)


def _judge_variable(element: Any, variable: DeclaredVariable | None) -> Iterator[Problem]:
    role = element.get("role")
    if variable is None:
        message = f"The role {role} is of {element.get('name')}, which is not a variable of the FMU."
        yield Breach(message, _NAME)
        return
    if variable.type not in XCP_ROLES[role]:
        types = " or ".join(XCP_ROLES[role])
        yield Breach(f"{variable} has the role {role}, but the type {variable.type}, not {types}.", _ALLOWED)
    if (variable.causality, variable.variability) not in _COMBINATIONS or variable.dimensions:
        shape = "an array" if variable.dimensions else f"a {variable.variability} {variable.causality}"
        yield Breach(f"{variable} has the role {role}, but is {shape}.", _ALLOWED)
