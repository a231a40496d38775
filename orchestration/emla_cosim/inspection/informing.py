"""Reads what there is to know of an FMU, a package or a scenario."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmpy.model_description import ValidationError

from ..base.errors import CommandError, called_as_in
from ..base.option import BUILDING
from ..base.progress import Progress
from ..base.units import IDENTITY
from ..fmu.interface import Interface, described, first_problem, read_interfaces, unfit
from ..run.options import table
from ..run.preparation import prepared
from ..run.scenarios.reading import is_fmu
from ..run.scenarios.scenario import Scenario
from ..run.scenarios.single_fmu import component_name
from ..study.loading import load
from ..system.model import Component, System
from ..system.resolution import resolved
from .fmus import fmu_info
from .parts import ComponentInfo, ConnectionInfo, FmuInfo
from .told import Info
from .variables import End, Rows, Wires, names_in, said_by


def info(source: str | Path | System, progress: Progress | None = None, **options: Any) -> Info:
    """What an FMU, a package, a scenario or a system is made of, with all that options change.

    `source` and `options` are as in `load`. Our own FMUs are built where they are missing; nothing is
    simulated. An FMU that this master cannot run is told of, too. Raises CommandError for whatever is
    wrong, RunError where FMUs cannot be built.
    """
    try:
        scenario = load(source, **options)
    except CommandError:
        of_ours = {n for n, one in table().items() if one.about.stage == BUILDING or not one.about.repeated}
        if set(options) - of_ours or not isinstance(source, (str, Path)) or not is_fmu(Path(source)):
            raise
        return _of_any_fmu(Path(source))
    with called_as_in(scenario.unpacked):
        told = progress or Progress()
        system, files = prepared(scenario.system, scenario.options, told)
        found = _of_system(scenario, system, files, read_interfaces(files))
    told.advance(1)
    return found


def _of_system(
    scenario: Scenario, system: System, files: Mapping[str, Path], interfaces: Mapping[str, Interface]
) -> Info:
    names = {
        (c.name, variable): f"{c.name}.{name}"
        for c in system.components
        for variable, (name, _) in names_in(c).items()
    }
    wired = resolved(system, interfaces)
    readers: dict[End, list[End]] = {}
    for x in wired.connections:
        readers.setdefault(x.ends[0], []).append(x.ends[1])
    wires = Wires({x.ends[1]: x.ends[0] for x in wired.connections}, readers, names)
    connections = (
        ConnectionInfo(wires.name(x.ends[0]), wires.name(x.ends[1]), by.factor, by.offset)
        for x in wired.connections
        for by in (x.transformation or IDENTITY,)
    )
    used = {file: interfaces[name] for name, file in files.items()}
    places = {file: place for place, file in enumerate(used)}
    fmus = tuple(fmu_info(file, _shown(file, scenario.unpacked), of) for file, of in used.items())
    said = [said_by(of) for of in used.values()]
    rows = (
        v
        for c in system.components
        for v in Rows(c, interfaces[c.name], said[places[files[c.name]]], wires).all()
    )
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
        notes=tuple(scenario.notes),
        fmus=fmus,
        components=tuple(components),
        connections=tuple(connections),
        variables=tuple(rows),
    )


def _of_any_fmu(path: Path) -> Info:
    """What an FMU says that this master cannot run: of another version or kind, or against the standard."""
    interface, reason = _read(path)
    try:
        fmu = fmu_info(path, str(path), interface)
        name = component_name(fmu.model)
        alone, wires = Component(name, fmu=path), Wires({}, {}, {})
        rows = Rows(alone, interface, said_by(interface), wires, runnable=False).all()
    except (CommandError, MemoryError):
        raise
    except Exception as error:  # of numbers that are none, where nobody has looked before
        raise CommandError(f"'{path}' is not an FMU that can be read: {error}.") from error
    return _alone(name, fmu, reason, rows)


def _read(path: Path) -> tuple[Interface, str]:
    """The interface of an FMU, and why this master cannot run it."""
    wrong = "cannot be run"
    try:
        interface = described(path)
    except ValidationError as error:
        wrong = f"is not valid: {first_problem(error)}"
        try:
            interface = described(path, validate=False)
        except ValidationError as more:
            raise CommandError(f"'{path}' is not a valid FMU: {first_problem(more)}.") from more
    return interface, unfit(interface) or wrong


def _alone(name: str, fmu: FmuInfo, reason: str, rows: list[Any]) -> Info:
    return Info(
        name=name,
        description=fmu.description,
        start_time=fmu.start_time,
        stop_time=fmu.stop_time,
        step_size=fmu.step_size,
        notes=(f"the FMU cannot be run here: it {reason}",),
        fmus=(fmu,),
        components=(ComponentInfo(name, fmu.model, 0),),
        connections=(),
        variables=tuple(rows),
    )


def _shown(file: Path, unpacked: Path | None) -> str:
    """What a file is called: one of a package PACKAGE.ssp/FILE."""
    if unpacked is not None and file.is_relative_to(unpacked):
        return str(file.relative_to(unpacked))
    return str(file)
