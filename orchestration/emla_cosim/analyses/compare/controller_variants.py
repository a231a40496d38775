"""The controllers to compare, each with one or more of its sets of gains, and their equal terms."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple
from zlib import crc32

from ...base.errors import CommandError, join_names
from ...base.toml_structs import read_toml
from ...base.values import convert_value
from ...run.scenarios.scenario_file import TUNINGS
from ...study.controllers import CONTROLLERS, choose_controller
from ...study.joint import describe_observer
from ...study.loading import load
from ...study.registration import SEED, is_random
from ...system.model import Value
from ...system.names import Names
from ..execution.worker_payload import Preparation
from ..variants.factors import find_start_values
from ..variants.sampling import draw_seeds

ALL, RECOMMENDED = "all", "recommended"
"""Keywords for all sets of gains of a controller, and for its recommended set."""

Choice = str | type
"""A controller: its name, FILE.fmu, FILE.py:BLOCK, or a block."""


@dataclass(frozen=True)
class ControllerVariant:
    """A controller and one set of its gains."""

    controller: Choice
    gains: str

    @property
    def label(self) -> str:
        """The name of the controller, or that of its file or block."""
        return label_controller(self.controller)

    def __str__(self) -> str:
        return f"{self.label}/{self.gains}"


def label_controller(controller: Choice) -> str:
    """Return the name of a controller for tables."""
    return controller if isinstance(controller, str) else controller.__name__


def select_variants(
    controllers: Sequence[Choice] | None = None,
    gains: Sequence[str] | None = None,
    also: Sequence[str] = (),
    preferred: str | None = None,
) -> list[ControllerVariant]:
    """Return the controllers, by default all of `CONTROLLERS`, with the sets of gains to compare.

    Controllers without a named set use their recommended set.

    Args:
        controllers: Names, FMUs or blocks.
        gains: SET (of each controller that has it), CONTROLLER/SET, "recommended" or "all".
        also: Sets to add if `gains` is empty, for controllers of `CONTROLLERS` that have them.
        preferred: Set that is the recommended one of each controller that has it.

    Raises:
        CommandError: A controller or a set does not exist, or no compared controller has the set.
    """
    names = list(dict.fromkeys(_resolve_controllers(controllers)))
    choices = {controller: choose_controller(controller, None, preferred) for controller in names}
    sets = {controller: list(default.controller.gains) for controller, default in choices.items()}
    defaults = {controller: default.gain_set for controller, default in choices.items()}
    texts = convert_value(gains or (), Sequence[str], "the list of gains to compare")
    selected = _find_sets(texts, sets, defaults)
    if not gains:
        for controller in (c for c in names if c in CONTROLLERS):
            selected[controller] = {defaults[controller], *also}
    return [
        ControllerVariant(controller, gain_set)
        for controller in names
        for gain_set in ([s for s in sets[controller] if s in selected[controller]] or [defaults[controller]])
    ]


def list_other_variants(compared: Sequence[ControllerVariant]) -> list[str]:
    """Return sets of gains of the compared controllers that are not compared, as CONTROLLER/SET."""
    labels = set(map(str, compared))
    controllers = dict.fromkeys(variant.label for variant in compared if variant.controller in CONTROLLERS)
    return [s for c in controllers for s in (f"{c}/{g}" for g in CONTROLLERS[c].gains) if s not in labels]


def _resolve_controllers(controllers: Sequence[Choice] | None) -> list[Choice]:
    """Return the controllers, all built-in ones for None; raise CommandError if it is not a list of them."""
    if controllers is None:
        return list(CONTROLLERS)
    if isinstance(controllers, (str, type)) or not isinstance(controllers, Sequence) or not controllers:
        raise CommandError(
            f"the controllers to compare are {controllers!r}; they must be a list of one or more."
        )
    if wrong := [each for each in controllers if not isinstance(each, (str, type))]:
        raise CommandError(f"a controller to compare is {wrong[0]!r}; it must be a name, a file or a block.")
    return list(controllers)


def _find_sets(
    gains: Sequence[str], sets: Mapping[Choice, Sequence[str]], defaults: Mapping[Choice, str]
) -> dict[Choice, set[str]]:
    """Return the sets that the texts select, by controller; raise CommandError for an unknown one."""
    selected: dict[Choice, set[str]] = {controller: set() for controller in sets}
    for text in gains:
        label, slash, gain_set = text.rpartition("/")
        owners = [c for c in sets if label_controller(c) == label] if slash else list(sets)
        if not owners:
            raise CommandError(
                f"the gains {text} are for the controller '{label}', which is not compared; "
                f"compared {_join_with_verb([label_controller(c) for c in sets])}.",
                name=text,
            )
        keywords = {ALL: sets, RECOMMENDED: {c: [default] for c, default in defaults.items()}}
        matches = {
            c: keywords[gain_set][c] if gain_set in keywords else {gain_set} & {*sets[c]} for c in owners
        }
        if not any(matches.values()):
            existing = list(dict.fromkeys(name for c in owners for name in sets[c]))
            raise CommandError(
                f"the controller {label} has no set of gains '{gain_set}'; it has {join_names(existing)}."
                if slash
                else f"no controller that is compared has the set of gains '{gain_set}'; there "
                f"{_join_with_verb(existing)}.",
                name=text,
            )
        for controller, names in matches.items():
            selected[controller] |= set(names)
    return selected


def _join_with_verb(names: Sequence[str]) -> str:
    return f"{'is' if len(names) == 1 else 'are'} {join_names(names)}"


CURRENT, VOLTAGE = "limit.i_reserve", "limit.u_reserve"
"""Parameters of a controller: reserves as parts of its limits of current and voltage."""

_ENTROPY = 26
"""Seed of the draw of held-out seeds; any number that no tuning plan uses would do."""

_TRUTHS = {"false": 0.0, "true": 1.0}


class HeldOutSeeds:
    """Seeds that the plans of the built-in tunings use neither for training nor for validation."""

    def __init__(self, count: int) -> None:
        self._without = list_tuning_seeds()
        self.seeds = draw_seeds(_ENTROPY, count, self._without)

    def values(self, names: Sequence[str], seed: int) -> dict[str, Value]:
        """Return the start values of the random sequences for one held-out seed, by full name.

        The seed of a sequence depends on its name alone, so every controller meets the same sequences.
        """
        # crc32, not hash(): that differs between processes
        return {name: draw_seeds([seed, crc32(name.encode())], 1, self._without)[0] for name in names}


def list_tuning_seeds() -> set[int]:
    """Return the seeds that the plans of the built-in tunings train and validate with."""
    plans = [read_toml(text(), name) for name, text in TUNINGS.items()]
    return {
        seed for plan in plans for seed in draw_seeds(plan["seed"], plan["training"] + plan["validation"])
    }


def read_start_values(prepared: Preparation, values: Mapping[str, Value]) -> Callable[[str], float | None]:
    """Return a function that returns a start value by full name; None if there is no such number.

    `values` are start values of the run, by full name; they override those of the system.
    """
    names = Names(prepared.system, prepared.interfaces)

    def value(name: str) -> float | None:
        if (variable := names.get(name)) is None:
            return None
        number = float(values[name]) if name in values else variable.start_number
        return _TRUTHS.get(str(variable.variable.start).lower()) if number is None else number

    return value


def list_random_seeds(prepared: Preparation, values: Mapping[str, Value]) -> list[str]:
    """Return the full names of the seeds of sequences that affect a run; `values` are its start values."""
    value = read_start_values(prepared, values)
    seeds = find_start_values(SEED, prepared.system, prepared.interfaces)
    return [name for name in seeds if is_random(name, value)]


class Reserves(NamedTuple):
    """Reserves as parts of the limits of current and voltage; None for a quantity that is not limited."""

    current: float | None
    voltage: float | None

    def __str__(self) -> str:
        return " and ".join("no limit" if part is None else f"{100.0 * part:.3g} %" for part in self)


def parse_reserves(reserves: Sequence[float] | None) -> Reserves | None:
    """Return reserves of current and voltage; raise CommandError for invalid ones."""
    if reserves is None:
        return None
    parts = convert_value(list(reserves), Sequence[float], "the reserves")
    if len(parts) != 2 or not all(0.0 <= part <= 0.9 for part in parts):
        raise CommandError(
            f"the reserves are {reserves!r}; they must be two parts from 0 to 0.9, of current and voltage, "
            "such as 0.02,0.2."
        )
    return Reserves(*parts)


def find_reserve_values(prepared: Preparation, reserves: Reserves) -> dict[str, Value]:
    """Return the start values, by full name, that set these reserves in all controllers of a system."""
    parts = {CURRENT: reserves.current, VOLTAGE: reserves.voltage}
    return {
        f"{controller}.{name}": float(part)
        for controller in _list_controller_names(prepared)
        for name, part in parts.items()
        if name in prepared.interfaces[controller].variables and part is not None
    }


def describe_reserves(prepared: Preparation, values: Mapping[str, Value]) -> str:
    """Return the reserves of the controllers of a system as text; `values` has start values of the run."""
    value = read_start_values(prepared, values)
    reserves = (_read_limit_reserves(controller, value) for controller in _list_controller_names(prepared))
    return ", ".join(dict.fromkeys(str(each or "not stated") for each in reserves))


def _list_controller_names(prepared: Preparation) -> list[str]:
    return [c.name for c in prepared.system.components if c.name.rpartition(".")[2] == "controller"]


def _read_limit_reserves(controller: str, value: Callable[[str], float | None]) -> Reserves | None:
    """Return the reserves of a controller; None if it has no parameters for them."""
    current, voltage = value(f"{controller}.{CURRENT}"), value(f"{controller}.{VOLTAGE}")
    if current is None or voltage is None:
        return None
    switch = value(f"{controller}.limit_current")  # only RSBA has it; the other controllers always limit
    limits = switch != 0.0
    counts = limits and (switch is None or value(f"{controller}.weaken_field") != 0.0)
    return Reserves(current if limits else None, voltage if counts else None)


def list_observers(
    prepared: Preparation, joints: Sequence[str], values: Mapping[str, Value]
) -> dict[str, str]:
    """Return the observer of each joint as text; `values` has start values of the run by full name.

    The text is the rule of its gains with its poles, the name of its FMU if it has no such gains, or "none".
    """
    components, value = {c.name: c for c in prepared.system.components}, read_start_values(prepared, values)
    observers = dict.fromkeys(joints, "none")
    for joint in joints:
        if component := components.get(f"{joint}.observer"):
            rule = describe_observer(lambda name, of=component.name: value(f"{of}.{name}"))
            observers[joint] = rule or str(component.fmu or component.model)
    return observers


def find_equal_gains(
    scenario: str, controllers: Sequence[Choice], options: Mapping[str, Any]
) -> list[ControllerVariant]:
    """Return a set of gains for each controller such that all use the same observers; empty if none exist."""
    by_observers = list[dict[tuple[str | None, ...], ControllerVariant]]()
    for controller in controllers:
        by_observers.append({})
        for gains in choose_controller(controller, None).controller.gains:
            overrides: dict[str, Any] = {**options, "controller": controller, "gains": gains}
            with suppress(CommandError):  # a joint lacks this set
                components = load(scenario, **overrides).system.components
                observers = [c.parameters for c in components if c.name.endswith(".observer")]
                rules = tuple(describe_observer(parameters.get) for parameters in observers)
                by_observers[-1].setdefault(rules, ControllerVariant(controller, gains))
    first, *remaining = by_observers
    shared = next((rules for rules in first if all(rules in sets for sets in remaining)), None)
    return [] if shared is None else [sets[shared] for sets in by_observers]
