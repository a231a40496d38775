"""Unknown parameters as a unit cube, and the options that set them in a run."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.quantities import parse_unit_name, read_quantity
from ...base.units import SiUnit
from ...run.preparation import apply_parameter_files
from ...run.registered import following_values
from ...run.scenarios.scenario import Scenario
from ...system.model import Value
from ...system.names import Names
from ..execution.worker_payload import Preparation
from ..frame.plan_files import load_planned
from ..variants.distributions import parse_distribution
from ..variants.factors import Factor, resolve_factors
from ..variants.kinds import Uniform
from ..variants.targets import SHEET, START, merge_options
from .plan import IdentificationPlan

DELAY = "delay"
"""Kind of the parameter of a sensor that is late."""

_SENSOR = re.compile(rf"\s*(offset|gain|{DELAY})\((.+)\)\s*")

_DECADE = 10.0
"""Ratio of the ends of a positive range from which the parameter is estimated on a logarithmic scale."""


@dataclass(frozen=True)
class Parameter:
    """An unknown parameter.

    Attributes:
        name: its name.
        low: lower end of its range.
        high: upper end.
        start: value to start from.
        unit: its unit.
        factor: how it is set in a run; None for one of a sensor.
        sensor: kind (offset, gain or delay) and signal of one of a sensor.
    """

    name: str
    low: float
    high: float
    start: float
    unit: str
    factor: Factor | None = None
    sensor: tuple[str, str] | None = None

    @property
    def is_logarithmic(self) -> bool:
        """Whether it is estimated on a logarithmic scale."""
        return self.low > 0.0 and self.high >= _DECADE * self.low

    def value(self, place: float) -> float:
        """Return the value at a place from 0 (low) to 1 (high)."""
        if place <= 0.0 or place >= 1.0:
            return self.low if place <= 0.0 else self.high
        return self.extrapolate(place)

    def extrapolate(self, place: float) -> float:
        """Return the value at any place, also outside of the range."""
        if self.is_logarithmic:
            return float(self.low * (self.high / self.low) ** place)
        return float(self.low + place * (self.high - self.low))

    def slope(self, place: float) -> float:
        """Return the derivative of the value by the place."""
        return (self.extrapolate(place + 1e-6) - self.extrapolate(place - 1e-6)) / 2e-6

    def place(self, value: float) -> float:
        """Return the place of a value, within 0 and 1."""
        if self.is_logarithmic:
            place = np.log(max(value, self.low) / self.low) / np.log(self.high / self.low)
        else:
            place = (value - self.low) / (self.high - self.low)
        return float(np.clip(place, 0.0, 1.0))


@dataclass(frozen=True)
class SheetEntries:
    """The start values that follow from entries of data sheets, by experiment.

    Attributes:
        plan: the plan.
        preparations: the prepared experiments.
    """

    plan: IdentificationPlan
    preparations: Sequence[Preparation]

    def start_values(self, experiment: int, entries: Mapping[str, Value]) -> dict[str, Value]:
        """Return the start values of an experiment that entries change, by full name.

        Values that the experiment sets itself stay, and those that follow from them.

        Args:
            experiment: Position of the experiment.
            entries: Values by JOINT.TABLE.ENTRY, as data sheets print them.

        Raises:
            CommandError: A data sheet with these entries has errors.
        """
        before = self._before[experiment]
        plan = replace(self.plan, options=_without_inputs(self.plan.options))
        own = _without_inputs(plan.experiments[experiment].options)
        changed = load_planned(plan, merge_options([own, {SHEET: entries}]))
        after = _all_start_values(changed, self.preparations[experiment])
        return {name: value for name, value in after.items() if before.get(name) != value}

    @cached_property
    def _before(self) -> list[dict[str, Value]]:
        return [_all_start_values(one.scenario, one) for one in self.preparations if one.scenario is not None]


def _without_inputs(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options without data of inputs: no start value follows from these."""
    return {name: value for name, value in options.items() if name != "input"}


def _all_start_values(scenario: Scenario, preparation: Preparation) -> dict[str, Value]:
    """Return the start values of a scenario with its options, by full name; `preparation` has its names."""
    options = scenario.options
    system = apply_parameter_files(scenario.system, options.parameters, preparation.interfaces)
    own: dict[str, Any] = {
        f"{c.name}.{name}": x for c in system.components for name, x in c.parameters.items()
    }
    values = Names(preparation.system, preparation.interfaces).start_values(options.set)
    return own | values | following_values(system, options)


@dataclass(frozen=True)
class Parameters:
    """All unknown parameters.

    Attributes:
        items: the parameters.
        entries: the start values that follow from entries of data sheets, if one is unknown.
    """

    items: Sequence[Parameter]
    entries: SheetEntries | None = None

    @property
    def names(self) -> list[str]:
        """Their names."""
        return [one.name for one in self.items]

    @property
    def start(self) -> Vector:
        """The places to start from, shape (p,)."""
        return np.array([one.place(one.start) for one in self.items])

    def values(self, places: Vector) -> dict[str, float]:
        """Return the values at places of shape (p,), by name."""
        return {one.name: one.value(float(x)) for one, x in zip(self.items, places, strict=True)}

    def options(self, places: Vector) -> dict[str, Any]:
        """Return the options that set the parameters when a scenario is loaded."""
        chosen = zip(self.items, places, strict=True)
        return merge_options(
            one.factor.options(one.value(float(x))) for one, x in chosen if one.factor is not None
        )

    def start_values(self, places: Vector, experiment: int) -> dict[str, Value]:
        """Return the start values in a run of an experiment, by full name.

        Raises:
            CommandError: A data sheet has errors with these values.
        """
        options = self.options(places)
        entries = options.get(SHEET, {})
        changed = {} if self.entries is None else self.entries.start_values(experiment, entries)
        return changed | options.get(START, {})

    def key(self, places: Vector) -> tuple[float, ...]:
        """Return what decides the result of a run; sensors do not."""
        return tuple(float(x) for one, x in zip(self.items, places, strict=True) if one.factor is not None)

    def sensor(self, places: Vector, signal: str) -> tuple[float, float, float]:
        """Return offset, gain and delay in s of the sensor of a signal."""
        found = {"offset": 0.0, "gain": 1.0, "delay": 0.0}
        for one, x in zip(self.items, places, strict=True):
            if one.sensor is not None and one.sensor[1] == signal:
                found[one.sensor[0]] = one.value(float(x))
        return found["offset"], found["gain"], found["delay"]


def resolve_parameters(
    plan: IdentificationPlan, preparations: Sequence[Preparation], measured: Mapping[str, SiUnit | None]
) -> Parameters:
    """Return the unknown parameters of a plan in its system.

    Args:
        plan: The plan.
        preparations: The prepared experiments.
        measured: The units of the measured signals.

    Raises:
        CommandError: A name does not exist, or has no range.
    """
    preparation = preparations[0]
    found = list[Parameter]()
    for name, given in plan.vary.items():
        label = f"'{name}' of {plan.where}"
        if (of_sensor := _SENSOR.fullmatch(name)) is not None:
            component, variable = preparation.system.split(of_sensor[2].strip())
            sensor = of_sensor[1], f"{component.name}.{variable}"
            found.append(_sensor(name, sensor, given, label, measured))
        else:
            factors = resolve_factors({name: given}, preparation.system, preparation.interfaces, plan.where)
            found += [_parameter(factor, preparation, label) for factor in factors]
    if twice := [one.name for one in found if [x.name for x in found].count(one.name) > 1]:
        raise CommandError(f"{plan.where} has the parameter '{twice[0]}' twice; remove one.", name=twice[0])
    if not any(_is_entry(one) for one in found):
        return Parameters(found)
    entries = SheetEntries(plan, preparations)
    _check_entries(entries, found)
    return Parameters(found, entries)


def _is_entry(one: Parameter) -> bool:
    return one.factor is not None and any(t.kind == SHEET for t in one.factor.targets)


def _check_entries(entries: SheetEntries, parameters: Sequence[Parameter]) -> None:
    """Raise CommandError if entries change no start value, one that varies too, or have errors."""
    plan = entries.plan
    varied = {t.name for one in parameters if one.factor and not _is_entry(one) for t in one.factor.targets}
    for one in filter(_is_entry, parameters):
        label, factor = f"'{one.name}' of {plan.where}", one.factor
        assert factor is not None
        for experiment, described in enumerate(plan.experiments):
            changed, problem = set[str](), None
            for value in (one.low, one.start, one.high):
                try:
                    changed |= set(entries.start_values(experiment, factor.options(value)[SHEET]))
                except CommandError as error:
                    problem = problem or error
            if not changed and problem is not None:
                raise problem
            if not changed:
                raise CommandError(
                    f"{label} changes no start value of the experiment '{described.name}'.", name=one.name
                )
            if both := sorted(changed & varied):
                raise CommandError(f"{label} changes {both[0]}, which is estimated itself.", name=both[0])


def _parameter(factor: Factor, preparation: Preparation, label: str) -> Parameter:
    if any(t.kind == SHEET for t in factor.targets):
        return _with_start(factor.name, *_ends(factor.distribution, label), None, factor.unit, factor=factor)
    if wrong := [t.name for t in factor.targets if t.kind != START]:
        raise CommandError(f"{label} cannot be estimated: {wrong[0]} is not a start value.", name=wrong[0])
    names = Names(preparation.system, preparation.interfaces)
    for target in factor.targets:
        if (kind := names.find(target.name).variable.type) != "Real":
            raise CommandError(
                f"{label} cannot be estimated: {target.name} is of the type {kind}.", name=target.name
            )
    low, high = sorted(float(factor.value(x)) for x in _ends(factor.distribution, label))  # type: ignore[arg-type]
    start = None
    if len(factor.targets) == 1:
        start = names.find(factor.targets[0].name).start_number
    elif factor.targets[0].nominal is not None:
        start = 1.0
    return _with_start(factor.name, low, high, start, factor.unit, factor=factor)


def _sensor(
    name: str, sensor: tuple[str, str], given: Any, label: str, measured: Mapping[str, SiUnit | None]
) -> Parameter:
    kind, signal = sensor
    if signal not in measured:
        raise CommandError(f"{label}: {signal} is not measured.", name=signal)
    unit = {"offset": measured[signal], "gain": None, "delay": parse_unit_name("s", label)}[kind]
    distribution = parse_distribution(given, label, lambda text: read_quantity(text, label, unit))
    start = 1.0 if kind == "gain" else 0.0
    return _with_start(name, *_ends(distribution, label), start, str(unit or ""), sensor=sensor)


def _with_start(name: str, low: float, high: float, start: float | None, unit: str, **more: Any) -> Parameter:
    """Return a parameter. One whose start is not inside of its range starts in the middle."""
    parameter = Parameter(name, low, high, low, unit, **more)
    is_inside = start is not None and low < start < high
    return replace(parameter, start=start if is_inside else parameter.value(0.5))


def _ends(distribution: Any, label: str) -> tuple[float, float]:
    if not isinstance(distribution, Uniform) or distribution.points is not None:
        raise CommandError(f"{label} needs a range LOW:HIGH, such as 0.1:10.")
    return float(distribution.low), float(distribution.high)
