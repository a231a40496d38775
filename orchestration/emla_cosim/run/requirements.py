"""Conditions: requirements on the metrics of a run, and those on signals that end it.

Examples are `lift.position_error_m < 2e-5` and `lift.plant.x_L > 0.3`.
"""

import math
import operator
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..base.arrays import Vector
from ..base.errors import CommandError, join_names
from ..base.quantities import has_unit, read_quantity
from ..base.units import LinearTransformation, SiUnit
from ..base.wording import find_name, require_name
from ..recorders.metrics import Figure
from ..recorders.row_buffer import RowBuffer

_COMPARISONS = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
# the longer signs come first, because < would match the beginning of <=
_SIGN = re.compile(f"({'|'.join(_COMPARISONS)})")
_WORDS = {"true": True, "false": False}


@dataclass(frozen=True)
class Requirement:
    """A condition on a metric, named joint.metric or run.metric."""

    figure: str
    sign: str
    value: float | bool

    def __str__(self) -> str:
        value = str(self.value).lower() if isinstance(self.value, bool) else f"{self.value:.9g}"
        return f"{self.figure} {self.sign} {value}"

    def met_by(self, figure: Any) -> bool:
        """Return whether a value meets the condition. Missing, NaN and values of other types do not."""
        if isinstance(figure, bool) != isinstance(self.value, bool):  # Python takes True for 1
            return False
        if not isinstance(figure, (bool, int, float)):
            return False
        return not math.isnan(figure) and bool(_COMPARISONS[self.sign](figure, self.value))


def split_condition(text: str) -> tuple[str, str, str]:
    """Return the parts of a condition: signal or metric, comparison and value.

    A text without a comparison has empty second and third parts. All are empty if it has several comparisons.
    """
    figure, sign, value, *more = [part.strip() for part in _SIGN.split(text)] + ["", ""]
    return ("", "", "") if any(more) else (figure, sign, value)


def parse_requirement(text: str) -> Requirement:
    """Parse a requirement. Raise CommandError for any other text."""
    figure, sign, right = split_condition(text)
    value = _parse_value(right)
    if not figure or value is None:
        raise CommandError(
            f"the requirement '{text}' is invalid. Write METRIC, one of {join_names(_COMPARISONS)}, and a "
            "number, true or false, such as 'lift.position_error_m < 2e-5'.",
            requirement=text,
        )
    if isinstance(value, bool) and sign not in ("==", "!="):
        raise CommandError(
            f"the requirement '{text}' compares with {sign}; use == or != with true and false.",
            requirement=text,
        )
    return Requirement(figure, sign, value)


def resolve_requirements(
    requirements: Sequence[Requirement], figures: Mapping[str, Figure], is_complete: bool, main: str = ""
) -> list[Requirement]:
    """Return the requirements with the full names of their metrics.

    Args:
        requirements: The requirements as users write them.
        figures: The metrics before the first row, by name.
        is_complete: Whether these are all metrics. If not, all names are accepted.
        main: The component whose variables need no component's name; empty without one.

    Raises:
        CommandError: If there is no such metric, or its type does not fit the condition.
    """
    resolved = []
    for required in requirements:
        if is_complete or find_name(required.figure, figures, main) is not None:
            name = require_name(required.figure, figures, main, "metric", "require")
            if (is_boolean := figures[name].is_boolean) != isinstance(required.value, bool):
                right = "true or false" if is_boolean else "a number"
                raise CommandError(
                    f"the requirement '{required}' has the wrong type: {name} is {right}.", name=name
                )
            required = replace(required, figure=name)
        resolved.append(required)
    return resolved


def describe_unmet(requirements: Sequence[Requirement], figures: Mapping[str, Figure]) -> str | None:
    """Return a message on the requirements that are not met by figures, or None if all are met."""
    pairs = [(r, figures[r.figure].value if r.figure in figures else None) for r in requirements]
    failing = [f"{r}, but {_format_value(value, r)}" for r, value in pairs if not r.met_by(value)]
    return f"requirements not met: {'; '.join(failing)}." if failing else None


def _parse_value(text: str) -> float | bool | None:
    """Parse a finite number, true or false. Return None for any other text."""
    if text in _WORDS:
        return _WORDS[text]
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _format_value(figure: Any, required: Requirement) -> str:
    if figure is None or figure != figure:
        return "it is missing"
    if isinstance(figure, bool):
        return f"it is {str(figure).lower()}"
    # a rounded figure could look as if it met the requirement
    rounded = f"{figure:.6g}"
    return f"it is {repr(figure) if rounded == f'{required.value:.6g}' else rounded}"


def check_no_condition(conditions: Sequence[str], command: str) -> None:
    """Raise CommandError if a scenario ends on a condition, for a command that needs the whole run."""
    if conditions:
        raise CommandError(
            f"the scenario ends on a condition, stop_when = {list(conditions)}, but emla {command} needs the "
            "whole run; remove stop_when, or set a stop_time.",
            condition=conditions[0],
        )


@dataclass(frozen=True)
class StopCondition:
    """A condition, the position of its signal in rows, and the transformation to the unit of results."""

    condition: Requirement
    column: int
    transformation: LinearTransformation

    def is_met(self, row: Vector) -> bool:
        """Return whether a row meets the condition; NaN does not."""
        value = self.transformation(float(row[self.column]))
        if isinstance(self.condition.value, bool):
            return not math.isnan(value) and self.condition.met_by(value != 0.0)
        return self.condition.met_by(value)


def resolve_stop_conditions(
    texts: Sequence[str], units: Mapping[str, SiUnit | None], main: str = ""
) -> list[Requirement]:
    """Return the conditions of a run, with the full names of their signals and values in their units.

    Args:
        texts: The conditions as users write them.
        units: The units of all variables that can be recorded, by name.
        main: The component whose variables need no component's name; empty without one.

    Raises:
        CommandError: If a condition is invalid, or its signal does not exist.
    """
    conditions = []
    for text in texts:
        signal, sign, right = split_condition(text)
        is_quantity = has_unit(right)
        try:
            # the unit of a quantity is known once the signal is: 0 takes its place until then
            condition = parse_requirement(f"{signal} {sign} 0" if is_quantity else text)
        except CommandError as error:
            raise CommandError(
                f"the condition '{text}' of stop_when is invalid. Write SIGNAL, a comparison such as > or "
                "<=, and a number, such as 'lift.plant.x_L > 0.3' or 'lift.plant.x_L > 300 mm'.",
                condition=text,
            ) from error
        name = require_name(condition.figure, units, main, "signal", "stop at")
        value = condition.value
        if is_quantity:
            value = read_quantity(right, f"the condition on {name}", units[name])
        conditions.append(replace(condition, figure=name, value=value))
    return conditions


def describe_stop(condition: Requirement | str, time: float) -> str:
    """Return a message on the condition that ended a run at a time in s."""
    return f"the run ended at t = {time:.6g} s, because {condition} (--stop-when)."


class StoppingRows:
    """Takes rows for a buffer, up to the first one that meets a condition.

    Attributes:
        steps_per_row: Every n-th communication point has a row.
        met: What ended the run: the condition and the time in s; None before.
    """

    def __init__(self, buffer: RowBuffer, conditions: Sequence[StopCondition]) -> None:
        self._buffer, self._conditions = buffer, conditions
        self.steps_per_row = buffer.steps_per_row
        self._room: Vector | None = None
        self.met: tuple[Requirement, float] | None = None

    def room(self, most: int) -> Vector:
        """Return free rows to fill; see `RowBuffer.room`."""
        self._room = self._buffer.room(most)
        return self._room

    def commit(self, count: int) -> None:
        """Take filled rows, and check the conditions in each of them."""
        for row in () if self._room is None else self._room[:count]:
            if self.met is None:
                met = next((c.condition for c in self._conditions if c.is_met(row)), None)
                self.met = None if met is None else (met, float(row[0]))
        self._buffer.commit(count)
