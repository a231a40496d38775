"""The gains of a search as a unit cube, and arithmetic over their names in plans."""

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
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
from ..variants.factors import START, Factor, merge_options, needs_preparation, resolve_factors
from ..variants.kinds import Distribution, LogUniform, Uniform
from .plan import TuningPlan

_OPERATIONS: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,  # `operator.pow` has complex roots of negative numbers, and never ends for 10**10**10
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": abs,
    "exp": math.exp,
    "log": math.log,
    "max": max,
    "min": min,
    "sqrt": math.sqrt,
}

_Compute = Callable[[Mapping[str, float]], Any]
"""Function that returns the value of a part of an expression, from the values of names."""


@dataclass(frozen=True)
class Expression:
    """An expression and the names in it; create it with `parse_expression`."""

    text: str
    names: frozenset[str]
    compute: _Compute

    def value(self, values: Mapping[str, float]) -> float:
        """Return the value of the expression; NaN if it is undefined, as for log(0)."""
        try:
            return float(self.compute(values))
        except (ArithmeticError, ValueError):
            return math.nan


def parse_expression(text: str, where: str) -> Expression:
    """Parse an expression of numbers, names, + - * / ** and a few functions.

    Args:
        text: The expression. Names are those of variables and figures, with dots and brackets.
        where: The place of the text, for error messages.

    Raises:
        CommandError: The text is not such an expression.
    """
    names = set[str]()
    try:
        compute = _compile(ast.parse(text.strip(), mode="eval").body, names)
    except (SyntaxError, TypeError, ValueError, RecursionError, MemoryError):
        raise CommandError(
            f"{where}: '{text}' is not an expression; use numbers, names, + - * / ** and "
            f"{join_names(_FUNCTIONS)}.",
            expression=text,
        ) from None
    return Expression(text, frozenset(names), compute)


def _compile(tree: ast.expr, names: set[str]) -> _Compute:
    """Return the function of a tree, and add its names to `names`.

    Raises:
        ValueError: The tree is not arithmetic.
        TypeError: A function has too few or too many arguments.
    """
    if isinstance(tree, ast.Constant) and type(tree.value) in (int, float):
        return lambda _: tree.value
    if (name := _read_name(tree)) is not None:
        names.add(name)
        return operator.itemgetter(name)
    match tree:
        case ast.BinOp(left, operation, right) if type(operation) in _OPERATIONS:
            operands, function = [left, right], _OPERATIONS[type(operation)]
        case ast.UnaryOp(operation, operand) if type(operation) in _OPERATIONS:
            operands, function = [operand], _OPERATIONS[type(operation)]
        case ast.Call(ast.Name(name), operands, []) if name in _FUNCTIONS:
            function = _FUNCTIONS[name]
            function(*(2.0 for _ in operands))  # raises TypeError if the number of arguments is wrong
        case _:
            raise ValueError
    parts = [_compile(operand, names) for operand in operands]
    return lambda values: function(*(part(values) for part in parts))


def _read_name(tree: ast.expr) -> str | None:
    """Return the name that a tree represents: `a`, `a.b[1].c`; None for anything else."""
    root = tree
    while isinstance(root, (ast.Attribute, ast.Subscript)):
        root = root.value
    return ast.unparse(tree).replace(" ", "") if isinstance(root, ast.Name) else None


_GRID_POINTS = 2001
"""Points of an axis that are compared to locate a value."""


@dataclass(frozen=True)
class GainAxis:
    """One gain; `factor` is None for a name that only expressions in `derive` use."""

    name: str
    distribution: Distribution
    factor: Factor | None = None

    def value(self, quantile: float) -> Value:
        """Return the gain at a quantile from 0 to 1, in its unit."""
        (drawn,) = self.distribution.at(np.array([quantile]))
        value = drawn if self.factor is None else self.factor.value(drawn)
        assert value is not None
        return value

    def find_quantile(self, value: float | None) -> float:
        """Return the quantile nearest to a value of the gain; the middle for None."""
        if value is None:
            return 0.5
        # on a grid: distributions return values of quantiles, not the inverse
        quantiles = np.linspace(0.0, 1.0, _GRID_POINTS)
        drawn = self.distribution.at(quantiles)
        if not all(isinstance(x, (int, float)) for x in drawn):
            return 0.5
        values = [drawn if self.factor is None else self.factor.value(x) for x in drawn]
        return float(quantiles[int(np.argmin(np.abs(np.array(values, dtype=float) - value)))])


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

    def start_point(self) -> list[float]:
        """Return the gains of the scenario as a point of the cube."""
        return [axis.find_quantile(self.start[axis.name]) for axis in self.axes]


def build_space(plan: TuningPlan, system: System, interfaces: Mapping[str, Interface]) -> Space:
    """Return the space of a plan in a system; raise CommandError for a wrong name or one that cannot vary."""
    free = [name for name in plan.vary if _is_auxiliary_name(name, plan.vary[name], system)]
    units = [interface.units for interface in interfaces.values()]
    ranges = {name: _read_range(value, units) for name, value in plan.vary.items() if name not in free}
    factors = resolve_factors(ranges, system, interfaces, plan.where)
    _require_start_values(factors, plan.where)
    axes = [GainAxis(f.name, f.distribution, f) for f in factors]
    axes += [
        GainAxis(name, parse_distribution(_read_range(plan.vary[name], units), f"'{name}' of {plan.where}"))
        for name in free
    ]
    derived = _derive_gains(plan, axes, system, interfaces)
    used = {name for _, expression in derived for name in expression.names}
    if idle := [name for name in free if name not in used]:
        raise CommandError(
            f"'{idle[0]}' of {plan.where} is neither a start value nor an option nor used in 'derive'; "
            "write component.variable, or use it in 'derive'.",
            name=idle[0],
        )
    start = {axis.name: _find_start(axis, system, interfaces) for axis in axes}
    return Space(axes, derived, start)


def check_during_a_run(factors: Sequence[Factor], where: str) -> None:
    """Raise CommandError for a factor that a prepared simulation cannot vary."""
    if wrong := [factor.name for factor in factors if any(map(needs_preparation, factor.targets))]:
        raise CommandError(
            f"'{wrong[0]}' of {where} cannot be varied while tuning: it changes the system structure.",
            name=wrong[0],
        )


def _require_start_values(factors: Sequence[Factor], where: str) -> None:
    """Raise CommandError for a gain that is not a start value, such as an option or an FMU."""
    if wrong := [target.name for factor in factors for target in factor.targets if target.kind != START]:
        raise CommandError(
            f"'{wrong[0]}' of {where} is not a start value; gains must be start values, "
            "written as COMPONENT.VARIABLE.",
            name=wrong[0],
        )


def _is_auxiliary_name(name: str, entry: Any, system: System) -> bool:
    """Return whether a name in `vary` is neither a target in the system nor an option."""
    is_component = any(c.name == name for c in system.components)
    has_targets = isinstance(entry, Mapping) and "of" in entry
    return "." not in name and name not in list_options() and not is_component and not has_targets


def _read_range(entry: Any, units: Sequence[FmuUnits]) -> Any:
    """Return the entry of a gain; a text LOW:HIGH of positive numbers becomes a logarithmic range."""
    if not isinstance(entry, str):
        return entry
    limits = parse_distribution(entry, "the range", lambda text: read_si_number(text, "the range", units))
    # gains of a loop act as factors, so that equal ratios are equal changes
    if isinstance(limits, Uniform) and limits.low > 0:
        ends = [text.strip() for text in entry.split(":")]
        if any(map(has_unit, ends[:2])) and not limits.relative:
            return {"distribution": LogUniform.name, "low": ends[0], "high": ends[1]}
        return LogUniform(limits.low, limits.high, limits.points, relative=limits.relative)
    return entry


def _derive_gains(
    plan: TuningPlan, axes: Sequence[GainAxis], system: System, interfaces: Mapping[str, Interface]
) -> list[tuple[Sequence[Factor], Expression]]:
    """Return factors and expressions of `derive`; raise CommandError for a value that is set twice."""
    names = [axis.name for axis in axes]
    targets_in_use = {t.name for axis in axes if axis.factor is not None for t in axis.factor.targets}
    derived = list[tuple[Sequence[Factor], Expression]]()
    for name, text in plan.derive.items():
        label = f"'{name}' of 'derive' in {plan.where}"
        expression = parse_expression(text, label)
        if unknown := sorted(expression.names - set(names)):
            raise CommandError(f"{label} uses '{unknown[0]}', which does not vary; use {join_names(names)}.")
        targets = resolve_factors({name: 0.0}, system, interfaces, plan.where)
        _require_start_values(targets, plan.where)
        if conflicts := targets_in_use & {t.name for f in targets for t in f.targets}:
            raise CommandError(
                f"{plan.where} sets {min(conflicts)} twice: in 'vary' and in 'derive'; remove one.",
                name=min(conflicts),
            )
        targets_in_use |= {t.name for f in targets for t in f.targets}
        derived.append((targets, expression))
    return derived


def _find_start(axis: GainAxis, system: System, interfaces: Mapping[str, Interface]) -> float | None:
    """Return the value of a gain in the scenario; None if it is not a single number."""
    if axis.factor is None:
        return None
    first, *further = axis.factor.targets
    if further and first.nominal is not None:
        return 1.0  # the multiplier that leaves all of them as they are
    return Names(system, interfaces).find(first.name).start_number
