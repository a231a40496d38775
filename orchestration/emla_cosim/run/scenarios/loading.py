"""Load scenarios: built-in ones by name, scenario files, SSPs, FMUs, and systems made in Python."""

import contextlib
import math
import os
import re
import weakref
from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...base.errors import CommandError, join_names
from ...base.faults import accept_faults
from ...base.files import read_text
from ...fmu.interface import Interface, read_interface
from ...system.model import Component, System
from ..options import Options, list_options, read_options
from ..origin import RunOrigin, read_origin, with_gains
from .recorded import load_recorded_run
from .scenario import Scenario
from .scenario_file import (
    CHANGES,
    EXTENSIONS,
    FOLLOWING,
    REMARKS,
    SCENARIOS,
    STEPPING,
    SYSTEMS,
    ScenarioFile,
    find_built_in,
    parse_scenario,
)

if TYPE_CHECKING:
    from ...ssp.reader.flat_document import SspDocument
from collections.abc import Sequence
from dataclasses import dataclass

SPAN = 10.0
"""Default run time in s without a stop time."""

STEPS = 1000
"""Default number of steps without a step size."""


@dataclass(frozen=True)
class Times:
    """The times in s that an FMU or a package has; None if it has none."""

    start: float | None
    stop: float | None
    step: float | None


def read_times(interface: Interface) -> Times:
    """Return the times of an FMU's default experiment."""
    experiment = interface.description.defaultExperiment
    return Times(*(_read_seconds(experiment, name) for name in ("startTime", "stopTime", "stepSize")))


def choose_times(
    declared: Times, options: Options, owner: str, parts: Sequence[Times] = ()
) -> tuple[Times, list[str]]:
    """Return the times of a run, and a remark on each that is a default.

    Options override times of the owner. A missing stop is the latest of the parts, a missing step their
    shortest.

    Args:
        declared: times of the FMU or package.
        options: options of the user.
        owner: "FMU" or "package", for the remarks.
        parts: times of the FMUs in a package.
    """
    notes = list[str]()
    start = declared.start or 0.0 if options.start_time is None else options.start_time
    stop = options.stop_time
    if stop is None:
        stop, origin = declared.stop, ""
        if stop is None or not stop > start:
            later = [p.stop for p in parts if p.stop is not None and p.stop > start]
            stop, origin = (max(later), ", the longest of its FMUs") if later else (start + SPAN, "")
        if stop != declared.stop:
            fault = f"the {owner} has no stop time"
            if declared.stop is not None:
                fault = f"the stop time of the {owner}, {declared.stop:g} s,"
                fault += f" is not after the start at {start:g} s"
            notes.append(f"{fault}; without --stop-time it runs for {stop - start:g} s{origin}")
    step = options.step_size
    if step is None and not stop > start:  # no step is done, or the stop time is refused
        step = declared.step if declared.step is not None and declared.step > 0.0 else 1.0
    elif step is None:
        step, origin = declared.step, ""
        if step is None or not 0.0 < step <= stop - start:
            fitting = [p.step for p in parts if p.step is not None and 0.0 < p.step <= stop - start]
            step, origin = (
                (min(fitting), ", the shortest of its FMUs") if fitting else ((stop - start) / STEPS, "")
            )
            fault = f"the {owner} has no step size"
            if declared.step is not None:
                fault = (
                    f"the step size of the {owner}, {declared.step:g} s, does not fit into {stop - start:g} s"
                )
            notes.append(f"{fault}; without --step-size it is {step:g} s{origin}")
    return Times(start, stop, step), notes


def _read_seconds(experiment: Any, name: str) -> float | None:
    """Return a time of a default experiment in s, or None if it is missing or not finite."""
    text = getattr(experiment, name, None)
    seconds = math.nan if text is None else float(text)
    return seconds if math.isfinite(seconds) else None


_SSP = (".ssp", ".ssd")
_FMU = ".fmu"

_LONGEST = 60
"""Most letters of a component's name."""


def load_scenario(source: "str | Path | System", overrides: Mapping[str, Any]) -> Scenario:
    """Load a scenario.

    Args:
        source: Name of a built-in scenario, a `System`, or a path: a scenario file (.toml); an SSP (package,
            folder or SSD, with `#Variant.ssd` for another SSD than the default); an FMU; or the run.json of a
            run to repeat.
        overrides: Options by name.

    Raises:
        CommandError: If the source or an option is wrong.
    """
    if isinstance(source, System):
        return Scenario("system", "", source).with_options(overrides)
    if not isinstance(source, (str, Path)):
        raise CommandError(f"a scenario is a name, a path or a System, not {source!r}.")
    name, path = str(source), Path(source)
    if name in SCENARIOS:
        return _load_scenario_file(find_built_in(name), name, overrides, RunOrigin(name))
    if path.suffix.lower() == ".toml":
        text = read_text(path, "the scenario")
        scenario_file = parse_scenario(text, str(path), path.parent)
        return _load_scenario_file(scenario_file, path.stem, overrides, read_origin(path, text.encode()))
    if path.suffix.lower() == ".json":
        recorded = load_recorded_run(path, overrides)
        return load_scenario(recorded.source, recorded.with_options(overrides))
    scenario_file = ScenarioFile("", "", {}, str(path), Path())
    if is_fmu(path):
        return _load_fmu(path, None, scenario_file, overrides, _make_package_origin(path))
    if _is_ssp(path):
        return _load_ssp(path, None, scenario_file, overrides, _make_package_origin(path))
    raise CommandError(
        f"there is no scenario '{name}'; choose from {join_names(SCENARIOS)}, or name a file that ends in "
        ".toml, .ssp, .ssd or .fmu, or the run.json of a run.",
        name=name,
        choices=list(SCENARIOS),
    )


def _load_scenario_file(
    scenario_file: ScenarioFile, name: str, overrides: Mapping[str, Any], origin: RunOrigin
) -> Scenario:
    """Return the scenario of a file. Its options override the defaults; `overrides` override both."""
    system_file = _find_system_file(scenario_file)
    if system_file is None:
        file = scenario_file.folder / scenario_file.system
        if is_fmu(file):
            return _load_fmu(file, name, scenario_file, overrides, origin)
        if not _is_ssp(file):
            raise CommandError(
                f"the scenario '{scenario_file.where}' names the system '{scenario_file.system}', which is "
                f"neither an SSP, nor an FMU, nor a joint file, nor one of {join_names(SYSTEMS)}."
            )
        return _load_ssp(file, name, scenario_file, overrides, origin)
    values = read_options(overrides)
    files = (scenario_file,) if system_file is scenario_file else (system_file, scenario_file)
    layers = [with_gains(layer) for layer in (*(file.options for file in files), values)]
    options = reduce(Options.merged, layers, Options())
    if system_file.defaults is not None:  # they depend on the options, which override them
        options = reduce(Options.merged, layers, Options().merged(system_file.defaults(options)))
    arguments: dict[str, Any] = {}
    if options.mode is not None:
        if system_file.defaults is None:
            raise CommandError(
                f"'{scenario_file.where}' has no modes; --mode is for machine files, and for machines such "
                "as crane."
            )
        arguments["mode"] = options.mode
    if options.trajectory is not None:
        if system_file.defaults is None and system_file.system not in FOLLOWING:
            raise CommandError(
                f"'{scenario_file.where}' does not follow a trajectory; --trajectory is for "
                f"machine files, and for {join_names(sorted(FOLLOWING))}."
            )
        arguments["trajectory"] = options.trajectory
    if options.actuator or options.sheet:
        actuators = CHANGES["actuator"](
            system_file.system, options.actuator, options.sheet, system_file.sheets
        )
        options = replace(options, actuator=actuators)
        arguments["actuators"] = actuators
    if options.load_control is not None:
        arguments["load_control"] = options.load_control
    if options.notch:
        arguments["notch"] = options.notch
    make = system_file.make or SYSTEMS[system_file.system]
    with accept_faults(options.lenient):  # preparing lists them
        system = make(options.controller, options.gains, **arguments)
    if options.supply:
        system = EXTENSIONS["supply"](system)
    for further in STEPPING:
        options = options.merged(further(system, options.class_options))
    scenario = Scenario(
        name, scenario_file.description, system, options, origin=origin.updated(values), remarks=_list_remarks
    )
    return replace(scenario, notes=scenario.notes_with(options))


def _find_system_file(scenario_file: ScenarioFile) -> ScenarioFile | None:
    """Return the file that describes the system of a scenario: itself, a built-in one, or a file it names.

    Return None if the system is not a .toml file, either. Raise CommandError if that is only a scenario.
    """
    if scenario_file.make is not None:
        return scenario_file
    if scenario_file.system in SYSTEMS:
        return find_built_in(scenario_file.system)
    file = scenario_file.folder / scenario_file.system
    if file.suffix.lower() != ".toml":
        return None
    system_file = parse_scenario(read_text(file, "the system"), str(file), file.parent)
    if system_file.make is None:
        raise CommandError(
            f"the scenario '{scenario_file.where}' names the system '{scenario_file.system}', which is "
            f"itself a scenario file. Name its system instead: '{system_file.system}'."
        )
    return system_file


def _list_remarks(system: System, options: Options) -> list[str]:
    return [note for remark in REMARKS for note in remark(system, options)]


def _refuse_built_in_options(scenario_file: ScenarioFile, overrides: Mapping[str, Any]) -> None:
    """Raise CommandError if an option for built-in systems is set for another system."""
    for name, option in list_options().items():
        if option.makes and (name in overrides or name in scenario_file.options):
            raise CommandError(
                f"'{scenario_file.where}' has its own {option.makes}; {option.flag} is for built-in systems."
            )


def _load_fmu(
    path: Path, name: str | None, scenario_file: ScenarioFile, overrides: Mapping[str, Any], origin: RunOrigin
) -> Scenario:
    """Return the scenario of an FMU, with the options of a scenario file."""
    _refuse_built_in_options(scenario_file, overrides)
    values = read_options(overrides)
    options = Options().merged(scenario_file.options).merged(values)
    with accept_faults(options.lenient):  # preparing lists them
        interface = read_interface(path)
        name_of_model = make_component_name(str(interface.description.modelName))
        times, notes = _read_fmu_times(interface, options)
    return Scenario(
        name or name_of_model,
        scenario_file.description or " ".join(str(interface.description.description or "").split()),
        System((Component(name_of_model, fmu=path),), ()),
        options.updated(times),
        tuple(notes),
        origin=origin.updated(values),
    )


def make_component_name(model: str) -> str:
    """Return the component name for a model: the last part of its name, with _ for other signs.

    Letters, digits and _ stay; it has at most `_LONGEST` letters and does not begin with a digit.

    `Modelica.Blocks.PID 2` is `PID_2`.
    """
    name = re.sub(r"\W+", "_", model.rpartition(".")[2])[:_LONGEST].strip("_")
    return name if name and not name[0].isdigit() else f"model_{name}".strip("_")


def _read_fmu_times(interface: Interface, options: Options) -> tuple[dict[str, float], list[str]]:
    """Return start, stop and step of a run as options, and remarks on missing and unsuitable ones."""
    declared = read_times(interface)
    times, notes = choose_times(declared, options, "FMU")
    start, stop, step = times.start or 0.0, times.stop or 0.0, times.step or 0.0
    option_values, span = (options.start_time, options.stop_time, options.step_size), stop - start
    is_declared = option_values == (None, None, None) and step == declared.step
    if is_declared and abs(round(span / step) * step - span) > 1e-9 * span:
        fitting = span / math.ceil(span / step)
        notes.append(f"its steps of {step:g} s do not end at {stop:g} s; the run uses steps of {fitting:g} s")
        step = fitting
    return {"start_time": start, "stop_time": stop, "step_size": step}, notes


def _load_ssp(
    path: Path, name: str | None, scenario_file: ScenarioFile, overrides: Mapping[str, Any], origin: RunOrigin
) -> Scenario:
    """Return the scenario of an SSP, with the options of a scenario file."""
    from ...ssp.reader.flat_document import read_ssp

    _refuse_built_in_options(scenario_file, overrides)
    resources = contextlib.ExitStack()
    of_file = Options().merged(scenario_file.options)
    values = read_options(overrides)
    with accept_faults(of_file.merged(values).lenient) as faults:
        document = resources.enter_context(read_ssp(path))
        weakref.finalize(document, resources.close)  # it names unpacked FMUs
        times, notes = _read_ssp_times(document, of_file.merged(values))
    # a scenario file overrides the times of the package
    options = Options().updated(times).merged(scenario_file.options)
    return Scenario(
        name or document.name,
        scenario_file.description or document.description,
        document.system,
        options.merged(values),
        (*document.notes, *notes),
        document.unpacked,
        document,
        origin.updated(values),
        accepted=faults.by_file,
    )


def _make_package_origin(path: Path) -> RunOrigin:
    """Return the origin for an SSP or an FMU, with its hash if it is a single file."""
    file = path if _is_file(path) else _strip_variant(path)
    return read_origin(path, file.read_bytes() if _is_file(file) else None)


def _read_ssp_times(document: "SspDocument", options: Options) -> tuple[dict[str, float], list[str]]:
    """Return the times of an SSP as options, and remarks on defaults for those that nothing sets."""
    times, notes = Times(document.start_time, document.stop_time, document.step_size), list[str]()
    pairs = ((times.stop, options.stop_time), (times.step, options.step_size))
    if any(declared is None and option is None for declared, option in pairs):
        files = [c.fmu for c in document.system.components if c.fmu is not None]
        parts = [read_times(read_interface(file)) for file in dict.fromkeys(files)]
        times, notes = choose_times(times, options, "package", parts)
    all_times = {"start_time": times.start, "stop_time": times.stop, "step_size": times.step}
    return {name: value for name, value in all_times.items() if value is not None}, notes


def is_fmu(path: Path) -> bool:
    """Return whether a path names an FMU. PACKAGE.ssp#x.fmu names a variant of a package."""
    return path.suffix.lower() == _FMU and not _is_folder(path) and (_is_file(path) or not _is_ssp(path))


def _is_ssp(path: Path) -> bool:
    """Return whether a path names an SSP by its ending, or any folder, with or without a variant."""
    return any(x.suffix.lower() in _SSP or _is_folder(x) for x in (path, _strip_variant(path)))


def _strip_variant(path: Path) -> Path:
    return path.parent / path.name.partition("#")[0]


def _is_folder(path: Path) -> bool:
    return os.path.isdir(path)  # noqa: PTH112 - False also for a name that is too long or invalid


def _is_file(path: Path) -> bool:
    return os.path.isfile(path)  # noqa: PTH113
