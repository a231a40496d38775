"""Writing of a system of FMUs to an SSP file, with its parameter files and mappings."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from fmublock.archive import write_archive

from ...base.errors import CommandError
from ...base.faults import accept_if_lenient
from ...base.output_files import OutputFile
from ...base.wording import find_free_name
from ...fmu.interface import KINDS, MODEL_EXCHANGE, Interface
from ...fmu.parameters.parameter_sets import ParameterSet, SsvParameter, format_parameter_set
from ...fmu.parameters.ssp_xml import VERSION_2
from ...fmu.variables import convert_start_value, find_variable
from ...system.model import Component, System
from ...system.resolution import resolve_system
from ...system.structure import read_sized_interfaces
from ..documents.mappings import format_mapping
from ..documents.ssd_data import (
    DEFAULT_SSD,
    FileReference,
    MappingEntry,
    ParameterBinding,
    Structure,
    format_id,
    make_identifier,
)
from ..documents.ssd_writer import format_structure
from .elements import StructurePart, build_root_system, complete_arrays, select_unambiguous, select_version

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


def make_parameter_files(system: System, interfaces: Mapping[str, Interface], version: str) -> ParameterFiles:
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
    uri = choose_file_name(component.name, ".ssv", contents)
    defined_units = select_unambiguous(p.unit for p in parameters)
    # a document cannot define two units of one name
    listed = tuple(p if p.unit in defined_units else replace(p, unit=None) for p in parameters)
    content = ParameterSet(SET_NAME, listed, f"Parameters of {component.name}")
    contents[uri] = format_parameter_set(content, version)
    reference = None
    if mapping:
        reference = FileReference(choose_file_name(component.name, ".ssm", contents))
        contents[reference.source] = format_mapping(mapping, version)
    return (ParameterBinding(FileReference(uri), mapping=reference, renames=reference is not None),)


def choose_file_name(name: str, ending: str, used: Collection[str]) -> str:
    """Return an unused URI in the package for a file.

    Args:
        name: The name of the file's content; other characters than letters and digits are replaced.
        ending: The extension.
        used: The URIs in use.
    """
    stem = re.sub(r"[^A-Za-z0-9_-]", "_", name)
    return find_free_name(f"resources/{stem}", {uri.removesuffix(ending) for uri in used}) + ending


@dataclass(frozen=True)
class SystemTimes:
    """Start time, stop time and step size of a system in s."""

    start_time: float
    stop_time: float
    step_size: float


_MARK = b"emla-cosim package"
"""The zip comment of our packages. It is not part of the SSP, and repacking removes it."""


def check_package(path: Path, overwrite: bool = False) -> OutputFile:
    """Return the file of a package, which may be written.

    Args:
        path: The file.
        overwrite: Whether to replace a file that emla did not write.

    Raises:
        CommandError: If it must not be written.
    """
    if path.suffix.lower() != ".ssp":
        raise CommandError(
            f"a scenario is exported to a file that ends in .ssp, .fmu or .c, not to '{path}'."
        )
    return OutputFile(path, "the package", _is_ours, overwrite, creates_folder=True)


def _is_ours(path: Path) -> bool:
    try:
        with ZipFile(path) as archive:
            return archive.comment == _MARK
    except BadZipFile:
        return False


def write_ssp(
    path: Path,
    name: str,
    description: str,
    system: System,
    fmus: Mapping[str, Path],
    experiment: SystemTimes,
    overwrite: bool = False,
) -> None:
    """Write a system with its FMUs to a package; equal content gives equal bytes.

    It is of SSP 1.0 unless the system needs SSP 2.0.

    Args:
        path: The file.
        name: The name of the system. Characters that not every tool accepts are replaced; `read_ssp` restores
            them.
        description: Its description.
        system: The system.
        fmus: The FMUs by component.
        experiment: The times of the default experiment.
        overwrite: Whether to replace a file that emla did not write.

    Raises:
        CommandError: If the system does not fit an SSP, or the file must not be replaced.
        RunError: If the file cannot be written.
    """
    package = check_package(path, overwrite)
    fmus = {c.name: fmus[c.name] for c in system.components}
    interfaces = read_sized_interfaces(system, fmus)
    plain = resolve_system(system, interfaces)
    uris: dict[Path, str] = {}
    for file in dict.fromkeys(fmus.values()):
        uris[file] = choose_file_name(file.stem, ".fmu", uris.values())  # files of the same name are numbered
    version = select_version(plain, interfaces)
    parameters = make_parameter_files(system, interfaces, version)
    parts = {
        c.name: StructurePart(interfaces[c.name], uris[fmus[c.name]], parameters.bindings[c.name])
        for c in system.components
    }
    identifier = make_identifier(name)
    # OMSimulator integrates Model Exchange in systems with a solver only
    kinds = {KINDS.get(c.kind) or next(iter(interfaces[c.name].kinds)) for c in system.components}
    structure = Structure(
        identifier,
        build_root_system(identifier, plain, parts, version),
        experiment.start_time,
        experiment.stop_time,
        experiment.step_size,
        description,
        tuple(c.name for c in system.components if c.samples),
        system.bonds,
        format_id(identifier, name),
        kinds == {MODEL_EXCHANGE} and not any(c.samples for c in system.components),
        version,
    )
    contents = {uri: file.read_bytes() for file, uri in uris.items()}
    contents |= parameters.contents | {DEFAULT_SSD: format_structure(structure)}
    with package.report_errors():
        write_archive(path, contents, _MARK, check=package.check_again)
