"""The gains of a search as a unit cube: each axis is one gain, in the quantiles of its distribution."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, join_names
from ...base.quantities import has_unit
from ...fmu.interface import Interface
from ...fmu.units import FmuUnits, read_si_number
from ...run.options import list_options
from ...system.model import System, Value
from ...system.names import Names
from ..variants.distributions import parse_distribution
from ..variants.factors import Factor, resolve_factors
from ..variants.kinds import Distribution, LogUniform, Uniform
from ..variants.targets import START, merge_options, needs_preparation
from .expressions import Expression, parse_expression
from .plan import TuningPlan

_FINE = 2001
"""Points of an axis that are compared to locate a value."""


@dataclass(frozen=True)
class GainAxis:
    """One gain; `factor` is None for a name that only expressions in `derive` use."""

    name: str
    distribution: Distribution
    factor: Factor | None = None

    def value(self, quantile: float) -> Value:
        """Return the gain at a place from 0 to 1, in its unit."""
        (drawn,) = self.distribution.at(np.array([quantile]))
        found = drawn if self.factor is None else self.factor.value(drawn)
        assert found is not None
        return found

    def place(self, value: float | None) -> float:
        """Return the place nearest to a value of the gain; the middle for None."""
        if value is None:
            return 0.5
        places = np.linspace(0.0, 1.0, _FINE)
        drawn = self.distribution.at(places)
        if not all(isinstance(x, (int, float)) for x in drawn):
            return 0.5
        values = [drawn if self.factor is None else self.factor.value(x) for x in drawn]
        return float(places[int(np.argmin(np.abs(np.array(values, dtype=float) - value)))])


@dataclass(frozen=True)
class Space:
    """All gains, those that derive from them, and their values in the scenario."""

    axes: Sequence[GainAxis]
    derived: Sequence[tuple[Sequence[Factor], Expression]]
    start: Mapping[str, float | None]

    def values(self, point: Vector) -> dict[str, Value]:
        """Return the gains at a point of the cube, by name."""
        return {axis.name: axis.value(float(x)) for axis, x in zip(self.axes, point, strict=True)}

    def options(self, values: Mapping[str, Value]) -> dict[str, Any]:
        """Return the options that set the gains and those derived from them."""
        parts = [axis.factor.options(values[axis.name]) for axis in self.axes if axis.factor is not None]
        numbers = {name: float(x) for name, x in values.items() if isinstance(x, (int, float))}
        for targets, derived in self.derived:
            parts += [factor.options(derived.value(numbers)) for factor in targets]
        return merge_options(parts)

    def places(self) -> list[float]:
        """Return the places of the scenario's own gains."""
        return [axis.place(self.start[axis.name]) for axis in self.axes]


def build_space(plan: TuningPlan, system: System, interfaces: Mapping[str, Interface]) -> Space:
    """Return the space of a plan in a system; raise CommandError for a wrong name or one that cannot vary."""
    free = [name for name in plan.vary if _is_free(name, plan.vary[name], system)]
    units = [interface.units for interface in interfaces.values()]
    known = {name: _range(given, units) for name, given in plan.vary.items() if name not in free}
    found = resolve_factors(known, system, interfaces, plan.where)
    _check_start_values(found, plan.where)
    axes = [GainAxis(f.name, f.distribution, f) for f in found]
    axes += [
        GainAxis(name, parse_distribution(_range(plan.vary[name], units), f"'{name}' of {plan.where}"))
        for name in free
    ]
    derived = _derive_gains(plan, axes, system, interfaces)
    used = {name for _, one in derived for name in one.names}
    if idle := [name for name in free if name not in used]:
        raise CommandError(
            f"'{idle[0]}' of {plan.where} is neither a start value nor an option nor used in 'derive'; "
            "write component.variable, or use it in 'derive'.",
            name=idle[0],
        )
    start = {axis.name: _start(axis, system, interfaces) for axis in axes}
    return Space(axes, derived, start)


def check_during_a_run(found: Sequence[Factor], where: str) -> None:
    """Raise CommandError for a factor that a prepared simulation cannot vary."""
    if wrong := [factor.name for factor in found if any(map(needs_preparation, factor.targets))]:
        raise CommandError(
            f"'{wrong[0]}' of {where} needs a new preparation; vary start values or options of the stepping.",
            name=wrong[0],
        )


def _check_start_values(found: Sequence[Factor], where: str) -> None:
    """Raise CommandError for a gain that is an option or an FMU."""
    if wrong := [target.name for factor in found for target in factor.targets if target.kind != START]:
        raise CommandError(
            f"'{wrong[0]}' of {where} is not a start value; gains must be start values.", name=wrong[0]
        )


def _is_free(name: str, given: Any, system: System) -> bool:
    """Return whether a name in `vary` is neither a target in the system nor an option."""
    is_component = any(c.name == name for c in system.components)
    has_targets = isinstance(given, Mapping) and "of" in given
    return "." not in name and name not in list_options() and not is_component and not has_targets


def _range(given: Any, units: Sequence[FmuUnits]) -> Any:
    """Return the range of a gain; LOW:HIGH of positive numbers is logarithmic."""
    if not isinstance(given, str):
        return given
    found = parse_distribution(given, "the range", lambda text: read_si_number(text, "the range", units))
    if isinstance(found, Uniform) and found.low > 0:
        ends = [text.strip() for text in given.split(":")]
        if any(map(has_unit, ends[:2])) and not found.relative:
            return {"distribution": LogUniform.name, "low": ends[0], "high": ends[1]}
        return LogUniform(found.low, found.high, found.points, relative=found.relative)
    return given


def _derive_gains(
    plan: TuningPlan, axes: Sequence[GainAxis], system: System, interfaces: Mapping[str, Interface]
) -> list[tuple[Sequence[Factor], Expression]]:
    names = [axis.name for axis in axes]
    taken = {t.name for axis in axes if axis.factor is not None for t in axis.factor.targets}
    found = list[tuple[Sequence[Factor], Expression]]()
    for name, text in plan.derive.items():
        label = f"'{name}' of 'derive' in {plan.where}"
        one = parse_expression(text, label)
        if unknown := sorted(one.names - set(names)):
            raise CommandError(f"{label} uses '{unknown[0]}', which does not vary; use {join_names(names)}.")
        targets = resolve_factors({name: 0.0}, system, interfaces, plan.where)
        _check_start_values(targets, plan.where)
        if both := taken & {t.name for f in targets for t in f.targets}:
            raise CommandError(
                f"{plan.where} sets {min(both)} twice: in 'vary' and in 'derive'.", name=min(both)
            )
        taken |= {t.name for f in targets for t in f.targets}
        found.append((targets, one))
    return found


def _start(axis: GainAxis, system: System, interfaces: Mapping[str, Interface]) -> float | None:
    """Return the value of a gain in the scenario; None if it is not a single number."""
    if axis.factor is None:
        return None
    first, *others = axis.factor.targets
    if others and first.nominal is not None:
        return 1.0
    return Names(system, interfaces).find(first.name).start_number
