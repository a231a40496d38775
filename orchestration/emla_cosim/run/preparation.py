"""Prepare a system to run or to export: build FMUs, apply parameter files, replace components."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from ..base.errors import CommandError, check_choice, join_names
from ..base.patterns import matches_pattern
from ..base.progress import Progress
from ..base.wording import format_count
from ..fmu.interface import KINDS, Interface, read_interface, read_interfaces
from ..fmu.models import build, check_build_path, find_block
from ..inputs.wired_inputs import LoadedInput, find_data_end, wire_inputs
from ..system.model import Replacement, System, Value
from ..system.signal_faults import add_fault_components, wire_faults
from ..system.start_values import (
    has_quantities,
    needs_interfaces,
    resolve_quantities,
    resolve_start_values,
    select_plain_names,
)
from ..system.structure import (
    read_sized_interfaces,
    read_structural_interfaces,
    set_structure,
    structure_of,
)
from ..system.vectors import connect_elements
from .event_mode import disable_event_mode
from .followers import following_values
from .options import Options
from .replacement import replace_component
from .run_setup import select_components


def prepare_system(system: System, options: Options, progress: Progress) -> tuple[System, dict[str, Path]]:
    """Apply the options to a system, and build its FMUs.

    The progress of preparing has one unit more, for what the caller does next.

    Returns:
        The changed system, and the FMU file of every component.

    Raises:
        CommandError: If an option does not fit the system.
        RunError: If an FMU cannot be built.
    """
    tables, as_made = [LoadedInput.of(source) for source in options.input], system
    all_without = "--no-event-mode without a name means all components."
    without_events = [select_components([p], system, all_without) for p in options.no_event_mode]
    system, faults = add_fault_components(system.with_main(), options.fault)
    system.with_parameters(select_plain_names(options.set))  # report unknown names before anything is built
    replacements = options.replacements()
    for name in replacements:
        system.component(name)
    fmus = _fmu_files(system, options, progress)
    system = _set_structure(system, fmus, options)
    system = connect_elements(system, cache(partial(_variable_names, system, fmus)))
    looked_at = options.parameters or replacements or faults or tables or needs_interfaces(options.set)
    looked_at = looked_at or options.kind or without_events or has_quantities(system)
    interfaces = read_sized_interfaces(system, fmus) if looked_at else {}
    system = apply_parameter_files(resolve_quantities(system, interfaces), options.parameters, interfaces)
    if tables:
        placed = wire_inputs(system, tables, interfaces, options.platform)
        system = placed.system
        fmus |= placed.fmus
        interfaces |= read_interfaces(placed.fmus)
        for note in placed.notes:
            progress.note(f"Note: {note}")
    system = wire_faults(system, faults, interfaces)
    followers = following_values(as_made, options)
    system = system.with_parameters(resolve_start_values(system, interfaces, options.set) | followers)
    for component in system.components:
        note = component.note(system) if callable(component.note) else component.note
        if note and component.name not in replacements:
            progress.note(f"Note: {note}")
    others = read_interfaces({name: replacement.fmu for name, replacement in replacements.items()})
    for name, replacement in replacements.items():
        system = _replace_component(system, name, replacement, others[name], interfaces, progress)
        fmus[name], interfaces[name] = replacement.fmu, others[name]
        if sizes := structure_of(system.component(name), others[name]):
            raise CommandError(
                f"'{replacement.fmu}' cannot replace {name}, which sets {join_names(sizes)}: the arrays of a "
                "replacement keep their own sizes."
            )
    system = resolve_quantities(system, interfaces)  # also of variables that only a replacement has
    system = choose_kinds(system, options.kind, interfaces)
    for names in without_events:
        system = disable_event_mode(system, names, interfaces)
    return system, fmus


def _variable_names(system: System, fmus: Mapping[str, Path], name: str) -> Collection[str]:
    """Return the names of a component's variables; those of an FMU file are read."""
    component = system.component(name)
    model = component.model
    if not model:
        interface = read_interface(fmus[name])
        structure = structure_of(component, interface)
        return (read_interface(fmus[name], structure) if structure else interface).variables
    block = find_block(model) if isinstance(model, str) else model
    return {scalar.name: None for scalar in block.layout().scalars}


def _set_structure(system: System, fmus: Mapping[str, Path], options: Options) -> System:
    """Return the system with the structural parameters that the options set: names depend on them."""
    interfaces = read_structural_interfaces({c.name: fmus[c.name] for c in system.components if c.fmu})
    if not interfaces:
        return system
    values: dict[str, Value] = {}
    if options.parameters:
        from .parameter_files import structural_file_values

        for file in options.parameters:
            values |= structural_file_values(file, system, interfaces)
    return set_structure(system, interfaces, values | select_plain_names(options.set))


def choose_kinds(system: System, kinds: Mapping[str, str], interfaces: Mapping[str, Interface]) -> System:
    """Return the system with components that run as these kinds; later patterns override earlier ones.

    A pattern that is not the name of a component skips FMUs without the kind.

    Raises:
        CommandError: If a kind is unknown, or no FMU that matches a pattern has it.
    """
    for pattern, kind in kinds.items():
        check_choice("kind", kind, KINDS)
        matching = [c for c in system.components if matches_pattern(c.name, pattern)]
        if not matching:
            raise CommandError(f"no component matches '{pattern}' of the option 'kind'.", name=pattern)
        able = [c for c in matching if KINDS[kind] in interfaces[c.name].kinds]
        if not able:
            names = join_names([c.name for c in matching])
            raise CommandError(f"no FMU has {KINDS[kind]} among {names}; change the option 'kind'.")
        for component in able:
            system = system.with_component(replace(component, kind=kind))
    return system


def limit_to_data_end(options: Options) -> Options:
    """Return the options with a stop time no later than the end of input data that stop the run.

    Raises:
        CommandError: If the data cannot be read, or end before the run begins.
    """
    end = find_data_end(options.input)
    if end is None or options.stop_time is None or options.stop_time <= end:
        return options
    start, stop = options.start_time or 0.0, end
    if options.step_size is not None and options.make_step_size_control().is_regular:
        steps = math.floor((end - start) / options.step_size * (1.0 + 1e-12) + 1e-9)
        stop = float(f"{start + steps * options.step_size:.12g}")
    if not stop > start:
        raise CommandError(
            f"the data end at t = {end:.9g} s, less than a step after the run begins at t = {start:.9g} s."
        )
    return replace(options, stop_time=stop)


def _fmu_files(system: System, options: Options, progress: Progress) -> dict[str, Path]:
    """Return the FMU file of every component. Build built-in FMUs that are missing or out of date."""
    models = list(dict.fromkeys(c.model for c in system.components if c.fmu is None))
    progress.begin("preparing", len(models) + 1)
    built = {}
    for model in models:
        check_build_path(model, options.flavour, options.fmus, options.overwrite)
    for model in models:
        built[model] = build(
            model, options.flavour, options.platform, options.fmus, overwrite=options.overwrite
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


def _replace_component(
    system: System,
    name: str,
    replacement: Replacement,
    other: Interface,
    interfaces: Mapping[str, Interface],
    progress: Progress,
) -> System:
    changed, fit = replace_component(system, name, replacement, other, interfaces)
    progress.report_replacement(fit)
    if fit.problems:
        first, *others = fit.problems
        more = f", and {format_count(len(others), 'more does', 'more do')} not fit" if others else ""
        raise CommandError(
            f"'{replacement.fmu}' cannot replace {name}: {first}{more}; a mapping may help.",
            component=name,
            problems=[str(p) for p in fit.problems],
        )
    return changed
