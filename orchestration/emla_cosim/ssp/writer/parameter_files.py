"""Parameter files and mappings of a system."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from ...base.errors import CommandError
from ...base.faults import accept_if_lenient
from ...base.wording import find_free_name
from ...fmu.interface import Interface
from ...fmu.parameters.parameter_sets import ParameterSet, SsvParameter, format_parameter_set
from ...fmu.parameters.ssp_xml import VERSION_2
from ...fmu.variables import convert_start_value, find_variable
from ...system.model import Component, System
from ..documents.mappings import format_mapping
from ..documents.ssd_data import FileReference, MappingEntry, ParameterBinding
from .elements import select_unambiguous
from .version_2 import complete_arrays

SET_NAME = "initialValues"
"""The name of all parameter sets: Ecos selects sets by name, and its users expect this one."""

_TYPES = ("Real", "Integer", "Boolean")
"""The types of parameters that OMSimulator, libcosim and Ecos read."""

_PLURALS = {"Enumeration": "Enumerations", "String": "Strings"}


@dataclass(frozen=True)
class ParameterFiles:
    """The contents of files of a version of SSP by URI, and the bindings by component."""

    version: str
    contents: dict[str, bytes] = field(default_factory=dict)
    bindings: dict[str, tuple[ParameterBinding, ...]] = field(default_factory=dict)


def parameter_files(system: System, interfaces: Mapping[str, Interface], version: str) -> ParameterFiles:
    """Return one parameter set per component with only that component's parameters.

    OMSimulator stops at the first parameter that a component does not have, and other tools warn about each.
    A component whose FMU has other names for its variables also gets a mapping.

    Args:
        system: The system.
        interfaces: The model descriptions by component.
        version: The version of SSP. With 2.0, arrays are parameters; not those of a component with other
            names, because a mapping has no indices.

    Raises:
        CommandError: If a variable does not accept a value.
    """
    files = ParameterFiles(version)
    for component in system.components:
        parameters = _list_parameters(component, interfaces[component.name])
        if version == VERSION_2 and not component.aliases:
            parameters = complete_arrays(parameters, component.name, interfaces[component.name])
        files.bindings[component.name] = _add_files(files, component, parameters)
    return files


def _list_parameters(component: Component, interface: Interface) -> list[SsvParameter]:
    """Return the parameters of a component by its own names, in the order of the FMU's variables."""
    names = {component.alias(name).variable: name for name in component.parameters}
    in_order = [names.pop(variable) for variable in interface.variables if variable in names]
    parameters = (_make_parameter(component, interface, name) for name in (*in_order, *names.values()))
    return [parameter for parameter in parameters if parameter is not None]


def _make_parameter(component: Component, interface: Interface, name: str) -> SsvParameter | None:
    """Return a parameter; None for a default of the FMU of a type that not all tools read.

    With `lenient`, other values of such a type are written, too.
    """
    value, alias = component.parameters[name], component.alias(name)
    variable = find_variable(component.name, interface.variables, alias.variable)
    if name in component.aliases and variable.type == "Real":
        try:
            return SsvParameter(name, "Real", float(str(value)), alias.unit)
        except ValueError as error:
            raise CommandError(f"{component.name}.{name} = {value} is not a number.") from error
    typed = convert_start_value(component.name, interface, variable, value)
    if variable.type in _TYPES:
        unit = interface.unit(variable.name) if variable.type == "Real" else None
        return SsvParameter(name, variable.type, typed, unit)
    start = variable.start
    if start is not None and convert_start_value(component.name, interface, variable, start) == typed:
        return None
    accept_if_lenient(
        f"{component.name}.{name}",
        f"not all tools read {_PLURALS[variable.type]} from a package, and others run with another value",
        f"{component.name}.{name} = {value} cannot be exported: not all tools read {_PLURALS[variable.type]} "
        "from a package, and those would run with another value. Build the FMU with this start value",
        component=component.name,
        variable=variable.name,
    )
    number = variable.type == "Enumeration"  # OMSimulator reads the number, and no tool the name
    return SsvParameter(name, "Integer" if number else "String", typed)


def _make_mapping(component: Component, parameters: list[SsvParameter]) -> list[MappingEntry]:
    """Return the FMU's names of parameters and other variables, empty if they are the same."""
    if not component.aliases:
        return []
    entries: dict[str, MappingEntry] = {}
    for name in dict.fromkeys([*(p.name for p in parameters), *component.aliases]):
        alias = component.alias(name)
        entry = MappingEntry(name, alias.variable, alias.transformation, suppress_unit_conversion=True)
        entries.setdefault(alias.variable, entry)
    return list(entries.values())


def _add_files(
    files: ParameterFiles, component: Component, parameters: list[SsvParameter]
) -> tuple[ParameterBinding, ...]:
    """Return the binding of a component and add its files; no binding without content."""
    mapping = _make_mapping(component, parameters)
    if not (parameters or mapping):
        return ()
    contents, version = files.contents, files.version
    uri = file_name(component.name, ".ssv", contents)
    defined_units = select_unambiguous(p.unit for p in parameters)
    # a document cannot define two units of one name
    listed = tuple(p if p.unit in defined_units else replace(p, unit=None) for p in parameters)
    content = ParameterSet(SET_NAME, listed, f"Parameters of {component.name}")
    contents[uri] = format_parameter_set(content, version)
    reference = None
    if mapping:
        reference = FileReference(file_name(component.name, ".ssm", contents))
        contents[reference.source] = format_mapping(mapping, version)
    return (ParameterBinding(FileReference(uri), mapping=reference, renames=reference is not None),)


def file_name(name: str, ending: str, used: Collection[str]) -> str:
    """Return an unused URI in the package for a file.

    Args:
        name: The name of the file's content; other characters than letters and digits are replaced.
        ending: The extension.
        used: The URIs in use.
    """
    stem = re.sub(r"[^A-Za-z0-9_-]", "_", name)
    return find_free_name(f"resources/{stem}", {uri.removesuffix(ending) for uri in used}) + ending
