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
from ..variants.factors import SHEET, START, Factor, merge_options, resolve_factors
from ..variants.kinds import Uniform
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

    def value(self, fraction: float) -> float:
        """Return the value at a fraction of the range, from 0 (low) to 1 (high)."""
        if fraction <= 0.0 or fraction >= 1.0:
            # exactly the ends: rounding must not leave the range, which an FMU may refuse
            return self.low if fraction <= 0.0 else self.high
        return self.extrapolate(fraction)

    def extrapolate(self, fraction: float) -> float:
        """Return the value at any fraction, also outside of the range."""
        if self.is_logarithmic:
            return float(self.low * (self.high / self.low) ** fraction)
        return float(self.low + fraction * (self.high - self.low))

    def slope(self, fraction: float) -> float:
        """Return the derivative of the value by the fraction."""
        # central, as the scale may be logarithmic; 1e-6 balances curvature and rounding
        return (self.extrapolate(fraction + 1e-6) - self.extrapolate(fraction - 1e-6)) / 2e-6

    def to_fraction(self, value: float) -> float:
        """Return a value as a fraction of the range, within 0 and 1."""
        if self.is_logarithmic:
            fraction = np.log(max(value, self.low) / self.low) / np.log(self.high / self.low)
        else:
            fraction = (value - self.low) / (self.high - self.low)
        return float(np.clip(fraction, 0.0, 1.0))


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
        unchanged = self._unchanged_values[experiment]
        plan = replace(self.plan, options=_remove_inputs(self.plan.options))
        experiment_options = _remove_inputs(plan.experiments[experiment].options)
        scenario = load_planned(plan, merge_options([experiment_options, {SHEET: entries}]))
        changed = _read_all_start_values(scenario, self.preparations[experiment])
        return {name: value for name, value in changed.items() if unchanged.get(name) != value}

    @cached_property
    def _unchanged_values(self) -> list[dict[str, Value]]:
        return [_read_all_start_values(p.scenario, p) for p in self.preparations if p.scenario is not None]


def _remove_inputs(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options without data of inputs: no start value follows from these."""
    # without them, no value of an entry reads the files again
    return {name: value for name, value in options.items() if name != "input"}


def _read_all_start_values(scenario: Scenario, preparation: Preparation) -> dict[str, Value]:
    """Return the start values of a scenario with its options, by full name; `preparation` has its names."""
    options = scenario.options
    system = apply_parameter_files(scenario.system, options.parameters, preparation.interfaces)
    declared: dict[str, Any] = {
        f"{c.name}.{name}": value for c in system.components for name, value in c.parameters.items()
    }
    values = Names(preparation.system, preparation.interfaces).start_values(options.set)
    return declared | values | following_values(system, options)


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
        return [item.name for item in self.items]

    @property
    def start(self) -> Vector:
        """The start values as fractions of their ranges, shape (p,)."""
        return np.array([item.to_fraction(item.start) for item in self.items])

    def values(self, point: Vector) -> dict[str, float]:
        """Return the values at fractions of the ranges of shape (p,), by name."""
        return {item.name: item.value(float(x)) for item, x in zip(self.items, point, strict=True)}

    def options(self, point: Vector) -> dict[str, Any]:
        """Return the options that set the parameters when a scenario is loaded."""
        pairs = zip(self.items, point, strict=True)
        return merge_options(
            item.factor.options(item.value(float(x))) for item, x in pairs if item.factor is not None
        )

    def start_values(self, point: Vector, experiment: int) -> dict[str, Value]:
        """Return the start values in a run of an experiment, by full name.

        Raises:
            CommandError: A data sheet has errors with these values.
        """
        options = self.options(point)
        entries = options.get(SHEET, {})
        changed = {} if self.entries is None else self.entries.start_values(experiment, entries)
        return changed | options.get(START, {})

    def key(self, point: Vector) -> tuple[float, ...]:
        """Return what decides the result of a run; sensors do not."""
        return tuple(float(x) for item, x in zip(self.items, point, strict=True) if item.factor is not None)

    def sensor(self, point: Vector, signal: str) -> tuple[float, float, float]:
        """Return offset, gain and delay in s of the sensor of a signal."""
        settings = {"offset": 0.0, "gain": 1.0, "delay": 0.0}
        for item, x in zip(self.items, point, strict=True):
            if item.sensor is not None and item.sensor[1] == signal:
                settings[item.sensor[0]] = item.value(float(x))
        return settings["offset"], settings["gain"], settings["delay"]


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
    parameters = list[Parameter]()
    for name, value in plan.vary.items():
        label = f"'{name}' of {plan.where}"
        if (match := _SENSOR.fullmatch(name)) is not None:
            component, variable = preparation.system.split(match[2].strip())
            sensor = match[1], f"{component.name}.{variable}"
            parameters.append(_build_sensor_parameter(name, sensor, value, label, measured))
        else:
            factors = resolve_factors({name: value}, preparation.system, preparation.interfaces, plan.where)
            parameters += [_build_parameter(factor, preparation, label) for factor in factors]
    names = [parameter.name for parameter in parameters]
    if twice := [name for name in names if names.count(name) > 1]:
        raise CommandError(f"{plan.where} has the parameter '{twice[0]}' twice; remove one.", name=twice[0])
    if not any(_is_sheet_entry(parameter) for parameter in parameters):
        return Parameters(parameters)
    entries = SheetEntries(plan, preparations)
    _check_sheet_entries(entries, parameters)
    return Parameters(parameters, entries)


def _is_sheet_entry(parameter: Parameter) -> bool:
    return parameter.factor is not None and any(t.kind == SHEET for t in parameter.factor.targets)


def _check_sheet_entries(entries: SheetEntries, parameters: Sequence[Parameter]) -> None:
    """Raise CommandError if an entry changes no start value, or one that varies too.

    Errors of a data sheet are raised only if neither end of the range nor the start gives a valid sheet.
    """
    plan = entries.plan
    factors = [p.factor for p in parameters if p.factor is not None and not _is_sheet_entry(p)]
    varied = {target.name for f in factors for target in f.targets}
    for parameter in filter(_is_sheet_entry, parameters):
        label, factor = f"'{parameter.name}' of {plan.where}", parameter.factor
        assert factor is not None
        for i in range(len(plan.experiments)):
            changed, problem = set[str](), None
            # an end of the range may contradict other entries; one valid value is enough for a search
            for value in (parameter.low, parameter.start, parameter.high):
                try:
                    changed |= set(entries.start_values(i, factor.options(value)[SHEET]))
                except CommandError as error:
                    problem = problem or error
            if not changed and problem is not None:
                raise problem
            if not changed:
                raise CommandError(
                    f"{label} changes no start value of the experiment '{plan.experiments[i].name}'.",
                    name=parameter.name,
                )
            if conflicts := sorted(changed & varied):
                raise CommandError(
                    f"{label} changes {conflicts[0]}, which is estimated itself; remove one.",
                    name=conflicts[0],
                )


def _build_parameter(factor: Factor, preparation: Preparation, label: str) -> Parameter:
    """Return the parameter of a factor.

    Raises:
        CommandError: It is neither an entry of a data sheet nor of Real start values, or has no range.
    """
    if any(t.kind == SHEET for t in factor.targets):
        ends = _require_range(factor.distribution, label)
        return _make_parameter(factor.name, *ends, None, factor.unit, factor=factor)
    if wrong := [t.name for t in factor.targets if t.kind != START]:
        raise CommandError(
            f"{label} cannot be estimated: {wrong[0]} is not a start value; write COMPONENT.VARIABLE.",
            name=wrong[0],
        )
    names = Names(preparation.system, preparation.interfaces)
    for target in factor.targets:
        if (kind := names.find(target.name).variable.type) != "Real":
            raise CommandError(
                f"{label} cannot be estimated: {target.name} is of the type {kind}, not Real.",
                name=target.name,
            )
    low, high = sorted(float(factor.value(x)) for x in _require_range(factor.distribution, label))  # type: ignore[arg-type]
    start = None
    if len(factor.targets) == 1:
        start = names.find(factor.targets[0].name).start_number
    elif factor.targets[0].nominal is not None:
        start = 1.0
    return _make_parameter(factor.name, low, high, start, factor.unit, factor=factor)


def _build_sensor_parameter(
    name: str, sensor: tuple[str, str], value: Any, label: str, measured: Mapping[str, SiUnit | None]
) -> Parameter:
    """Return a parameter of a sensor, which is its kind (offset, gain or delay) and its signal.

    Raises:
        CommandError: The signal is not measured, or the value is not a range.
    """
    kind, signal = sensor
    if signal not in measured:
        raise CommandError(f"{label}: {signal} is not measured; name a measured signal.", name=signal)
    unit = {"offset": measured[signal], "gain": None, "delay": parse_unit_name("s", label)}[kind]
    distribution = parse_distribution(value, label, lambda text: read_quantity(text, label, unit))
    start = 1.0 if kind == "gain" else 0.0
    return _make_parameter(name, *_require_range(distribution, label), start, str(unit or ""), sensor=sensor)


def _make_parameter(
    name: str, low: float, high: float, start: float | None, unit: str, **more: Any
) -> Parameter:
    """Return a parameter. One whose start is not inside of its range starts in the middle."""
    parameter = Parameter(name, low, high, low, unit, **more)
    is_inside = start is not None and low < start < high
    return replace(parameter, start=start if is_inside else parameter.value(0.5))


def _require_range(distribution: Any, label: str) -> tuple[float, float]:
    """Return both ends of a uniform range without points; raise CommandError for anything else."""
    if not isinstance(distribution, Uniform) or distribution.points is not None:
        raise CommandError(f"{label} needs a range LOW:HIGH, such as 0.1:10.")
    return float(distribution.low), float(distribution.high)
