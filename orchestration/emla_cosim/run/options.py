"""Define the table of options: every setting of a run, in one place.

The command line, scenario files, run.json and the identity of a checkpoint all derive from it.
Algorithms, step-size controls and recorders add options of their own: the fields of their classes.
"""

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from ..base.errors import CommandError, join_names
from ..base.option import (
    BUILD,
    BUILDING,
    COMPARE,
    EXPORT,
    INFO,
    LEFT_OUT,
    LINEARIZE,
    LOADING,
    OUTPUT,
    PLOT,
    PREPARING,
    RUN,
    RUNS,
    SAME,
    SHARING,
    SHOWING,
    SIZE,
    STEPPING,
    SWEEP,
    SYSTEM,
    TRAJECTORY,
    VERIFY,
    FileOrObject,
    Option,
    option,
    options_of,
)
from ..base.patterns import has_wildcard, matches_pattern
from ..base.quantities import read_quantity
from ..base.values import convert_value, list_elements
from ..fmu.cvode import METHODS
from ..fmu.models import FLAVOURS, FMI_VERSIONS, PLATFORMS
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
from .plot_formats import PLOT_FORMATS
from .stored_margins import RECORD

_Kind = TypeVar("_Kind")

ALL = (RUN, EXPORT, SWEEP, COMPARE, INFO, LINEARIZE, SIZE)
_INTEGRATED = (RUN, SWEEP, COMPARE, LINEARIZE)


def read_threads(text: str) -> int | None:
    """Read a number of threads; None means `auto`. Raise CommandError for any other text."""
    if text == "auto":
        return None
    try:
        return int(text)
    except ValueError as error:
        raise CommandError(f"--threads {text} is neither a whole number nor auto.") from error


def read_kinds(texts: Sequence[str]) -> dict[str, str]:
    """Read as what FMUs run, such as `me` or `plant=me`; a text without a component is for all."""
    return {pattern or "*": kind for pattern, _, kind in (text.rpartition("=") for text in texts)}


_system = partial(option, group=SYSTEM, commands=ALL)
_prepared = partial(_system, stage=PREPARING)
_exported = partial(option, group=SYSTEM, commands=(EXPORT,), in_file=False, recorded=False, stage=BUILDING)
_stepping = partial(option, group=STEPPING)
_output = partial(option, group=OUTPUT)
_shared = partial(option, group=RUNS, recorded=False, commands=(SWEEP, COMPARE), stage=SHARING, in_sweep=SAME)
_shown = partial(_output, recorded=False, stage=SHOWING, in_sweep=LEFT_OUT)


@dataclass(frozen=True)
class Options:
    """Values of all options of a run, as in the table of options. Times are in s.

    None means the value of the scenario, or the default. `own` has the options of algorithms, step-size
    controls and recorders by name; see `ALGORITHMS`, `STEP_SIZE_CONTROLS` and `RECORDERS`.
    """

    set: Mapping[str, Value] = _system(
        {},
        help="Set a start value or parameter, optionally with a unit, such as "
        "'lift.disturbance.load.level[*]=30 kN'. In the name, * matches any text (repeatable).",
        metavar="COMPONENT.VARIABLE=VALUE",
        arrays=True,
        in_sweep=SAME,
    )
    follow_models: bool = _system(
        False,
        help="Adapt the model parameters of controllers and observers to the plant as changed by --set "
        "and --vary. Gains do not change.",
    )
    parameters: Sequence[Path] = _prepared(
        [],
        help="Read start values from an SSP parameter file (.ssv) or a table (CSV, Parquet); see "
        "docs/inputs.md. --set overrides them (repeatable).",
        metavar="FILE",
    )
    replace: Mapping[str, Replacement] = _prepared(
        {},
        help="Replace a component with your FMU, such as lift.controller=mine.fmu (repeatable).",
        metavar="COMPONENT=FILE.fmu",
    )
    mapping: Mapping[str, Path] = _prepared(
        {},
        help="SSP parameter mapping with the names that the FMU of --replace uses for its variables "
        "(repeatable).",
        metavar="COMPONENT=FILE.ssm",
        in_sweep=SAME,
    )
    kind: Mapping[str, str] = _prepared(
        {},
        help="Run FMUs as co-simulation (cs) or Model Exchange (me), all or those of COMPONENT; see "
        "docs/model-exchange.md (repeatable). Default: cs where the FMU has it.",
        metavar="[COMPONENT=]cs|me",
        identity="kind",
        parse=read_kinds,
        commands=(RUN, SWEEP, COMPARE, INFO, EXPORT, LINEARIZE, SIZE),
        in_sweep=SAME,
    )
    no_event_mode: Sequence[str] | bool = _prepared(
        [],
        help="Run a co-simulation FMU of FMI 3.0 without event mode and early return, although it has event "
        "mode (repeatable; * matches any text). Without a name: all components.",
        metavar="[COMPONENT]",
        commands=(RUN, SWEEP, COMPARE, INFO, EXPORT, LINEARIZE, SIZE),
        takes=bool,
        alone="*",
        in_sweep=SAME,
    )
    fault: Sequence[Fault] = _prepared(
        [],
        help="Inject a fault into a signal: freeze, offset, gain or constant, from START, for DURATION, "
        "both in s. Separate several with commas.",
        metavar="SIGNAL=KIND[:VALUE]@START[+DURATION]",
        parse=read_faults,
        in_sweep=SAME,
    )
    input: Sequence[Input] = _prepared(
        [],
        help="Drive signals with data from CSV or Parquet (repeatable).",
        metavar="FILE[:SIGNAL=COLUMN,...,end=repeat]",
    )
    controller: str | type | None = _prepared(
        takes=type,
        help="Controller of all joints: a name from `emla list`, your FMU, or your block as FILE.py:BLOCK.",
        commands=(RUN, EXPORT, SWEEP, INFO, LINEARIZE, SIZE),
        makes="gains",
    )
    gains: str | None = _prepared(
        help="Gain set of controller and observer; `emla list` lists them. Default: the first of the "
        "controller.",
        commands=(RUN, EXPORT, SWEEP, INFO, LINEARIZE, SIZE),
        makes="gains",
    )
    trajectory: Path | None = _prepared(
        help="Motion of the manipulator: a file written by `emla trajectory`.",
        metavar="FILE.json",
        makes="reference",
    )
    actuator: Mapping[str, Path | FileOrObject] = _prepared(
        {},
        help="Replace a joint's actuator with one from a data sheet; see docs/actuator.md (repeatable).",
        metavar="JOINT=FILE.toml",
        takes=FileOrObject,
        makes="actuators",
    )
    sheet: Mapping[str, Value] = _prepared(
        {},
        help="Change an entry of an actuator's data sheet, such as 'prototype.screw.lead=5 mm'. Everything "
        "that follows from the entry changes, too (repeatable).",
        metavar="JOINT.TABLE.ENTRY=VALUE",
        makes="actuators",
    )
    flavour: str = _system(
        "native",
        help="Implementation of the built-in FMUs: compiled (native), or Python (python).",
        choices=lambda: FLAVOURS,
        stage=BUILDING,
    )
    fmus: Path | None = _system(
        help="Folder of the built-in FMUs; missing ones are built there. Default: fmus/ if it has them, "
        "otherwise your cache.",
        in_file=False,
        recorded=False,
        writes="folder",
        stage=BUILDING,
    )
    platform: Sequence[str] = _exported(
        [],
        help="Platform to compile the built-in FMUs for (repeatable). Default: this machine's.",
        choices=lambda: PLATFORMS,
    )
    fmi: int = _exported(2, help="Version of FMI of an exported FMU.", choices=lambda: FMI_VERSIONS)
    inputs: Sequence[str] = _exported(
        [],
        help="Input of an exported FMU, among those that nothing drives (repeatable; * matches any text). "
        "Default: all of these.",
        metavar="COMPONENT.VARIABLE",
    )
    outputs: Sequence[str] = _exported(
        [],
        help="Output of an exported FMU or C file (repeatable; * matches any text). Default: position and "
        "reference of each joint; without joints, all outputs; in C, those that drive other components.",
        metavar="COMPONENT.VARIABLE",
    )
    components: Sequence[str] = _exported(
        [],
        help="Component of an exported C file, such as controller or lift.controller (repeatable; * matches "
        "any text).",
        metavar="COMPONENT",
    )
    precision: str = _exported(
        "double",
        help="Type of the numbers in an exported C file.",
        choices=lambda: ("double", "float"),
    )
    start_time: float | None = _stepping(
        help="Start time of the simulation. Default: the scenario's, or 0.",
        unit="s",
        identity="start time",
        commands=ALL,
    )
    stop_time: float | None = _stepping(
        help="Stop time of the simulation. Default: the scenario's.", unit="s", commands=ALL
    )
    step_size: float | None = _stepping(
        help="Communication step: time between two exchanges of values between the FMUs. Default: the "
        "scenario's.",
        unit="s",
        identity="step size",
        commands=ALL,
    )
    fmi_tolerance: float | None = _stepping(
        help="Relative tolerance of the solvers inside the FMUs. Default: that of each FMU's experiment.",
        above=0.0,
        identity="FMI tolerance",
        commands=_INTEGRATED,
    )
    integrator: str = _stepping(
        "bdf",
        help="Method of CVode for FMUs that run as Model Exchange: bdf for stiff models, adams for others.",
        choices=lambda: METHODS,
        identity="integrator",
        commands=_INTEGRATED,
    )
    integrator_step: float | None = _stepping(
        help="Largest step of CVode in FMUs that run as Model Exchange. Default: the communication step.",
        unit="s",
        above=0.0,
        identity="integrator step",
        commands=_INTEGRATED,
    )
    integrate_together: bool = _system(
        True,
        help="Integrate FMUs that run as Model Exchange and are connected with each other together, with one "
        "integrator; see docs/model-exchange.md.",
        flag="--together",
        commands=(RUN, SWEEP, COMPARE, INFO, LINEARIZE),
        identity="integrators",
        stage=LOADING,
        in_sweep=SAME,
    )
    algorithm: str | Algorithm = _stepping(
        "gauss-seidel",
        help="Master algorithm: the order in which FMUs step and exchange values; see docs/master.md.",
        choices=lambda: ALGORITHMS,
        identity="algorithm",
        commands=(RUN, EXPORT, SWEEP, COMPARE, LINEARIZE, SIZE),
        takes=Algorithm,
    )
    step_size_control: str | StepSizeControl | None = _stepping(
        help="Step-size control. Default: the one that the other options imply, such as error for "
        "--error-tolerance; otherwise fixed.",
        choices=lambda: STEP_SIZE_CONTROLS,
        identity="step-size control",
        takes=StepSizeControl,
    )
    isolate: Sequence[str] | bool = _system(
        [],
        help="Run a component in a separate process, so that a crash ends only that process (repeatable; "
        "* matches any text). Without a name: all components.",
        metavar="[COMPONENT]",
        commands=(RUN, SWEEP, COMPARE),
        takes=bool,
        alone="*",
        stage=LOADING,
        in_sweep=SAME,
    )
    lenient: bool = _system(
        False,
        help="Accept FMUs and packages that violate their standard where other tools accept them. The "
        "violations are listed.",
        commands=(RUN, EXPORT, SWEEP, COMPARE, INFO, LINEARIZE, SIZE),
        stage=LOADING,
        in_sweep=SAME,
    )
    estimate_coupling: bool = _stepping(
        True,
        help="Estimate the error of exchanging values only at communication points, after the run; see "
        "docs/master.md. The results are the same.",
        flag="--coupling-estimate",
        commands=(RUN, SWEEP),
        in_sweep=SAME,
    )
    threads: int | None = _stepping(
        help="Number of threads that step FMUs. The results are the same. Default: auto, which uses all "
        "cores where this is measured to be faster.",
        metavar="N|auto",
        parse=read_threads,
        in_file=False,
        recorded=False,
        commands=(RUN,),
    )
    real_time: float | None = _stepping(
        help="Largest speed, in simulated seconds per second. Default: no limit.",
        flag="--realtime",
        metavar="FACTOR",
        record="real_time_factor",
        commands=(RUN,),
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    output: Path | None = _shown(help="Output folder. Default: results/SCENARIO.", writes="folder")
    overwrite: bool = _output(
        False,
        help="Replace files that emla did not write. Links, folders, devices and pipes are never replaced.",
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
        help="Signals to keep in the table, such as 'lift.plant.*' (repeatable). A name that no output has "
        "selects a local or other variable. Default: all outputs but Strings.",
        metavar="PATTERN",
        commands=(RUN,),
        in_sweep=LEFT_OUT,
    )
    output_interval: float | None = _output(
        help="Time between rows of the table. Default: 1 ms.", unit="s", identity="output interval"
    )
    roles: Mapping[str, str] = _output(
        {},
        help="Assign a signal to a role of a joint, such as lift.x_L=axis.position (repeatable).",
        flag="--role",
        metavar="JOINT.ROLE=SIGNAL",
        commands=(RUN, SWEEP, SIZE),
        identity="roles",
    )
    criteria: Mapping[str, float | str] = _output(
        {},
        help="Set a criterion of a joint, such as 'lift.position_window=0.5 mm'; * means all joints. See "
        "docs/metrics.md (repeatable).",
        flag="--criterion",
        metavar="JOINT.CRITERION=VALUE",
        commands=(RUN, SWEEP, COMPARE, SIZE),
        identity="criteria",
    )
    bonds: Mapping[str, str] = _output(
        {},
        help="Declare a power bond between two signals, such as axis='load.F * actuator.v'. The run "
        "reports the energy that the coupling creates or destroys there (repeatable).",
        flag="--bond",
        metavar="NAME='EFFORT * FLOW'",
        commands=(RUN, SWEEP),
        identity="bonds",
    )
    stop_when: Sequence[str] = _stepping(
        [],
        help="End the run successfully at the first communication point at which this condition on a signal "
        "holds, such as 'lift.plant.x_L > 0.3' (repeatable).",
        metavar="'SIGNAL > VALUE'",
        commands=(RUN, SWEEP, COMPARE),
        in_sweep=SAME,
    )
    require: Sequence[str] = _output(
        [],
        help="Fail unless this condition holds, such as 'lift.position_error_m < 2e-5' (repeatable).",
        metavar="'METRIC < VALUE'",
        commands=(RUN, SWEEP),
        in_sweep=SAME,
    )
    reference: Path | None = _output(
        help="Fail unless every signal agrees with an earlier run, or with a table of reference values such "
        "as MODEL_ref.csv. Name the run's output folder or the table.",
        metavar="FOLDER",
        commands=(RUN,),
        in_file=False,
    )
    tolerance: Mapping[str, Tolerance] = _output(
        {},
        help="Tolerance of --reference relative to each signal's range, for all signals or for those that "
        "match PATTERN (repeatable). Default: 1e-3.",
        metavar="[PATTERN=]NUMBER",
        commands=(RUN,),
        in_file=False,
        parse=read_tolerances,
    )
    timeout: float | None = _shared(
        help="Longest wall time of a variant. One that takes longer is ended, with the status 'timed out'. "
        "Default: no limit.",
        unit="s",
        above=0.0,
    )
    patience: float = _shared(
        60.0, help="Wall time to wait while the cluster has no workers.", unit="s", above=0.0
    )
    plots: bool = _shown(True, help="Draw plots into the output folder.")
    plot_format: str = _shown(
        "png", help="File format of the plots.", choices=lambda: PLOT_FORMATS, commands=(RUN,)
    )
    animate: bool = _shown(
        False, help="Write an animation of the manipulator, manipulator.gif.", commands=(RUN,)
    )
    report: bool = _shown(False, help="Write a page with results and plots, report.html.", commands=(RUN,))
    margins: Path | None = _output(
        help="Keep the stability margins of this output folder of emla linearize in run.json, and show them "
        "in the report.",
        metavar="FOLDER",
        commands=(RUN,),
        in_file=False,
        recorded=False,
    )
    profile: bool = _output(
        False,
        help="Measure the time and the calls of each FMU, and the time of the master and the recorders; see "
        "docs/master.md. The results are the same.",
        in_file=False,
        recorded=False,
        commands=(RUN,),
        in_sweep=LEFT_OUT,
    )
    checkpoint: Path | None = _output(
        help="Save the state of the run to this file, every minute and at the end, for --resume.",
        in_file=False,
        recorded=False,
        writes="file",
        commands=(RUN,),
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    resume: Path | None = _output(
        help="Continue a run from this file, written by --checkpoint.",
        in_file=False,
        record="resumed_from",
        commands=(RUN,),
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    own: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    overridden: Mapping[str, Any] = dataclasses.field(default_factory=dict, compare=False)
    """Earlier options that a later choice of algorithm or step-size control does not have."""

    def updated(self, given: Mapping[str, Any], where: str = "", folder: Path | None = None) -> "Options":
        """Return the options with other values.

        Args:
            given: values by name, as `load` takes them.
            where: what error messages call the place of the values.
            folder: folder that relative paths refer to.

        Raises:
            CommandError: a name does not exist, or a value has a wrong type or range.

        Examples:
            >>> import emla_cosim as ec
            >>> ec.Options().updated({"stop_time": "10 ms"}).stop_time
            0.01
        """
        return self.merged(read_options(given, where, folder))

    def merged(self, values: Mapping[str, Any]) -> "Options":
        """Return the options with values from `read_options`, merged as by `merge`."""
        if not values:
            return self
        fixed = {name: getattr(self, name) for name in (*values, *_KINDS) if name in _FIXED}
        again = {name: value for name, value in self.overridden.items() if _choice_of(name) in values}
        both = merge({**fixed, **again, **self.own}, values)
        own = {name: both.pop(name) for name in [*both] if name not in _FIXED}
        earlier = {**self.overridden, **self.own}
        overridden = {name: value for name, value in earlier.items() if name not in own}
        return dataclasses.replace(self, **both, own=own, overridden=overridden)

    def overridden_notes(self) -> list[str]:
        """Return a note on each option that a later choice made useless, without full stops."""
        known = list_options()
        chosen = {"algorithm": self.algorithm_name, "step_size_control": self.step_size_control_name}
        return [
            f"the {known[name].noun} of the scenario is not used: the {known[_choice_of(name)].noun} "
            f"{chosen[_choice_of(name)]} has none"
            for name in self.overridden
        ]

    @property
    def algorithm_name(self) -> str:
        """Name of the algorithm; the class name of an algorithm of your own."""
        return _name_of(self.algorithm, ALGORITHMS)

    @property
    def step_size_control_name(self) -> str:
        """Return the name of the step-size control in effect, or the class name of the user's own."""
        if self.step_size_control is not None:
            return _name_of(self.step_size_control, STEP_SIZE_CONTROLS)
        asked = (n for n, kind in STEP_SIZE_CONTROLS.items() if not _names(kind).isdisjoint(self.own))
        return next(asked, next(iter(STEP_SIZE_CONTROLS)))

    @property
    def isolated(self) -> Sequence[str]:
        """Return the patterns of the components to isolate."""
        return _list_patterns(self.isolate)

    @property
    def without_event_mode(self) -> Sequence[str]:
        """Return the patterns of the components that run without event mode."""
        return _list_patterns(self.no_event_mode)

    def replacements(self) -> dict[str, Replacement]:
        """Return the replacements by component, with the files of the option `mapping`.

        Raises:
            CommandError: a mapping belongs to a component that is not replaced.
        """
        found = dict(self.replace)
        for name, file in self.mapping.items():
            if name not in found:
                raise CommandError(f"--mapping {name}={file} needs --replace {name}=FILE.fmu.")
            found[name] = dataclasses.replace(found[name], mapping=file)
        return found

    def files_read(self) -> dict[Path, str]:
        """Return what a run reads, by path."""
        found = dict.fromkeys(self.parameters, "the parameter set")
        for replacement in self.replacements().values():
            found[replacement.fmu] = "the FMU"
            if replacement.mapping is not None:
                found[replacement.mapping] = "the mapping"
        if self.trajectory is not None:
            found[self.trajectory] = "the trajectory"
        found |= {source.file: "the input" for source in self.input if source.file is not None}
        for actuator in self.actuator.values():
            if (file := actuator.file if isinstance(actuator, FileOrObject) else actuator) is not None:
                found[file] = "the actuator"
        if isinstance(self.controller, str) and self.controller.lower().endswith(".fmu"):
            found[Path(self.controller)] = "the FMU"
        if self.reference is not None:
            for table in (self.reference, *(self.reference / name for name in table_names())):
                found[table] = "the run to compare with"
        if self.margins is not None:
            found |= dict.fromkeys((self.margins, self.margins / RECORD), "the margins")
        return found

    def read_bonds(self) -> dict[str, Bond]:
        """Return the power bonds by name; CommandError for a text that is none."""
        return {name: Bond.read(name, text) for name, text in self.bonds.items()}

    def make_algorithm(self) -> Algorithm:
        """Return the algorithm with its options.

        Raises:
            CommandError: the algorithm does not have one of the options.
        """
        return self._made(self.algorithm, ALGORITHMS, "algorithm")

    def make_step_size_control(self) -> StepSizeControl:
        """Return the step-size control with its options. Raise CommandError for options it does not have."""
        chosen = self.step_size_control or self.step_size_control_name
        found = self._made(chosen, STEP_SIZE_CONTROLS, "step-size control")
        found.check()
        return found

    def _made(self, chosen: str | _Kind, kinds: Mapping[str, type[_Kind]], what: str) -> _Kind:
        given = {n: v for n, v in self.own.items() if any(n in _names(k) for k in kinds.values())}
        if not isinstance(chosen, str):
            if given:
                raise CommandError(
                    f"the {what} is an object with its own options; leave out {join_names(given)}."
                )
            return chosen
        for name in given:
            if name not in _names(kinds[chosen]):
                others = [n for n, k in kinds.items() if name in _names(k)]
                has = "has" if len(others) == 1 else "have"
                raise CommandError(
                    f"the {what} {chosen} has no {list_options()[name].noun}; {join_names(others)} {has}.",
                    option=name,
                )
        return kinds[chosen](**given)

    def make_recorders(self) -> list[Recorder]:
        """Return the recorders of `RECORDERS` whose options are set."""
        asked = (
            (kind, {n: v for n, v in self.own.items() if n in _names(kind)}) for kind in RECORDERS.values()
        )
        return [kind(**given) for kind, given in asked if given]

    def in_effect(self) -> list[tuple[Option, Any]]:
        """Return each option that applies, with its value."""
        found = [(o, getattr(self, o.name)) for o in _FIXED.values()]
        for part in (self.make_algorithm(), self.make_step_size_control(), *self.make_recorders()):
            found += [(o, getattr(part, o.name)) for o in options_of(type(part))]
        has = {o.name for o, _ in found}
        unused = {o.name: o for kind in STEP_SIZE_CONTROLS.values() for o in options_of(kind)}
        return found + [(o, None) for name, o in unused.items() if name not in has]


_FIXED = {o.name: o for o in options_of(Options)}

_KINDS: Mapping[str, Mapping[str, type]] = {"algorithm": ALGORITHMS, "step_size_control": STEP_SIZE_CONTROLS}
"""The options that choose a class, with the classes, each of which has options of its own."""


def list_options(command: str | None = None) -> dict[str, Option]:
    """Return all options by name, or those of one command. Registered classes add theirs."""
    kinds = (*ALGORITHMS.values(), *STEP_SIZE_CONTROLS.values(), *RECORDERS.values())
    own = {o.name: o for kind in kinds for o in options_of(kind)}
    return {n: o for n, o in (_FIXED | own).items() if command is None or command in o.about.commands}


def select_repeatable(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by name, without those that hold for one command only."""
    known = list_options()
    return {n: v for n, v in options.items() if n not in known or known[n].about.repeated}


def merge(before: Mapping[str, Any], later: Mapping[str, Any]) -> dict[str, Any]:
    """Merge values of options by name. Tables are merged; all other values are replaced.

    A later algorithm or step-size control removes earlier options that it does not have. Later options of a
    step-size control remove an earlier choice of one that does not have them.
    """
    before = _without_overridden(before, later)
    tables = {n for n, value in later.items() if isinstance(value, Mapping) and before.get(n)}
    return {**before, **{n: _merge_tables(before[n], v) if n in tables else v for n, v in later.items()}}


def _choice_of(name: str) -> str:
    """Return the option that chooses the class to which an option belongs; empty for recorders."""
    found = (what for what, kinds in _KINDS.items() if any(name in _names(kind) for kind in kinds.values()))
    return next(found, "")


def _without_overridden(before: Mapping[str, Any], later: Mapping[str, Any]) -> Mapping[str, Any]:
    kept = dict(before)
    for what, kinds in _KINDS.items():
        belonging = {name for kind in kinds.values() for name in _names(kind)}
        if (chosen := later.get(what)) is not None:
            has = _names(kinds[chosen]) if isinstance(chosen, str) else set[str]()
            kept = {name: value for name, value in kept.items() if name not in belonging - has}
    earlier = kept.get("step_size_control")
    if earlier is not None and "step_size_control" not in later:
        asked = {name for kind in STEP_SIZE_CONTROLS.values() for name in _names(kind)} & later.keys()
        if asked - (_names(STEP_SIZE_CONTROLS[earlier]) if isinstance(earlier, str) else set()):
            kept["step_size_control"] = None
    return kept


def _merge_tables(before: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, Any]:
    """Merge two tables. Later entries replace those whose names their patterns match."""
    patterns = [name for name in found if has_wildcard(name)]
    kept = {
        n: v for n, v in before.items() if n not in found and not any(matches_pattern(n, p) for p in patterns)
    }
    return {**kept, **found}


def _list_patterns(value: Sequence[str] | bool) -> Sequence[str]:
    """Return the patterns of an option that names components; True means all."""
    if isinstance(value, bool):
        return ["*"] if value else []
    return value


def _name_of(chosen: str | _Kind, kinds: Mapping[str, type[_Kind]]) -> str:
    if isinstance(chosen, str):
        return chosen
    return next((n for n, k in kinds.items() if k is type(chosen)), type(chosen).__name__)


def _names(kind: type) -> set[str]:
    return {o.name for o in options_of(kind)}


def read_options(given: Mapping[str, Any], where: str = "", folder: Path | None = None) -> dict[str, Any]:
    """Read values of options by name and convert them to their types.

    Args:
        given: Values by name of the option.
        where: Source of the values, for error messages.
        folder: Folder to which paths in the values are relative.

    Raises:
        CommandError: If a name is unknown, or a value has a wrong type or range.
    """
    known, of = list_options() if given else {}, f" of {where}" if where else ""
    return {
        name: read_option(name, value, f"'{name}'{of}" if of else f"the option '{name}'", folder, known)
        for name, value in given.items()
    }


def read_option(
    name: str, value: Any, label: str, folder: Path | None = None, known: Mapping[str, Option] | None = None
) -> Any:
    """Convert the value of an option to its type.

    Args:
        name: Name of the option.
        value: Value to read.
        label: Name of the value in error messages.
        folder: Folder to which paths in the value are relative.
        known: Options to choose from. Default: all.

    Raises:
        CommandError: If the name is not in `known`, or the value has a wrong type or range.
    """
    options = list_options() if known is None else known
    if name not in options:
        raise CommandError(f"there is no option '{name}'{_suggest_option(name, options)}", option=name)
    return _read(options[name], value, label, folder)


def _read(option: Option, value: Any, label: str, folder: Path | None) -> Any:
    takes, unit = option.about.takes, option.about.unit
    if takes is not None and isinstance(value, takes):
        return value
    if unit and isinstance(value, str):
        value = _in_unit(value, unit, label)
    if option.about.arrays and isinstance(value, Mapping):
        value = list_elements(value)
    objects = {}
    if takes is not None and isinstance(value, Mapping):
        objects = {name: one for name, one in value.items() if isinstance(one, takes)}
        value = {name: one for name, one in value.items() if name not in objects}
    found = convert_value(value, option.plain_type, label, folder)
    if objects:
        return {**found, **objects}
    for one in found if isinstance(found, list) else [found]:
        option.check(one)
    return found


def _in_unit(text: str, unit: str, label: str) -> float:
    """Read a number, or a quantity in this unit. Raise CommandError for any other text."""
    try:
        return float(text)
    except ValueError:
        return read_quantity(text, label, unit)


def _suggest_option(name: str, known: Mapping[str, Option]) -> str:
    longer = [n for n in known if n.startswith(f"{name}_")]
    near = longer or difflib.get_close_matches(name, known, n=1)
    return (
        f"; did you mean {' or '.join(map(repr, near[:3]))}?"
        if near
        else f"; there are {join_names(sorted(known))}."
    )
