"""Collect information on an FMU, a package or a scenario."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

from fmpy.model_description import ModelVariable, ValidationError

from ..base.errors import CommandError, join_names, show_paths_relative_to
from ..base.faults import LENIENT, accept_faults
from ..base.files import hash_file, read_text
from ..base.option import BUILDING
from ..base.progress import Progress
from ..base.toml_structs import read_toml
from ..base.units import IDENTITY
from ..fmu.document import FmuDocument
from ..fmu.interface import KINDS, MODEL_EXCHANGE, Interface, explain_unsupported, read_description
from ..fmu.variables import convert_start_values
from ..master.grouping import find_groups
from ..run.option_types import RunOptions
from ..run.options import list_options
from ..run.preparation import prepare_system
from ..run.remarks import describe_disabled_event_mode
from ..run.scenarios.loading import is_fmu, make_component_name
from ..run.scenarios.scenario import Scenario
from ..study.loading import load
from ..study.machines.schema import KIND, parse_machine
from ..system.model import Alias, Component, System
from ..system.resolution import convert_to_fmu_terms, resolve_system
from .system_info import ComponentInfo, ConnectionInfo, FmuInfo, Info, VariableInfo

_End = tuple[str, str]
"""Component and the FMU's name of a variable, as in connections."""


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
        >>> content = ec.info("lift")
        >>> content["lift.plant.x_L"].unit
        'm'
    """
    try:
        scenario = load(source, **options)
    except CommandError as error:
        ignored_options = {
            name for name, o in list_options().items() if o.stage == BUILDING or not o.repeated
        }
        if not isinstance(source, (str, Path)) or not set(options) <= ignored_options | {LENIENT}:
            raise
        collect = _collect_unsupported_fmu if is_fmu(Path(source)) else _collect_mechanics
        # an FMU that cannot run is still worth looking at
        return collect(Path(source), error)
    with (
        show_paths_relative_to(scenario.unpacked),
        accept_faults(scenario.options.lenient) as faults,
    ):
        faults.merge(scenario.accepted)
        progress_display = progress or Progress()
        prepared = prepare_system(scenario.system, scenario.options, progress_display)
        model = _collect_system(scenario, prepared.system, prepared.fmus, prepared.interfaces)
    progress_display.advance(1)
    remarks = (remark.rstrip(".") for remark in faults.remarks(scenario.unpacked))
    model = replace(model, notes=(*model.notes, *remarks))
    if "machine" not in scenario.system.record:
        return model
    from ..study.machines.machine_info import find_machine_info  # loads CasADi

    starts = {variable.name: variable.start for variable in model.variables}
    return replace(model, machine=find_machine_info(scenario.system, starts))


def _collect_mechanics(path: Path, reason: CommandError) -> Info:
    """Return the mechanics of a machine file that cannot run; raise the reason for other files."""
    from ..study.machines.machine_info import collect_machine  # loads CasADi

    try:
        label = f"the machine file '{path}'"
        content = read_toml(read_text(path, label), label)
        if content.get("kind") != KIND:
            raise reason
        machine = parse_machine(content, label, path.parent)
    except CommandError:
        raise reason from None
    return Info(
        name=path.name,
        description=str(content.get("description", "")),
        notes=(f"only the mechanics are shown, since the machine cannot run: {str(reason).rstrip('.')}",),
        machine=collect_machine(machine),
    )


def _collect_system(
    scenario: Scenario, system: System, files: Mapping[str, Path], interfaces: Mapping[str, Interface]
) -> Info:
    """Return the content of a prepared system; `files` and `interfaces` are by component."""
    names = {
        (c.name, variable): f"{c.name}.{name}"
        for c in system.components
        for variable, (name, _) in c.by_fmu_name.items()
    }
    wired = resolve_system(system, interfaces)
    connections = list[ConnectionInfo]()
    drivers, readers = dict[_End, str](), dict[_End, list[str]]()
    for connection in wired.connections:
        source, target = connection.ends
        output, input_ = (names.get(end, ".".join(end)) for end in (source, target))
        conversion = connection.transformation or IDENTITY
        connections.append(ConnectionInfo(output, input_, conversion.factor, conversion.offset))
        drivers[target] = output
        readers.setdefault(source, []).append(input_)
    variables = [
        replace(
            row,
            driven_by=drivers.get(end),
            read_by=tuple(readers.get(end, ())),
            settable=row.settable and end not in drivers,
        )
        for c in system.components
        for row in _list_variables(c, interfaces[c.name])
        for end in [(c.name, row.fmu_name)]
    ]
    used = {file: interfaces[name] for name, file in files.items()}
    positions = {file: i for i, file in enumerate(used)}
    problems = list[str]()
    fmus = tuple(
        _read_fmu(file, _format_file_name(file, scenario.unpacked), interface, problems)
        for file, interface in used.items()
    )
    return Info(
        name=scenario.name,
        description=scenario.description,
        start_time=scenario.options.start_time,
        stop_time=scenario.options.stop_time,
        step_size=scenario.options.step_size,
        notes=(
            *scenario.notes,
            *_describe_model_exchange(wired, interfaces, scenario.options.integrate_together),
            *(remark.rstrip(".") for remark in describe_disabled_event_mode(system)),
            *problems,
        ),
        fmus=fmus,
        components=tuple(
            ComponentInfo(c.name, fmus[positions[files[c.name]]].model, positions[files[c.name]])
            for c in system.components
        ),
        connections=tuple(connections),
        variables=tuple(variables),
    )


def _describe_model_exchange(
    system: System, interfaces: Mapping[str, Interface], integrate_together: bool
) -> list[str]:
    """Return notes on the components that run as Model Exchange."""
    kinds = {c.name: KINDS.get(c.kind) or next(iter(interfaces[c.name].kinds)) for c in system.components}
    groups = find_groups(system, interfaces, kinds) if integrate_together else []
    grouped = {name for group in groups for name in group}
    ungrouped = [name for name, kind in kinds.items() if kind == MODEL_EXCHANGE and name not in grouped]
    notes = [f"{join_names(group)}: Model Exchange, integrated together by CVode" for group in groups]
    return notes + ([f"{join_names(ungrouped)}: Model Exchange, integrated by CVode"] if ungrouped else [])


def _collect_unsupported_fmu(path: Path, reason: CommandError) -> Info:
    """Return the content of an FMU that cannot run here; raise the reason if it cannot be read either."""
    try:
        interface = read_description(path, validate=False)  # with whole arrays and Clocks
    except (CommandError, ValidationError):
        raise reason from None
    try:
        problems = list[str]()
        fmu = _read_fmu(path, str(path), interface, problems)
        name = make_component_name(fmu.model)
        variables = [
            replace(row, settable=False) for row in _list_variables(Component(name, fmu=path), interface)
        ]
    # these have a message of their own
    except (CommandError, MemoryError):
        raise
    except Exception as error:  # fmpy fails on invalid numbers
        raise reason from error
    cause = explain_unsupported(interface) or str(reason).removeprefix(f"'{path}' ").rstrip(".")
    return Info(
        name=name,
        description=fmu.description,
        start_time=fmu.start_time,
        stop_time=fmu.stop_time,
        step_size=fmu.step_size,
        notes=(f"the FMU cannot be run here: it {cause}", *problems),
        fmus=(fmu,),
        components=(ComponentInfo(name, fmu.model, 0),),
        variables=tuple(variables),
    )


def _format_file_name(file: Path, unpacked: Path | None) -> str:
    """Return the name of a file; for one in a package, PACKAGE.ssp/FILE."""
    if unpacked is not None and file.is_relative_to(unpacked):
        return str(file.relative_to(unpacked))
    return str(file)


def _read_fmu(path: Path, display_path: str, interface: Interface, problems: list[str]) -> FmuInfo:
    """Return what an FMU says about itself as a whole.

    Args:
        path: The FMU.
        display_path: What to call its file.
        interface: Its model description.
        problems: Takes notes on what cannot be read.

    Raises:
        CommandError: The FMU cannot be read.
    """
    document, terminals = FmuDocument(path), tuple[str, ...]()
    try:
        sha256, size, platforms = hash_file(path), path.stat().st_size, document.platforms
    except OSError as error:
        raise CommandError(f"the FMU '{path}' cannot be read: {error.strerror}.") from error
    try:
        terminals = document.read_terminals()
    except ValueError as error:
        problems.append(str(error))
    root, experiment = document.root, document.root.find("DefaultExperiment")
    times = (
        _keep_finite(None if experiment is None else experiment.get(name))
        for name in ("startTime", "stopTime", "stepSize", "tolerance")
    )
    kinds = document.kinds or interface.kinds  # those of FMI 1.0 are not elements
    return FmuInfo(
        display_path,
        root.get("modelName", ""),
        root.get("description", ""),
        root.get("fmiVersion", ""),
        tuple(kinds),
        platforms,
        *times,
        tool=root.get("generationTool", ""),
        version=root.get("version", ""),
        author=root.get("author", ""),
        license=root.get("license", ""),
        guid=str(interface.description.guid or ""),
        sha256=sha256,
        size=size,
        capabilities={kind: document.list_flags(kind) for kind in document.kinds},
        terminals=terminals,
    )


def _list_variables(component: Component, interface: Interface) -> Iterator[VariableInfo]:
    """Yield the variables of a component, in the order of its FMU, without their connections.

    Raises:
        CommandError: If a start value cannot be set.
    """
    overrides = convert_to_fmu_terms(component).parameters
    values = {v.name: x for v, x in convert_start_values(component.name, interface, overrides)}
    aliases = component.by_fmu_name
    for fmu_name, variable in interface.variables.items():
        name, alias = aliases.get(fmu_name, (fmu_name, Alias(fmu_name)))
        yield _describe_variable(component.name, name, variable, interface, alias, values.get(fmu_name))


def _describe_variable(
    component: str, name: str, variable: ModelVariable, interface: Interface, alias: Alias, value: Any
) -> VariableInfo:
    """Return a variable in the names and units of the system; `value` is its start value in the FMU."""
    fmu_name, to_system = str(variable.name), alias.transformation.inverse()
    unit = alias.unit or interface.unit(fmu_name)
    limits = (_read_limit(variable, "min"), _read_limit(variable, "max"))
    minimum, maximum = (None if x is None else to_system(x) for x in limits)
    # a negative factor exchanges the ends of a range
    if to_system.factor < 0.0:
        minimum, maximum = maximum, minimum
    literals = interface.signal_type(fmu_name).items
    start, default = (
        literals.get(x, x) if literals else to_system(x) if isinstance(x, float) else x
        for x in (value, _read_start(variable))
    )
    is_enumeration = variable.type == "Enumeration"
    clocks: Any = variable.clocks or ()  # fmpy replaces value references by variables
    return VariableInfo(
        name=f"{component}.{name}",
        component=component,
        fmu_name=fmu_name,
        causality=str(variable.causality),
        variability=str(variable.variability),
        type=str(variable.type),
        unit=None if unit is None else unit.name,
        start=default if value is None else start,
        default=default,
        minimum=minimum,
        maximum=maximum,
        choices=tuple(literals.values()),
        description=" ".join(str(variable.description or "").split()),
        driven_by=None,
        read_by=(),
        settable=interface.is_settable(fmu_name),
        data_type=str((not is_enumeration and getattr(variable, "data_type", "")) or variable.type),
        dimensions=tuple(variable.shape or ()),
        clocks=tuple(str(clock.name) for clock in clocks),
        interval_variability=str(variable.intervalVariability or ""),
    )


def _read_start(variable: ModelVariable) -> Any:
    """Return the FMU's own start value as its type, or as text if it is invalid."""
    text = variable.start
    if text is None:
        return None
    try:
        if variable.type in ("Real", "Float64", "Float32"):
            return float(text)
        if variable.type in ("Integer", "Enumeration") or "Int" in str(variable.type):
            return int(text)
    except ValueError:  # for example an array
        return str(text)
    return str(text) in ("true", "1") if variable.type == "Boolean" else str(text)


def _read_limit(variable: ModelVariable, name: str) -> float | None:
    """Return the limit `min` or `max` of a number, also that of its type; None without one."""
    text = getattr(variable, name)
    if text is None and variable.declaredType is not None:
        text = getattr(variable.declaredType, name, None)
    return None if variable.type == "Enumeration" else _keep_finite(text)


def _keep_finite(text: Any) -> float | None:
    """Return a finite number; None for anything else, as invalid descriptions have it."""
    try:
        number = math.nan if text is None else float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
