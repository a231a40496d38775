"""Collect information on an FMU, a package or a scenario."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Unpack

from fmpy.model_description import ValidationError

from ..base.errors import CommandError, join_names, show_paths_relative_to
from ..base.faults import LENIENT, accept_faults
from ..base.option import BUILDING
from ..base.progress import Progress
from ..base.units import IDENTITY
from ..fmu.attribute_faults import find_attribute_fault
from ..fmu.elements import is_version_3
from ..fmu.interface import (
    KINDS,
    MODEL_EXCHANGE,
    Interface,
    explain_unsupported,
    first_problem,
    read_description,
)
from ..master.grouping import find_groups
from ..run.option_types import RunOptions
from ..run.options import list_options
from ..run.preparation import prepare_system
from ..run.remarks import describe_disabled_event_mode
from ..run.scenarios.loading import is_fmu, make_component_name
from ..run.scenarios.scenario import Scenario
from ..study.loading import load
from ..system.model import Component, System
from ..system.resolution import resolve_system
from .fmu_header import read_fmu_info
from .info_parts import ComponentInfo, ConnectionInfo
from .system_info import Info
from .variable_rows import ConnectionIndex, End, list_variables


def info(
    source: str | Path | System, progress: Progress | None = None, **options: Unpack[RunOptions]
) -> Info:
    """Return what an FMU, an SSP, a scenario or a system contains, with all changes that the options make.

    Missing FMUs of this project are built; nothing is simulated. For an FMU that cannot run here, the notes
    of the result say why.

    Args:
        source: as for `load`.
        progress: receives the progress of building FMUs.
        **options: as for `load`.

    Returns:
        FMUs, components, connections, and variables with units and start values.

    Raises:
        CommandError: the source or an option is wrong.
        RunError: an FMU cannot be built.

    Examples:
        >>> import emla_cosim as ec
        >>> found = ec.info("lift")
        >>> found["lift.plant.x_L"].unit
        'm'
    """
    try:
        scenario = load(source, **options)
    except CommandError:
        of_ours = {n for n, one in list_options().items() if one.stage == BUILDING or not one.repeated}
        if (
            set(options) - of_ours - {LENIENT}
            or not isinstance(source, (str, Path))
            or not is_fmu(Path(source))
        ):
            raise
        return _collect_unsupported_fmu(Path(source))
    with (
        show_paths_relative_to(scenario.unpacked),
        accept_faults(scenario.options.lenient) as faults,
    ):
        faults.merge(scenario.accepted)
        told = progress or Progress()
        prepared = prepare_system(scenario.system, scenario.options, told)
        found = _collect_system(scenario, prepared.system, prepared.fmus, prepared.interfaces)
    told.advance(1)
    remarks = (remark.rstrip(".") for remark in faults.remarks(scenario.unpacked))
    return replace(found, notes=(*found.notes, *remarks))


def _collect_system(
    scenario: Scenario, system: System, files: Mapping[str, Path], interfaces: Mapping[str, Interface]
) -> Info:
    names = {
        (c.name, variable): f"{c.name}.{name}"
        for c in system.components
        for variable, (name, _) in c.by_fmu_name.items()
    }
    wired = resolve_system(system, interfaces)
    readers: dict[End, list[End]] = {}
    for x in wired.connections:
        readers.setdefault(x.ends[0], []).append(x.ends[1])
    wires = ConnectionIndex({x.ends[1]: x.ends[0] for x in wired.connections}, readers, names)
    connections = (
        ConnectionInfo(wires.name(x.ends[0]), wires.name(x.ends[1]), by.factor, by.offset)
        for x in wired.connections
        for by in (x.transformation or IDENTITY,)
    )
    used = {file: interfaces[name] for name, file in files.items()}
    places = {file: place for place, file in enumerate(used)}
    unread = list[str]()
    fmus = tuple(
        read_fmu_info(file, _display_name(file, scenario.unpacked), of, unread.append)
        for file, of in used.items()
    )
    rows = (v for c in system.components for v in list_variables(c, interfaces[c.name], wires))
    components = (
        ComponentInfo(c.name, fmus[places[files[c.name]]].model, places[files[c.name]])
        for c in system.components
    )
    return Info(
        name=scenario.name,
        description=scenario.description,
        start_time=scenario.options.start_time,
        stop_time=scenario.options.stop_time,
        step_size=scenario.options.step_size,
        notes=(
            *scenario.notes,
            *_describe_kinds(wired, interfaces, scenario.options.integrate_together),
            *(remark.rstrip(".") for remark in describe_disabled_event_mode(system)),
            *unread,
        ),
        fmus=fmus,
        components=tuple(components),
        connections=tuple(connections),
        variables=tuple(rows),
    )


def _describe_kinds(
    system: System, interfaces: Mapping[str, Interface], integrate_together: bool
) -> list[str]:
    """Return notes on the components that run as Model Exchange."""
    kinds = {c.name: KINDS.get(c.kind) or next(iter(interfaces[c.name].kinds)) for c in system.components}
    groups = find_groups(system, interfaces, kinds) if integrate_together else []
    grouped = {name for group in groups for name in group}
    alone = [name for name, kind in kinds.items() if kind == MODEL_EXCHANGE and name not in grouped]
    notes = [f"{join_names(group)}: Model Exchange, integrated together by CVode" for group in groups]
    return notes + ([f"{join_names(alone)}: Model Exchange, integrated by CVode"] if alone else [])


def _collect_unsupported_fmu(path: Path) -> Info:
    """Return what an FMU that this master cannot run says about itself."""
    interface, reason = _read(path)
    try:
        unread = list[str]()
        fmu = read_fmu_info(path, str(path), interface, unread.append)
        name = make_component_name(fmu.model)
        wires = ConnectionIndex({}, {}, {})
        rows = list_variables(Component(name, fmu=path), interface, wires, runnable=False)
    except (CommandError, MemoryError):
        raise
    except Exception as error:  # fmpy fails on invalid numbers
        if (fault := find_attribute_fault(path)) is not None:
            raise CommandError(f"'{path}' is not a valid FMU: {fault}.") from error
        raise CommandError(f"'{path}' is not an FMU that can be read: {error}.") from error
    return Info(
        name=name,
        description=fmu.description,
        start_time=fmu.start_time,
        stop_time=fmu.stop_time,
        step_size=fmu.step_size,
        notes=(f"the FMU cannot be run here: it {reason}", *unread),
        fmus=(fmu,),
        components=(ComponentInfo(name, fmu.model, 0),),
        connections=(),
        variables=tuple(rows),
    )


def _read(path: Path) -> tuple[Interface, str]:
    """Return the interface of an FMU, and the reason why this master cannot run it."""
    wrong = "cannot be run"
    try:
        interface = read_description(path)
    except ValidationError as error:
        wrong = f"is not valid: {find_attribute_fault(path, fatal=False) or first_problem(error)}"
        try:
            interface = read_description(path, validate=False)
        except ValidationError as more:
            text = find_attribute_fault(path) or first_problem(more)
            raise CommandError(f"'{path}' is not a valid FMU: {text}.") from more
        except CommandError as more:
            if find_attribute_fault(path) is not None:
                raise
            raise CommandError(f"'{path}' is not a valid FMU: {first_problem(error)}.") from more
    except CommandError as error:
        interface = read_description(path, validate=False)
        if not is_version_3(interface.description):
            raise
        wrong = str(error).removeprefix(f"'{path}' ").rstrip(".")
    reason = explain_unsupported(interface)
    if reason is not None and is_version_3(interface.description):
        interface = read_description(path, validate=False)  # with whole arrays and Clocks
    return interface, reason or wrong


def _display_name(file: Path, unpacked: Path | None) -> str:
    """Return the name of a file; for one in a package, PACKAGE.ssp/FILE."""
    if unpacked is not None and file.is_relative_to(unpacked):
        return str(file.relative_to(unpacked))
    return str(file)
