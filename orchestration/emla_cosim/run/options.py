"""The table of options: everything a user may say about a run, each stated once.

The command line, scenario files, run.json, and what a checkpoint belongs to all derive from it.
Algorithms, step-size controls and recorders bring options of their own: the fields of their classes.
"""

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from ..base.errors import CommandError, listed
from ..base.option import (
    BUILD,
    BUILDING,
    COMPARE,
    EXPORT,
    INFO,
    LEFT_OUT,
    LOADING,
    OUTPUT,
    PLOT,
    PREPARING,
    RUN,
    SAME,
    SHOWING,
    STEPPING,
    SWEEP,
    SYSTEM,
    TRAJECTORY,
    VERIFY,
    Entered,
    Option,
    option,
    options_of,
)
from ..base.patterns import fits, has_wildcard
from ..base.quantities import quantity, unit_named
from ..base.values import converted
from ..fmu.models import FLAVOURS, PLATFORMS
from ..inputs.input import Input
from ..master.algorithms.algorithm import Algorithm
from ..master.algorithms.registry import ALGORITHMS
from ..master.stepping.registry import STEP_SIZE_CONTROLS
from ..master.stepping.step_size_control import StepSizeControl
from ..recorders.recorder import Recorder
from ..recorders.registry import RECORDERS, TABLES, table_names
from ..recorders.tubes.tolerance import Tolerance, read_tolerances
from ..system.bond import Bond
from ..system.fault import Fault, read_faults
from ..system.model import Replacement, Value

_Kind = TypeVar("_Kind")

ALL = (RUN, EXPORT, SWEEP, COMPARE, INFO)


def read_threads(text: str) -> int | None:
    """A number of threads, or None for `auto`; CommandError for any other text."""
    if text == "auto":
        return None
    try:
        return int(text)
    except ValueError as error:
        raise CommandError(f"--threads {text} is neither a whole number nor auto.") from error


_system = partial(option, group=SYSTEM, commands=ALL)
_prepared = partial(_system, stage=PREPARING)
_stepping = partial(option, group=STEPPING)
_output = partial(option, group=OUTPUT)
_shown = partial(_output, recorded=False, stage=SHOWING, in_sweep=LEFT_OUT)


@dataclass(frozen=True)
class Options:
    """What a user may say about a run; None takes the scenario's value, or the default. Times in s.

    `own` has those of algorithms, step-size controls and recorders, by name; see `ALGORITHMS`,
    `STEP_SIZE_CONTROLS` and `RECORDERS`.
    """

    set: Mapping[str, Value] = _system(
        {},
        help="Set a start value or parameter; * in the name for several, with a unit if you like, such as "
        "'lift.disturbance.load.level[*]=30 kN' (repeatable).",
        metavar="COMPONENT.VARIABLE=VALUE",
        arrays=True,
        in_sweep=SAME,
    )
    follow_models: bool = _system(
        False,
        help="Set the model parameters of controllers and observers to fit the plant that --set and --vary "
        "make. Gains stay.",
    )
    parameters: Sequence[Path] = _prepared(
        [],
        help="Set start values from an SSP parameter file (.ssv), or from a table, CSV or Parquet: "
        "docs/inputs.md. --set wins over it (repeatable).",
        metavar="FILE",
    )
    replace: Mapping[str, Replacement] = _prepared(
        {},
        help="Put your FMU in the place of a component, such as lift.controller=mine.fmu (repeatable).",
        metavar="COMPONENT=FILE.fmu",
    )
    mapping: Mapping[str, Path] = _prepared(
        {},
        help="File that says what the FMU of --replace calls its variables, an SSP parameter mapping "
        "(repeatable).",
        metavar="COMPONENT=FILE.ssm",
        in_sweep=SAME,
    )
    fault: Sequence[Fault] = _prepared(
        [],
        help="Let a signal fail from START on, for DURATION, both in s: freeze, offset, gain or constant. "
        "Commas between several.",
        metavar="SIGNAL=KIND[:VALUE]@START[+DURATION]",
        parse=read_faults,
        in_sweep=SAME,
    )
    input: Sequence[Input] = _prepared(
        [],
        help="Data that drive signals, from CSV or Parquet (repeatable).",
        metavar="FILE[:SIGNAL=COLUMN,...,end=repeat]",
    )
    controller: str | type | None = _prepared(
        takes=type,
        help="Controller of all joints: a name (`emla list` shows them), your FMU, or your block as "
        "FILE.py:BLOCK.",
        commands=(RUN, EXPORT, SWEEP, INFO),
        makes="gains",
    )
    gains: str | None = _prepared(
        help="Set of gains for controller and observer (`emla list` shows them). Default: the controller's "
        "first.",
        commands=(RUN, EXPORT, SWEEP, INFO),
        makes="gains",
    )
    trajectory: Path | None = _prepared(
        help="Motion that the manipulator follows, a file that `emla trajectory` wrote.",
        metavar="FILE.json",
        makes="reference",
    )
    actuator: Mapping[str, Path | Entered] = _prepared(
        {},
        help="Another actuator for a joint, from its data sheets: docs/actuator.md (repeatable).",
        metavar="JOINT=FILE.toml",
        takes=Entered,
        makes="actuators",
    )
    flavour: str = _system(
        "native",
        help="Which build of our own FMUs: compiled (native), or Python inside (python).",
        choices=lambda: FLAVOURS,
        stage=BUILDING,
    )
    fmus: Path | None = _system(
        help="Folder of our own FMUs; missing ones are built there. Default: fmus/ if it has them, else your "
        "cache.",
        in_file=False,
        recorded=False,
        writes="folder",
        stage=BUILDING,
    )
    platform: Sequence[str] = option(
        [],
        group=SYSTEM,
        help="Platform to compile our own FMUs for (repeatable). Default: this machine's.",
        choices=lambda: PLATFORMS,
        commands=(EXPORT,),
        in_file=False,
        recorded=False,
        stage=BUILDING,
    )
    start_time: float | None = _stepping(
        help="Simulated time at which the run begins. Default: the scenario's, or 0.",
        unit="s",
        identity="start time",
        commands=ALL,
    )
    stop_time: float | None = _stepping(
        help="Simulated time at which the run ends. Default: the scenario's.", unit="s", commands=ALL
    )
    step_size: float | None = _stepping(
        help="Time between two exchanges of values between the FMUs. Default: the scenario's.",
        unit="s",
        identity="step size",
        commands=ALL,
    )
    algorithm: str | Algorithm = _stepping(
        "gauss-seidel",
        help="In which order FMUs step and exchange values, see docs/master.md.",
        choices=lambda: ALGORITHMS,
        identity="algorithm",
        takes=Algorithm,
    )
    step_size_control: str | StepSizeControl | None = _stepping(
        help="What decides how long steps are. Default: the one that has the options that are given, such as "
        "error with --error-tolerance; without such options fixed.",
        choices=lambda: STEP_SIZE_CONTROLS,
        identity="step-size control",
        takes=StepSizeControl,
    )
    isolate: Sequence[str] | bool = _system(
        [],
        help="Run a component in a process of its own, so that a crash ends it alone (repeatable, * for "
        "several). Without a name: all.",
        metavar="[COMPONENT]",
        commands=(RUN, SWEEP, COMPARE),
        takes=bool,
        alone="*",
        stage=LOADING,
        in_sweep=SAME,
    )
    compiled: bool = _stepping(
        True,
        help="Step in compiled code where that is possible; the results are the same.",
        flag="--kernel",
        in_file=False,
        recorded=False,
    )
    threads: int | None = _stepping(
        help="Threads that step FMUs; the results are the same. Default: auto, as many as there are cores, "
        "where that is measured to be faster.",
        metavar="N|auto",
        parse=read_threads,
        in_file=False,
        recorded=False,
        commands=(RUN,),
    )
    real_time: float | None = _stepping(
        help="Simulate at most so many seconds per second. Default: as fast as it goes.",
        flag="--realtime",
        metavar="FACTOR",
        record="real_time_factor",
        commands=(RUN,),
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    output: Path | None = _shown(
        help="Folder for all that comes out. Default: results/SCENARIO.", writes="folder"
    )
    overwrite: bool = _output(
        False,
        help="Replace files that emla did not write; never links, folders, devices or pipes.",
        in_file=False,
        recorded=False,
        repeated=False,
        commands=(*ALL, BUILD, PLOT, TRAJECTORY, VERIFY),
    )
    output_format: str = _output(
        "csv", help="File format of the table of results.", choices=lambda: TABLES, commands=(RUN,)
    )
    signals: Sequence[str] = _output(
        [],
        help="Signals to keep in the table, such as 'lift.plant.*' (repeatable). Default: all.",
        metavar="PATTERN",
        commands=(RUN,),
        in_sweep=LEFT_OUT,
    )
    output_interval: float | None = _output(
        help="Time between rows of the table. Default: 1 ms.", unit="s", identity="output interval"
    )
    roles: Mapping[str, str] = _output(
        {},
        help="Signal that plays a role for a joint, such as lift.x_L=axis.position (repeatable).",
        flag="--role",
        metavar="JOINT.ROLE=SIGNAL",
        commands=(RUN, SWEEP),
        identity="roles",
    )
    criteria: Mapping[str, float | str] = _output(
        {},
        help="What a joint is judged by, such as 'lift.position_window=0.5 mm', or * for all joints: "
        "docs/metrics.md (repeatable).",
        flag="--criterion",
        metavar="JOINT.CRITERION=VALUE",
        identity="criteria",
    )
    bonds: Mapping[str, str] = _output(
        {},
        help="Two signals that form a power bond, such as axis='load.F * actuator.v': how much energy the "
        "coupling creates or destroys there is reported (repeatable).",
        flag="--bond",
        metavar="NAME='EFFORT * FLOW'",
        commands=(RUN, SWEEP),
        identity="bonds",
    )
    require: Sequence[str] = _output(
        [],
        help="Fail unless this holds, such as 'lift.position_error_m < 2e-5' (repeatable).",
        metavar="'FIGURE < VALUE'",
        commands=(RUN, SWEEP),
        in_sweep=SAME,
    )
    reference: Path | None = _output(
        help="Fail unless every signal agrees with that of an earlier run, whose folder this is.",
        metavar="FOLDER",
        commands=(RUN,),
        in_file=False,
    )
    tolerance: Mapping[str, Tolerance] = _output(
        {},
        help="How far signals may be off in --reference, as a part of their range; of all, or of those that "
        "PATTERN means (repeatable). Default: 1e-3.",
        metavar="[PATTERN=]NUMBER",
        commands=(RUN,),
        in_file=False,
        parse=read_tolerances,
    )
    plots: bool = _shown(True, help="Draw pictures into the output folder.")
    animate: bool = _shown(False, help="Draw an animation of the manipulator, a GIF.", commands=(RUN,))
    report: bool = _shown(False, help="Write a page to look at and to keep, report.html.", commands=(RUN,))
    checkpoint: Path | None = _output(
        help="Save the state of the run to this file every minute and at the end, for --resume.",
        in_file=False,
        recorded=False,
        writes="file",
        commands=(RUN,),
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    resume: Path | None = _output(
        help="Continue the run whose state this file of --checkpoint holds.",
        in_file=False,
        record="resumed_from",
        commands=(RUN,),
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    own: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def updated(self, given: Mapping[str, Any], where: str = "", folder: Path | None = None) -> "Options":
        """Read values as `read_options` does, and return the options with them; CommandError as there."""
        return self.merged(read_options(given, where, folder))

    def merged(self, values: Mapping[str, Any]) -> "Options":
        """Return the options with values that `read_options` returned, merged as `merge` does."""
        if not values:
            return self
        both = merge({**{n: getattr(self, n) for n in values if n in _FIXED}, **self.own}, values)
        own = {name: both.pop(name) for name in [*both] if name not in _FIXED}
        return dataclasses.replace(self, **both, own=own)

    @property
    def algorithm_name(self) -> str:
        """The name of the algorithm; for one of the user's own, that of its class."""
        return _name_of(self.algorithm, ALGORITHMS)

    @property
    def step_size_control_name(self) -> str:
        """The name of the step-size control that applies; for one of the user's own, that of its class."""
        if self.step_size_control is not None:
            return _name_of(self.step_size_control, STEP_SIZE_CONTROLS)
        asked = (n for n, kind in STEP_SIZE_CONTROLS.items() if not _names(kind).isdisjoint(self.own))
        return next(asked, next(iter(STEP_SIZE_CONTROLS)))

    @property
    def isolated(self) -> Sequence[str]:
        """Patterns of the components to isolate."""
        if isinstance(self.isolate, bool):
            return ["*"] if self.isolate else []
        return self.isolate

    def replacements(self) -> dict[str, Replacement]:
        """Replacements by component, with the mappings that are given apart from them.

        Raises CommandError for a mapping of a component that is not replaced.
        """
        found = dict(self.replace)
        for name, file in self.mapping.items():
            if name not in found:
                raise CommandError(f"--mapping {name}={file} needs --replace {name}=FILE.fmu.")
            found[name] = dataclasses.replace(found[name], mapping=file)
        return found

    def files_read(self) -> dict[Path, str]:
        """The files that a run reads, and what they are."""
        found = dict.fromkeys(self.parameters, "the parameter set")
        for replacement in self.replacements().values():
            found[replacement.fmu] = "the FMU"
            if replacement.mapping is not None:
                found[replacement.mapping] = "the mapping"
        if self.trajectory is not None:
            found[self.trajectory] = "the trajectory"
        found |= {source.file: "the input" for source in self.input if source.file is not None}
        for actuator in self.actuator.values():
            if (file := actuator.file if isinstance(actuator, Entered) else actuator) is not None:
                found[file] = "the actuator"
        if isinstance(self.controller, str) and self.controller.lower().endswith(".fmu"):
            found[Path(self.controller)] = "the FMU"
        if self.reference is not None:
            for table in (self.reference, *(self.reference / name for name in table_names())):
                found[table] = "the run to compare with"
        return found

    def read_bonds(self) -> dict[str, Bond]:
        """Return the power bonds by name; CommandError for a text that is none."""
        return {name: Bond.read(name, text) for name, text in self.bonds.items()}

    def make_algorithm(self) -> Algorithm:
        """The algorithm with its options; CommandError for one that it does not have."""
        return self._made(self.algorithm, ALGORITHMS, "algorithm")

    def make_step_size_control(self) -> StepSizeControl:
        """Return the step-size control with its options; CommandError for what does not fit."""
        chosen = self.step_size_control or self.step_size_control_name
        found = self._made(chosen, STEP_SIZE_CONTROLS, "step-size control")
        found.check()
        return found

    def _made(self, chosen: str | _Kind, kinds: Mapping[str, type[_Kind]], what: str) -> _Kind:
        """Return the one of these kinds that is chosen, with its options."""
        given = {n: v for n, v in self.own.items() if any(n in _names(k) for k in kinds.values())}
        if not isinstance(chosen, str):
            if given:
                raise CommandError(f"the {what} is given with its options; leave out {listed(given)}.")
            return chosen
        for name in given:
            if name not in _names(kinds[chosen]):
                others = [n for n, k in kinds.items() if name in _names(k)]
                has = "has" if len(others) == 1 else "have"
                raise CommandError(
                    f"the {what} {chosen} has no {table()[name].noun}; {listed(others)} {has}.", option=name
                )
        return kinds[chosen](**given)

    def make_recorders(self) -> list[Recorder]:
        """Those of `RECORDERS` that an option asks for."""
        asked = (
            (kind, {n: v for n, v in self.own.items() if n in _names(kind)}) for kind in RECORDERS.values()
        )
        return [kind(**given) for kind, given in asked if given]

    def in_effect(self) -> list[tuple[Option, Any]]:
        """Every option that applies, with its value."""
        found = [(o, getattr(self, o.name)) for o in _FIXED.values()]
        for part in (self.make_algorithm(), self.make_step_size_control(), *self.make_recorders()):
            found += [(o, getattr(part, o.name)) for o in options_of(type(part))]
        has = {o.name for o, _ in found}
        unused = {o.name: o for kind in STEP_SIZE_CONTROLS.values() for o in options_of(kind)}
        return found + [(o, None) for name, o in unused.items() if name not in has]


_FIXED = {o.name: o for o in options_of(Options)}


def table(command: str | None = None) -> dict[str, Option]:
    """All options by name, those of registered kinds included; of one command if it is named."""
    kinds = (*ALGORITHMS.values(), *STEP_SIZE_CONTROLS.values(), *RECORDERS.values())
    own = {o.name: o for kind in kinds for o in options_of(kind)}
    return {n: o for n, o in (_FIXED | own).items() if command is None or command in o.about.commands}


def repeated(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by name, but for those that hold for one command."""
    known = table()
    return {n: v for n, v in options.items() if n not in known or known[n].about.repeated}


def merge(before: Mapping[str, Any], later: Mapping[str, Any]) -> dict[str, Any]:
    """Merge values of options by name: tables are merged, everything else is replaced."""
    tables = {n for n, value in later.items() if isinstance(value, Mapping) and before.get(n)}
    return {**before, **{n: _merged(before[n], v) if n in tables else v for n, v in later.items()}}


def _merged(before: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, Any]:
    """Two tables as one: what was found later wins, over names that its patterns mean too."""
    patterns = [name for name in found if has_wildcard(name)]
    kept = {n: v for n, v in before.items() if n not in found and not any(fits(n, p) for p in patterns)}
    return {**kept, **found}


def _name_of(chosen: str | _Kind, kinds: Mapping[str, type[_Kind]]) -> str:
    if isinstance(chosen, str):
        return chosen
    return next((n for n, k in kinds.items() if k is type(chosen)), type(chosen).__name__)


def _names(kind: type) -> set[str]:
    return {o.name for o in options_of(kind)}


def read_options(given: Mapping[str, Any], where: str = "", folder: Path | None = None) -> dict[str, Any]:
    """Read values of options, by name, as their types.

    `where` is what sentences call the place of the values, and paths in them are relative to `folder`.
    Raises CommandError for an unknown name, or a value of another type or range.
    """
    known, of = table() if given else {}, f" of {where}" if where else ""
    return {
        name: read_option(name, value, f"'{name}'{of}" if of else f"the option '{name}'", folder, known)
        for name, value in given.items()
    }


def read_option(
    name: str, value: Any, label: str, folder: Path | None = None, known: Mapping[str, Option] | None = None
) -> Any:
    """The value of an option as its type; sentences call it `label`, paths are relative to `folder`.

    Raises CommandError for a name that is none of `known`, and for a value of another type or range.
    """
    options = table() if known is None else known
    if name not in options:
        raise CommandError(f"there is no option '{name}'{_near(name, options)}", option=name)
    return _read(options[name], value, label, folder)


def _read(option: Option, value: Any, label: str, folder: Path | None) -> Any:
    takes, unit = option.about.takes, option.about.unit
    if takes is not None and isinstance(value, takes):
        return value
    if unit and isinstance(value, str):
        value = _in_unit(value, unit, label)
    if option.about.arrays and isinstance(value, Mapping):
        value = _with_elements(value)
    objects = {}
    if takes is not None and isinstance(value, Mapping):
        objects = {name: one for name, one in value.items() if isinstance(one, takes)}
        value = {name: one for name, one in value.items() if name not in objects}
    found = converted(value, option.plain_type, label, folder)
    if objects:
        return {**found, **objects}
    for one in found if isinstance(found, list) else [found]:
        option.check(one)
    return found


def _with_elements(values: Mapping[Any, Any]) -> dict[Any, Any]:
    """A table with name[1], name[2] in the place of a name that has a list."""
    found: dict[Any, Any] = {}
    for name, value in values.items():
        many = value.tolist() if getattr(value, "ndim", 0) and value.size != 1 else value
        if isinstance(many, (list, tuple)) and many:
            found |= {f"{name}[{i}]": one for i, one in enumerate(many, 1)}
        else:
            found[name] = value
    return found


def _in_unit(text: str, unit: str, label: str) -> float:
    """A number, or a quantity in this unit; CommandError for any other text."""
    try:
        return float(text)
    except ValueError:
        return quantity(text, label).in_unit(unit_named(unit, label), label)


def _near(name: str, known: Mapping[str, Option]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean '{near[0]}'?" if near else f"; there are {listed(sorted(known))}."
