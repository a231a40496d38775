"""The schema of joint files."""

import math
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from emla_fmu import Disturbance, EmlaPlant, motion_law, observer_gains
from emla_fmu.disturbance import LEVELS
from emla_fmu.drive import DriveParameters
from emla_fmu.observer_gains import ObserverGains
from emla_fmu.parameters import EmlaParameters
from emla_fmu.reference import MOVES, quintic_duration, rest_to_rest
from emla_fmu.schedule import NEVER

from ...base.errors import CommandError, join_names
from ...base.values import as_float
from ...run.scenarios.scenario_file import read_given_options
from ..actuator.actuator import Actuator, actuator_tables
from ..controllers import CONTROLLERS
from .toml_tables import EntryFormat, TomlTable, read_block, read_call

KIND = "joint"
"""The value of `kind` in a joint file."""

OBSERVER_RULES: Mapping[str, Callable[..., ObserverGains]] = {
    "published": observer_gains.published,
    "robust": observer_gains.robust,
    "compensated": observer_gains.compensated,
    "damped": observer_gains.damped,
}
"""Rules that compute the gains of an observer."""

_LENGTH = EntryFormat("position", "m", "0.25")
_SPEED = EntryFormat("peak speed", "m/s", "0.06", positive=True)


class Cells(NamedTuple):
    """Position error in m, speed error in m/s, torque effort in N m and convergence time in s.

    In normalised averages they are ratios. The names are those of `JointFigures`.
    """

    position_error_m: float
    velocity_error_m_s: float
    torque_effort_N_m: float
    convergence_time_s: float


@dataclass(frozen=True)
class StartPosition:
    """The start position of a joint."""

    x_L: Annotated[float, EntryFormat("initial screw position", "m", "0.24")]


@dataclass(frozen=True)
class Move:
    """The motion of a joint: one quintic move, defined by its peak speed or its duration."""

    q_S: Annotated[float, EntryFormat("start of the reference", "m", "0.244")]
    q_E: Annotated[float, EntryFormat("end of the reference", "m", "0.270")]
    v_peak: Annotated[float | None, _SPEED] = None
    duration: Annotated[float | None, EntryFormat("duration of the move", "s", "2.0", positive=True)] = None

    @property
    def peak(self) -> float:
        """The peak speed in m/s."""
        if self.v_peak is not None:
            return self.v_peak
        return 15.0 * abs(self.q_E - self.q_S) / (8.0 * (self.duration or 1.0))

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the reference."""
        return rest_to_rest(self.q_S, self.q_E, self.peak)


@dataclass(frozen=True)
class Cycle:
    """A periodic motion: moves with one peak speed between way-points, and equal dwells."""

    way_points: Annotated[tuple[float, ...], EntryFormat("way-points of a cycle", "m", "[0.05, 0.30, 0.05]")]
    v_peak: Annotated[float, EntryFormat("peak speed of every move", "m/s", "0.026", positive=True)]
    period: Annotated[float, EntryFormat("time after which the motion repeats", "s", "40.0", positive=True)]

    @property
    def durations(self) -> list[float]:
        """The durations of the moves in s."""
        return [quintic_duration(b - a, self.v_peak) for a, b in pairwise(self.way_points)]

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the reference."""
        durations = self.durations
        moves = len(durations)
        dwell = (self.period - sum(durations)) / moves
        starts = [sum(durations[:i]) + i * dwell for i in range(moves)]
        rest = MOVES - moves
        return {
            "x": [*self.way_points, *[self.way_points[-1]] * rest],
            "start": [*starts, *[NEVER] * rest],
            "duration": [*durations, *[1.0] * rest],
            "period": self.period,
        }


@dataclass(frozen=True)
class Load:
    """Load force: levels in N, positive against extension, and a ripple.

    `start` has the times in s at which the second and later levels begin.
    """

    level: Annotated[tuple[float, ...], EntryFormat("load force", "N", "57e3")]
    start: Annotated[tuple[float, ...] | None, EntryFormat("times of the levels", "s", "[2.0]")] = None
    ramp: Annotated[float | None, EntryFormat("time between levels", "s", "0.5", positive=True)] = None
    ripple: Annotated[float | None, EntryFormat("width of the ripple", "N", "5e3")] = None
    ripple_omega: Annotated[float | None, EntryFormat("angular frequency of the ripple", "rad/s", "628")] = (
        None
    )

    @property
    def largest(self) -> float:
        """The load force in N of the largest magnitude."""
        level = max(self.level, key=abs)
        return level + math.copysign(0.5 * (self.ripple or 0.0), level)

    def parameters(self) -> dict[str, Any]:
        """Return the load as parameters of the disturbance."""
        given = {"ramp": self.ramp, "ripple": self.ripple, "ripple_omega": self.ripple_omega}
        found: dict[str, Any] = {"level": (*self.level, *[self.level[-1]] * (LEVELS - len(self.level)))}
        if self.start is not None:
            found["level_start"] = (NEVER, *self.start, *[NEVER] * (LEVELS - 1 - len(self.start)))
        return found | {name: value for name, value in given.items() if value is not None}


_STIFFNESS = EntryFormat("stiffness", "N/m", "1e9", positive=True)


@dataclass(frozen=True)
class Compliance:
    """A load that is not rigid: its mass, what is in series between it and the motor, and backlash.

    `damping_ratio` is that of the load swinging against a screw that is held. `backlash` is the whole play.
    """

    mass: Annotated[float, EntryFormat("mass of the load", "kg", "5e3", positive=True)]
    bearing: Annotated[float, _STIFFNESS]
    screw: Annotated[float, _STIFFNESS]
    nut: Annotated[float, _STIFFNESS]
    structure: Annotated[float, _STIFFNESS]
    damping_ratio: Annotated[float, EntryFormat("damping ratio of the load", "", "0.02")] = 0.0
    backlash: Annotated[float, EntryFormat("backlash", "m", "3e-6")] = 0.0

    @property
    def stiffness(self) -> float:
        """The stiffness of all parts in series, N/m (7)."""
        return motion_law.k_L(self.bearing, self.screw, self.nut, self.structure)

    def parameters(self, force: float) -> dict[str, Any]:
        """Return the parameters of the plant, for a load that rests under `force` in N at the start."""
        k = self.stiffness
        return {
            "m_load": self.mass,
            "stiffness": k,
            "damping": 2.0 * self.damping_ratio * math.sqrt(k * self.mass),
            "backlash": self.backlash,
            "deflection_start": force / k + math.copysign(0.5 * self.backlash, force),
        }


@dataclass(frozen=True)
class JointExperiment:
    """Motion and load of a joint in an experiment of the paper."""

    reference: Cycle
    load: Load


@dataclass(frozen=True)
class ObserverSet:
    """Gains of an observer; `estimate` is its initial position in m, if not that of the screw."""

    gains: ObserverGains
    estimate: float | None = None


@dataclass(frozen=True)
class GainSet:
    """A set of gains of a controller, with its observer.

    `on_machine` are the gains of a joint that moves a whole machine.
    """

    controller: Any
    observer: ObserverSet
    on_machine: Any


@dataclass(frozen=True)
class Tuning:
    """Data for `emla tune`: the convergence time to beat, and values for the case with noise."""

    convergence_time: Annotated[float | None, EntryFormat("convergence time to beat", "s", "0.085")] = None


@dataclass(frozen=True)
class JointFile:
    """All data of a joint: its actuator, motion and load, and the gains of its controllers.

    Attributes:
        run: The options of its scenario.
        disturbance: Parameters by attribute of the block.
        plant: Parameters by attribute of the block.
        realistic: The actuator with the entries of `[drive]`.
        is_realistic: Whether the joint runs with it.
        compliance: The load of scenarios in which it is not rigid; None if the file has none.
        experiments: Motion and load by scenario.
        printed: Figures of the paper by scenario and controller.
    """

    name: str
    label: str
    description: str
    run: Mapping[str, Any]
    sample_time: float
    seed: int | None
    actuator: Actuator
    realistic: Actuator
    is_realistic: bool
    start: StartPosition
    reference: Move
    load: Load
    disturbance: Mapping[str, Any]
    plant: Mapping[str, Any]
    compliance: Compliance | None
    observers: Mapping[str, ObserverSet]
    gains: Mapping[str, Mapping[str, GainSet]]
    tuning: Tuning | None
    noisy: Mapping[str, float]
    experiments: Mapping[str, JointExperiment]
    printed: Mapping[str, Mapping[str, Cells]]

    @property
    def emla(self) -> EmlaParameters:
        """The parameters of the joint's actuator."""
        return self.actuator.emla

    @property
    def sheet(self) -> Actuator:
        """The actuator with which the joint runs in a scenario of its own."""
        return self.realistic if self.is_realistic else self.actuator

    @property
    def compliant_load(self) -> Compliance:
        """The load that is not rigid; raise CommandError if the file lacks it."""
        if self.compliance is None:
            raise CommandError(f"{self.label} lacks the table [compliance].", joint=self.name)
        return self.compliance

    def gain_set(self, controller: str, name: str) -> GainSet:
        """Return a set of gains; raise CommandError if the file lacks it for the controller."""
        sets = self.gains.get(controller, {})
        if name not in sets:
            others = f", or choose {join_names(sets)} with --gains" if sets else ""
            raise CommandError(
                f"{self.label} has no gains '{name}' for the controller '{controller}'; "
                f"add [gains.{controller}.{name}]{others}.",
                joint=self.name,
                controller=controller,
                gains=name,
            )
        return sets[name]

    def experiment(self, scenario: str) -> JointExperiment:
        """Return motion and load of a scenario; raise CommandError if the file lacks them."""
        if scenario not in self.experiments:
            raise CommandError(f"{self.label} lacks the table [experiment.{scenario}].")
        return self.experiments[scenario]

    def printed_in(self, scenario: str) -> Mapping[str, Cells]:
        """Return the paper's figures for a scenario, by controller; raise CommandError if there are none."""
        if scenario not in self.printed:
            raise CommandError(f"{self.label} lacks the table [paper.{scenario}], the figures of the paper.")
        return self.printed[scenario]

    def observer_of(
        self, gains: Mapping[str, ObserverGains] | str, controller: str, gain_set: str
    ) -> ObserverSet:
        """Return the observer of a set of gains that is not in the file.

        Args:
            gains: Gains of the observer by joint, or the name of a set of the file.
            controller: The name of the controller in messages.
            gain_set: The name of the set in messages.

        Raises:
            CommandError: There are none for this joint.
        """
        if isinstance(gains, str):
            if gains in self.observers:
                return self.observers[gains]
            missing = f"add [observer.{gains}]"
            if self.observers:
                missing = f"{missing}, or choose {join_names(self.observers)} with --gains"
        elif self.name in gains:
            return ObserverSet(gains[self.name])
        else:
            missing = "add them to the observer of its ec.Gains"
        raise CommandError(
            f"{self.label} lacks observer gains for '{gain_set}' of the controller '{controller}'; "
            f"{missing}.",
            joint=self.name,
            controller=controller,
            gains=gain_set,
        )


_TOP = {
    "kind": "",
    "description": "",
    "sample_time": "",
    "seed": "",
    "run": "the options of its scenario: stop_time and step_size",
    "actuator": "the data of motor, screw, inverter and sensor",
    "drive": "",
    "start": "where the screw starts",
    "reference": "the motion of the joint",
    "load": "the load force",
    "disturbance": "",
    "plant": "",
    "compliance": "",
    "observer": "",
    "gains": "",
    "tuning": "",
    "experiment": "",
    "paper": "",
}
"""Entries of a joint file, with the content of required tables."""

KEYS = frozenset(_TOP) - {"description", "actuator", "gains"}
"""Entries that a scenario file does not support."""


@dataclass(frozen=True)
class _Head:
    description: Annotated[str, EntryFormat("line that `emla list` shows", "", '"..."')]
    sample_time: Annotated[
        float, EntryFormat("sample time of observer and controller", "s", "1e-4", positive=True)
    ]
    seed: Annotated[int | None, EntryFormat("start of the random sequences")] = None


def read_joint(text: str, label: str, name: str, folder: Path) -> JointFile:
    """Read a joint file; paths in it are relative to `folder`.

    Raises:
        CommandError: The text is not TOML, or an entry is unknown, missing or wrong.
    """
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise CommandError(f"{label} is not TOML: {error}.") from error
    return parse_joint(content, label, name, folder)


def parse_joint(content: Mapping[str, Any], label: str, name: str, folder: Path) -> JointFile:
    """Return the joint of a joint file's content; see `read_joint`."""
    if not name.isidentifier():
        raise CommandError(
            f"{label} cannot name a joint: '{name}' is invalid; use letters, digits and _ in the file name."
        )
    top = TomlTable(content, "", label)
    top.check_keys(_TOP)
    if content.get("kind") != KIND:
        raise CommandError(f'{label} lacks kind; write kind = "{KIND}".', key="kind")
    tables = {key: top.inner(key, about) for key, about in _TOP.items() if key not in _PLAIN}
    head = read_call(_Head, top, [key for key in _TOP if key not in _Head.__dataclass_fields__])
    actuator, entered = _actuator(top, folder)
    realistic, is_realistic = _realistic(actuator, entered, tables["drive"])
    observers = {one: _observer_set(tables["observer"].inner(one)) for one in tables["observer"].content}
    return JointFile(
        name=name,
        label=label,
        description=head.description,
        run=_run(tables["run"], name),
        sample_time=head.sample_time,
        seed=head.seed,
        actuator=actuator,
        realistic=realistic,
        is_realistic=is_realistic,
        start=read_call(StartPosition, tables["start"]),
        reference=_move(tables["reference"]),
        load=_load(tables["load"]),
        disturbance=read_block(Disturbance, tables["disturbance"], _DISTURBANCE_ELSEWHERE),
        plant=read_block(EmlaPlant, tables["plant"], _PLANT_ELSEWHERE),
        compliance=read_call(Compliance, tables["compliance"]) if "compliance" in content else None,
        observers=observers,
        gains=_gains(tables["gains"], observers),
        tuning=read_call(Tuning, tables["tuning"], ["noisy"]) if "tuning" in content else None,
        noisy=_noisy(tables["tuning"].inner("noisy")),
        experiments={
            one: _experiment(tables["experiment"].inner(one)) for one in content.get("experiment", {})
        },
        printed=_printed(tables["paper"]),
    )


_PLAIN = ("kind", "description", "sample_time", "seed", "actuator")
"""Entries that are not tables, or not always."""


def _fmi_names(block: Any, attributes: Iterable[str]) -> set[str]:
    wanted = set(attributes)
    return {str(x.name) for x in block.layout().parameters if x.attribute in wanted}


_SEED = "write it as seed, before the first table"
_DISTURBANCE_ELSEWHERE = {
    **dict.fromkeys(
        _fmi_names(Disturbance, ("level", "level_start", "ramp", "ripple", "ripple_omega")),
        "write the load in [load]",
    ),
    "d_2.seed": _SEED,
}
_PLANT_ELSEWHERE = {
    **dict.fromkeys(
        _fmi_names(EmlaPlant, DriveParameters.__dataclass_fields__), "write it in [actuator] or [drive]"
    ),
    **dict.fromkeys(
        _fmi_names(EmlaPlant, [*EmlaParameters.__dataclass_fields__, "i_max", "i_range"]),
        "it follows from [actuator]",
    ),
    "sensor.seed": _SEED,
    "sensor.current.seed": "it follows from seed",
    "start.x_L": "write it as x_L in [start]",
    "use_commanded_current": "the scenario decides it",
}


def _actuator(top: TomlTable, folder: Path) -> tuple[Actuator, Mapping[str, Any]]:
    """Return the actuator, inline or from the file that the entry names, and its tables."""
    entered = top.content.get("actuator")
    if entered is None:
        raise CommandError(f"{top.file} lacks the table [actuator], {_TOP['actuator']}.", table="actuator")
    label = f"[actuator] of {top.file}"
    if isinstance(entered, str):
        path = folder / entered
        label, entered = f"the actuator '{path}'", actuator_tables(path)[0]
    if not isinstance(entered, Mapping):
        raise CommandError(f"{label} is {entered!r}; it must be a table, or the path of a file.")
    if "control" in entered:
        raise CommandError(
            f"{label} has the table 'control'; remove it, since [gains] of a joint file has all gains.",
            key="control",
        )
    return Actuator.of_tables(entered, label), entered


_OF_THE_DRIVE = ("inverter", "sensor", "friction", "stop", "thermal")
"""Tables of an actuator that `[drive]` can change."""


def _realistic(actuator: Actuator, entered: Mapping[str, Any], drive: TomlTable) -> tuple[Actuator, bool]:
    """Return the actuator with the entries of `[drive]`, and whether the joint always uses it."""
    drive.check_keys([*_OF_THE_DRIVE, "always"])
    always = drive.content.get("always", False)
    if not isinstance(always, bool):
        raise CommandError(f"{drive.label_of('always')} is {always!r}; it must be true or false.")
    changed = {key: drive.inner(key).content for key in drive.content if key != "always"}
    if not changed:
        return actuator, always
    merged = {**entered, **{key: {**entered.get(key, {}), **values} for key, values in changed.items()}}
    return Actuator.of_tables(merged, drive.label), always


def _run(table: TomlTable, joint: str) -> dict[str, Any]:
    """Return the options of the joint's scenario; names of components lack the joint."""
    for key, example in (("stop_time", "10.0"), ("step_size", "1e-4")):
        if key not in table.content:
            raise CommandError(f"{table.label} lacks {key}, in s; write {key} = {example}.", key=key)
    options = read_given_options(table.content, table.label, ())
    if isinstance(options.get("order"), list):
        options["order"] = [f"{joint}.{role}" for role in options["order"]]
    if isinstance(options.get("step_multiples"), Mapping):
        options["step_multiples"] = {f"{joint}.{role}": n for role, n in options["step_multiples"].items()}
    return options


def _move(table: TomlTable) -> Move:
    move = read_call(Move, table)
    if (move.v_peak is None) == (move.duration is None):
        has = "neither v_peak nor duration" if move.v_peak is None else "both v_peak and duration"
        raise CommandError(f"{table.label} has {has}; write one of them.", table=table.name)
    if move.q_S == move.q_E:
        raise CommandError(f"{table.label} has q_S = q_E; they must differ.", table=table.name)
    return move


def _experiment(table: TomlTable) -> JointExperiment:
    table.check_keys(["reference", "load"])
    reference = table.inner("reference", "the motion of the joint")
    cycle = read_call(Cycle, reference)
    if not 2 <= len(cycle.way_points) <= MOVES + 1 or any(a == b for a, b in pairwise(cycle.way_points)):
        raise CommandError(
            f"{reference.label_of('way_points')} must be 2 to {MOVES + 1} positions, each different from "
            "the one before."
        )
    if sum(cycle.durations) > cycle.period:
        raise CommandError(
            f"{reference.label_of('period')} is {cycle.period:g} s, but the moves take "
            f"{sum(cycle.durations):g} s in total."
        )
    return JointExperiment(cycle, _load(table.inner("load", "the load force")))


def _load(table: TomlTable) -> Load:
    load = read_call(Load, table)
    count = len(load.level)
    if not 1 <= count <= LEVELS:
        raise CommandError(f"{table.label_of('level')} has {count} values; it must have 1 to {LEVELS}.")
    if len(load.start or ()) != count - 1:
        raise CommandError(
            f"{table.label} has {count} levels and {len(load.start or ())} times in start; each level "
            "except the first needs one."
        )
    return load


def _observer_set(table: TomlTable) -> ObserverSet:
    gains = _by_rule(table, ObserverGains, OBSERVER_RULES, ("estimate",))
    if "estimate" not in table.content:
        return ObserverSet(gains)
    own = TomlTable({"x_L": table.content["estimate"]}, table.name, table.file)
    return ObserverSet(gains, read_call(StartPosition, own).x_L)


def _by_rule(
    table: TomlTable,
    gains: Callable[..., Any],
    rules: Mapping[str, Callable[..., Any]],
    ignored: Iterable[str],
) -> Any:
    """Return gains: from all their values, or by the rule that the table names."""
    rule = table.content.get("rule")
    if rule is None:
        return read_call(gains, table, ignored)
    if not isinstance(rule, str) or rule not in rules:
        known = f"it must be {' or '.join(repr(one) for one in rules)}" if rules else "there are no rules"
        raise CommandError(f"{table.label_of('rule')} is {rule!r}; {known}.", key="rule")
    return read_call(rules[rule], table, [*ignored, "rule"])


def _gains(table: TomlTable, observers: Mapping[str, ObserverSet]) -> dict[str, dict[str, GainSet]]:
    with_gains = {name: one for name, one in CONTROLLERS.items() if one.gain_type is not None}
    table.check_keys(with_gains, "controller")
    found: dict[str, dict[str, GainSet]] = {}
    for controller in table.content:
        of_controller = table.inner(controller)
        of_controller.check_keys(CONTROLLERS[controller].gains, "set of gains")
        found[controller] = {
            name: _gain_set(of_controller.inner(name), controller, observers)
            for name in of_controller.content
        }
    return found


def _gain_set(table: TomlTable, controller: str, observers: Mapping[str, ObserverSet]) -> GainSet:
    chosen = CONTROLLERS[controller]
    assert chosen.gain_type is not None
    beside = ("observer", "on_machine")
    gains = _by_rule(table, chosen.gain_type, chosen.rules, beside)
    on_machine = gains
    if "on_machine" in table.content:
        on_machine = _by_rule(table.inner("on_machine"), chosen.gain_type, chosen.rules, ())
    observer = table.content.get("observer")
    if observer is None:
        shown = f'"{next(iter(observers), "robust")}"'
        raise CommandError(f"{table.label} lacks observer, a set of gains; write observer = {shown}.")
    if isinstance(observer, str):
        if observer not in observers:
            known = f"it must be {join_names(observers)}" if observers else f"add [observer.{observer}]"
            raise CommandError(f"{table.label_of('observer')} is '{observer}', which is missing; {known}.")
        return GainSet(gains, observers[observer], on_machine)
    return GainSet(gains, _observer_set(table.inner("observer")), on_machine)


def _noisy(table: TomlTable) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, value in table.content.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise CommandError(f"{table.label_of(name)} is {value!r}; it must be a number.")
        if not math.isfinite(as_float(value)):
            raise CommandError(f"{table.label_of(name)} is {as_float(value)}; it must be a finite number.")
        found[name] = value
    return found


def _printed(table: TomlTable) -> dict[str, dict[str, Cells]]:
    return {
        scenario: {
            controller: read_call(Cells, table.inner(scenario).inner(controller))
            for controller in table.inner(scenario).content
        }
        for scenario in table.content
    }
