"""Which values of a system go to which parameter file, and which mappings that takes."""

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

from fmpy.model_description import ModelVariable

from ...errors import CommandError
from ...fmu.interface import Interface
from ...fmu.variables import find_variable, start_value
from ...system.model import Component, System
from ..documents.parameters import format_mapping, format_parameter_set
from ..documents.structure import MappingEntry, Parameter, ParameterBinding, ParameterSet, Reference
from .building import unambiguous

SET_NAME = "initialValues"
"""The name of every parameter set: Ecos takes the sets of one name, and its users expect this one."""


@dataclass(frozen=True)
class ParameterFiles:
    """The contents of files by URI, and the bindings of every component."""

    contents: dict[str, bytes] = field(default_factory=dict)
    bindings: dict[str, tuple[ParameterBinding, ...]] = field(default_factory=dict)


def parameter_files(system: System, interfaces: Mapping[str, Interface]) -> ParameterFiles:
    """One set per joint, which all its components share.

    A component for which a name of the joint's set means another value has a file of its own; one
    whose FMU knows its variables by other names has a mapping. Raises CommandError for values that
    do not fit.
    """
    files = ParameterFiles()
    driven = {(x.target, x.input) for x in system.connections}
    for joint in system.branches:
        members = [c for c in system.components if c.name.split(".")[0] == joint]
        shared: list[_Member] = []
        for component in members:
            member = _Member(component, interfaces[component.name], driven)
            together = [*shared, member]
            if _agree(together):
                shared = together
            else:
                _write(files, component.name, [member])
        _write(files, joint, shared)
    return files


class _Member:
    """A component with its values as parameters of a set."""

    def __init__(self, component: Component, interface: Interface, driven: Iterable[tuple[str, str]]) -> None:
        self.component = component
        self.interface = interface
        last = {component.alias(name).variable: name for name in component.parameters}
        aliases = {alias.variable: name for name, alias in component.aliases.items()}
        names = {
            variable: last.get(variable, aliases.get(variable, variable)) for variable in interface.variables
        }
        names |= {variable: name for variable, name in last.items() if variable not in names}
        self._names = names
        self.parameters = {
            name: self._parameter(name, component.parameters[name])
            for name in names.values()
            if name in component.parameters
        }
        self._driven = {name for owner, name in driven if owner == component.name}

    @property
    def names(self) -> Iterable[str]:
        """What the system calls the FMU's variables, in their order."""
        return self._names.values()

    def _parameter(self, name: str, value: object) -> Parameter:
        component, alias = self.component, self.component.alias(name)
        variable = find_variable(component.name, self.interface.variables, alias.variable)
        if name in component.aliases and variable.type == "Real":
            try:
                return Parameter(name, "Real", float(str(value)), alias.unit)
            except ValueError as error:
                raise CommandError(f"{component.name}.{name} = {value} is not a number.") from error
        typed = start_value(component.name, self.interface, variable, value)
        if variable.type == "Enumeration":
            return Parameter(name, "Enumeration", _literal(variable, typed))
        unit = self.interface.unit(variable.name) if variable.type == "Real" else None
        return Parameter(name, variable.type, typed, unit)

    def bears(self, parameter: Parameter) -> bool:
        """Whether the set may hold this, set by another component: here it changes nothing."""
        name = parameter.name
        if name in self.parameters:
            return self.parameters[name] == parameter
        known = self.component.alias(name).variable
        if (
            known in self._driven
            or known not in self.interface.variables
            or not self.interface.settable(known)
        ):
            return True
        if self.component.aliases:
            return name not in self.component.aliases
        variable = self.interface.variables[name]
        return (
            parameter.type == variable.type == "Real"
            and parameter.unit == self.interface.unit(name)
            and float(variable.start or "nan") == parameter.value
        )

    def mapping(self) -> list[MappingEntry]:
        """What the FMU calls the variables of the component; empty if the same."""
        if not self.component.aliases:
            return []
        names = dict.fromkeys([*self.parameters, *self.component.aliases])
        entries: dict[str, MappingEntry] = {}
        for name in names:
            alias = self.component.alias(name)
            entry = MappingEntry(name, alias.variable, alias.transformation, suppress_unit_conversion=True)
            entries.setdefault(alias.variable, entry)
        return list(entries.values())


def _agree(members: list[_Member]) -> bool:
    given = [p for m in members for p in m.parameters.values()]
    return all(member.bears(parameter) for member in members for parameter in given)


def _write(files: ParameterFiles, name: str, members: list[_Member]) -> None:
    parameters = {p.name: p for m in members for p in m.parameters.values()}
    uri = file_name(name, ".ssv", files.contents)
    if any(m.parameters or m.component.aliases for m in members):
        known = unambiguous(p.unit for p in parameters.values())
        order = dict.fromkeys(n for m in members for n in m.names if n in parameters)
        listed = [parameters[n] for n in order]
        listed = [p if p.unit in known else replace(p, unit=None) for p in listed]
        written = ParameterSet(SET_NAME, tuple(listed), f"Parameters of {name}")
        files.contents[uri] = format_parameter_set(written)
    for member in members:
        owner = member.component.name
        mapping = member.mapping()
        reference = None
        if mapping:
            reference = Reference(file_name(owner, ".ssm", files.contents))
            files.contents[reference.source] = format_mapping(mapping)
        bound = member.parameters or mapping
        binding = ParameterBinding(Reference(uri), mapping=reference, renames=reference is not None)
        files.bindings[owner] = (binding,) if bound else ()


def file_name(name: str, ending: str, taken: Collection[str]) -> str:
    """A file in the package, called after a name, that is not taken and is its own URI."""
    stem = re.sub(r"[^A-Za-z0-9_-]", "_", name)
    uri, number = f"resources/{stem}{ending}", 1
    while uri in taken:
        number += 1
        uri = f"resources/{stem}_{number}{ending}"
    return uri


def _literal(variable: ModelVariable, number: int) -> str:
    items = variable.declaredType.items if variable.declaredType is not None else []
    return next(str(i.name) for i in items if int(str(i.value)) == number)
