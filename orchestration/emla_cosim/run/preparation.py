"""Prepare a system to run or to export: build FMUs, apply parameter files, replace components."""

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..base.errors import CommandError, check_choice, join_names
from ..base.progress import Progress
from ..base.wording import format_count, has_wildcard
from ..fmu.interface import CO_SIMULATION, KINDS, Interface, read_interfaces
from ..fmu.models import build, check_build_path, find_block
from ..inputs.loaded_input import LoadedInput, find_data_end
from ..inputs.wired_inputs import wire_inputs
from ..system.model import Component, ShortNameError, System, Value
from ..system.names import Names
from ..system.signal_faults import add_fault_components, wire_faults
from ..system.structure import connect_elements, find_changed_sizes, set_structure
from .options import Options
from .registered import following_values
from .replacement import replace_component
from .run_setup import select_components


@dataclass(frozen=True)
class PreparedSystem:
    """A system with the changes of the options; FMU file and model description of every component."""

    system: System
    fmus: Mapping[str, Path]
    interfaces: Mapping[str, Interface]


def prepare_system(system: System, options: Options, progress: Progress) -> PreparedSystem:
    """Apply the options to a system, and build its FMUs.

    The progress of preparing has one unit more, for what the caller does next.

    Raises:
        CommandError: If an option does not fit the system.
        RunError: If an FMU cannot be built.
    """
    start, initial_system = options.start_time or 0.0, system
    tables = [LoadedInput.of(source, start) for source in options.input]
    all_without = "--no-event-mode without a name means all components."
    without_events = [select_components([p], system, all_without) for p in options.no_event_mode]
    system, faults = add_fault_components(system.with_main(), options.fault)
    replacements = options.replacements()
    _check_components(system, [*replacements], options.set)
    fmus = _prepare_fmu_files(system, options, progress)
    interfaces = read_interfaces(fmus)
    # first, because sizes of arrays decide which variables have names
    structure = _list_structural_values(system, options, interfaces)
    system, interfaces = set_structure(system, fmus, interfaces, structure)
    system = connect_elements(system, {name: i.variables for name, i in interfaces.items()})
    replacement_interfaces = read_interfaces(
        {name: replacement.fmu for name, replacement in replacements.items()}
    )
    system = Names(system, interfaces, replacement_interfaces).with_converted_values()
    system = apply_parameter_files(system, options.parameters, interfaces)
    if tables:
        wired_inputs = wire_inputs(system, tables, interfaces, options.platform)
        system = wired_inputs.system
        fmus |= wired_inputs.fmus
        interfaces |= read_interfaces(wired_inputs.fmus)
        for note in wired_inputs.notes:
            progress.note(f"Note: {note}")
    system = wire_faults(system, faults, interfaces)
    followers = following_values(initial_system, options)
    values = Names(system, interfaces, replacement_interfaces).start_values(options.set)
    system = system.with_parameters(values | followers)
    for component in system.components:
        note = component.note(system) if callable(component.note) else component.note
        if note and component.name not in replacements:
            progress.note(f"Note: {note}")
    # after the start values, which users write with the names and units of the original component
    for name, replacement in replacements.items():
        system, fit = replace_component(system, name, replacement, replacement_interfaces[name], interfaces)
        progress.report_replacement(fit)
        if fit.problems:
            first, *further = fit.problems
            more = f", and {format_count(len(further), 'more does', 'more do')} not fit" if further else ""
            raise CommandError(
                f"'{replacement.fmu}' cannot replace {name}: {first}{more}; a mapping may help.",
                component=name,
                problems=[str(p) for p in fit.problems],
            )
        fmus[name], interfaces[name] = replacement.fmu, replacement_interfaces[name]
        if sizes := find_changed_sizes(system.component(name), replacement_interfaces[name]):
            raise CommandError(
                f"'{replacement.fmu}' cannot replace {name}, which sets {join_names(sizes)}: the arrays of a "
                "replacement keep their own sizes."
            )
    # after the replacements, whose FMUs may have other kinds
    system = choose_kinds(system, options.kind, interfaces)
    for names in without_events:
        system = disable_event_mode(system, names, interfaces)
    return PreparedSystem(system, fmus, interfaces)


def _check_components(system: System, names: Sequence[str], values: Mapping[str, Value]) -> None:
    """Raise CommandError for components that do not exist, before FMUs are built for minutes."""
    for name in names:
        system.component(name)
    for name in values:
        with contextlib.suppress(ShortNameError):  # the variables of the FMUs may explain it
            if not has_wildcard(name):
                system.split(name)


def _list_structural_values(
    system: System, options: Options, interfaces: Mapping[str, Interface]
) -> dict[str, Value]:
    """Return the values among which those of structural parameters are: names depend on them."""
    values: dict[str, Value] = {}
    if options.parameters:
        from .parameter_files import file_values

        for file in options.parameters:
            values |= file_values(file, system, interfaces, structural_only=True)
    return {**values, **options.set}


def choose_kinds(system: System, kinds: Mapping[str, str], interfaces: Mapping[str, Interface]) -> System:
    """Return the system with components that run as these kinds; later patterns override earlier ones.

    A pattern that is not the name of a component skips FMUs without the kind.

    Raises:
        CommandError: If a kind is unknown, or no FMU that matches a pattern has it.
    """
    for pattern, kind in kinds.items():
        check_choice("kind", kind, KINDS)
        names = select_components([pattern], system, "change the option 'kind'.")
        able = [name for name in names if KINDS[kind] in interfaces[name].kinds]
        if not able:
            raise CommandError(
                f"no FMU has {KINDS[kind]} among {join_names(names)}; change the option 'kind'."
            )
        for name in able:
            system = system.with_component(replace(system.component(name), kind=kind))
    return system


def limit_to_data_end(options: Options) -> Options:
    """Return the options with a stop time no later than the end of input data that stop the run.

    Raises:
        CommandError: If the data cannot be read, or end before the run begins.
    """
    end = find_data_end(options.input, options.start_time or 0.0)
    if end is None or options.stop_time is None or options.stop_time <= end:
        return options
    start, stop = options.start_time or 0.0, end
    if options.step_size is not None and options.make_step_size_control().is_regular:
        # rounding must not cost the last step
        steps = math.floor((end - start) / options.step_size * (1.0 + 1e-12) + 1e-9)
        stop = float(f"{start + steps * options.step_size:.12g}")
    if not stop > start:
        raise CommandError(
            f"the data end at t = {end:.9g} s, which leaves no step for a run from t = {start:.9g} s; set an "
            "earlier start time."
        )
    return replace(options, stop_time=stop)


def _prepare_fmu_files(system: System, options: Options, progress: Progress) -> dict[str, Path]:
    """Return the FMU file of every component. Build built-in FMUs that are missing or out of date."""
    models = {c.model: c.model for c in system.components if c.fmu is None}
    # FILE.py:BLOCK names a block; other models stay as they are
    models |= {m: find_block(m) for m in models if isinstance(m, str) and ".py:" in m}
    progress.begin("preparing", len(models) + 1)
    built = {}
    # all of them before the first FMU is built
    for block in models.values():
        check_build_path(block, options.flavour, options.fmus, options.overwrite)
    for model, block in models.items():
        built[model] = build(
            block, options.flavour, options.platform, options.fmus, overwrite=options.overwrite
        )
        progress.advance(1)
    return {c.name: c.fmu if c.fmu is not None else built[c.model] for c in system.components}


def apply_parameter_files(
    system: System, files: Sequence[Path], interfaces: Mapping[str, Interface]
) -> System:
    """Return the system with the values of parameter files; later files override earlier ones."""
    if files:
        from .parameter_files import file_values

        for file in files:
            system = system.with_parameters(file_values(file, system, interfaces))
    return system


def disable_event_mode(system: System, names: Sequence[str], interfaces: Mapping[str, Interface]) -> System:
    """Return the system with components that run without event mode; those that have none are skipped.

    Args:
        system: The system, with the kinds as which its FMUs run.
        names: The components.
        interfaces: The model description of each component.

    Raises:
        CommandError: If none of them has event mode, or one has clocks, which tick in event mode only.
    """
    able = [n for n in names if _has_event_mode(system.component(n), interfaces[n])]
    if not able:
        raise CommandError(
            f"no FMU has event mode in co-simulation among {join_names(names)}; change the option "
            "'no_event_mode'."
        )
    for name in able:
        if clocks := interfaces[name].clocks:
            raise CommandError(
                f"{name} cannot run without event mode: its FMU has the clock '{clocks[0]}'. In the option "
                "'no_event_mode', name other components only.",
                component=name,
            )
        system = system.with_component(replace(system.component(name), event_mode=False))
    return system


def _has_event_mode(component: Component, interface: Interface) -> bool:
    kind = KINDS.get(component.kind) or next(iter(interface.kinds))
    return kind == CO_SIMULATION and bool(getattr(interface.kinds[kind], "hasEventMode", False))
