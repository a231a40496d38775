"""Which values of a system go to which parameter file, and which mappings that takes."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from fmpy.model_description import ModelVariable

from ..fmu.interface import Interface
from ..fmu.variables import find_variable, start_value
from ..system.model import Component, System
from .parameters import format_mapping, format_parameter_set
from .structure import MappingEntry, Parameter, ParameterBinding, ParameterSet, Reference

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
    for joint in system.joints:
        members = [c for c in system.components if c.name.split(".")[0] == joint]
        shared: list[_Member] = []
        for component in members:
            member = _Member(component, interfaces[component.name], driven)
            together = [*shared, member]
            if _agree(together):
                shared = together
            else:
                _write(files, component.name.replace(".", "_"), [member])
        _write(files, joint, shared)
    return files


class _Member:
    """A component with its values as parameters of a set."""

    def __init__(self, component: Component, interface: Interface, driven: Iterable[tuple[str, str]]) -> None:
        self.component = component
        self.interface = interface
        place = {name: i for i, name in enumerate(interface.variables)}
        given = sorted(component.parameters, key=lambda n: place.get(component.alias(n).variable, -1))
        self.parameters = {name: self._parameter(name, component.parameters[name]) for name in given}
        self._driven = {name for owner, name in driven if owner == component.name}

    def _parameter(self, name: str, value: object) -> Parameter:
        component, alias = self.component, self.component.alias(name)
        variable = find_variable(component.name, self.interface.variables, alias.variable)
        if name in component.aliases and variable.type == "Real":
            return Parameter(name, "Real", float(str(value)), alias.unit)
        typed = start_value(component.name, variable, value)
        if variable.type == "Enumeration":
            return Parameter(name, "Enumeration", _literal(variable, typed))
        unit = self.interface.unit(variable.name) if variable.type == "Real" else None
        return Parameter(name, variable.type, typed, unit)

    def bears(self, parameter: Parameter) -> bool:
        """Whether the set may hold this, set by another component: here it changes nothing."""
        name = parameter.name
        if name in self.parameters:
            return self.parameters[name] == parameter
        if self.component.aliases or name in self._driven or name not in self.interface.variables:
            return True
        variable = self.interface.variables[name]
        settable = variable.causality in ("parameter", "input") or variable.initial in ("exact", "approx")
        return not settable or (
            parameter.type == variable.type == "Real" and float(variable.start or "nan") == parameter.value
        )

    def mapping(self) -> list[MappingEntry]:
        """What the FMU calls the variables of the component; empty if the same."""
        if not self.component.aliases:
            return []
        names = dict.fromkeys([*self.parameters, *self.component.aliases])
        aliases = [(name, self.component.alias(name)) for name in names]
        return [
            MappingEntry(name, alias.variable, alias.transformation, suppress_unit_conversion=True)
            for name, alias in aliases
        ]


def _agree(members: list[_Member]) -> bool:
    given = [p for m in members for p in m.parameters.values()]
    return all(member.bears(parameter) for member in members for parameter in given)


def _write(files: ParameterFiles, name: str, members: list[_Member]) -> None:
    parameters = {p.name: p for m in members for p in m.parameters.values()}
    uri = f"resources/{name}.ssv"
    if any(m.parameters or m.component.aliases for m in members):
        listed = ParameterSet(SET_NAME, tuple(parameters.values()), f"Parameters of {name}")
        files.contents[uri] = format_parameter_set(listed)
    for member in members:
        owner = member.component.name
        mapping = member.mapping()
        reference = None
        if mapping:
            reference = Reference(f"resources/{owner.replace('.', '_')}.ssm")
            files.contents[reference.source] = format_mapping(mapping)
        bound = member.parameters or mapping
        files.bindings[owner] = (ParameterBinding(Reference(uri), mapping=reference),) if bound else ()


def _literal(variable: ModelVariable, number: int) -> str:
    items = variable.declaredType.items if variable.declaredType is not None else []
    return next(str(i.name) for i in items if int(str(i.value)) == number)
