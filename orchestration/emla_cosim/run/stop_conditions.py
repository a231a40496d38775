"""Conditions on signals that end a run, such as `lift.plant.x_L > 0.3`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.patterns import find_name, suggest_full_names
from ..base.quantities import has_unit, read_quantity
from ..base.units import LinearTransformation, SiUnit
from ..recorders.row_buffer import RowBuffer
from .requirements import Requirement, parse_requirement, split_condition


def parse_stop_condition(text: str) -> tuple[Requirement, str]:
    """Parse a condition on a signal; it has the form of a requirement.

    Returns:
        The condition, and its value as a text if that has a unit.

    Raises:
        CommandError: It is anything else.
    """
    signal, sign, right = split_condition(text)
    quantity = right if has_unit(right) else ""
    try:
        found = parse_requirement(f"{signal} {sign} 0" if quantity else text)
    except CommandError as error:
        raise CommandError(
            f"the condition '{text}' of stop_when is invalid. Write SIGNAL, a comparison such as > or <=, "
            "and a number, such as 'lift.plant.x_L > 0.3' or 'lift.plant.x_L > 300 mm'.",
            condition=text,
        ) from error
    return found, quantity


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
    shown: LinearTransformation

    def is_met(self, row: Vector) -> bool:
        """Return whether a row meets the condition; NaN does not."""
        value = self.shown(float(row[self.column]))
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
    for condition, quantity in map(parse_stop_condition, texts):
        signal = condition.figure
        if (name := find_name(signal, units, main)) is None:
            meant = suggest_full_names(signal, units, main)
            raise CommandError(f"there is no signal '{signal}' to stop at; {meant}", name=signal)
        value = condition.value
        if quantity:
            value = read_quantity(quantity, f"the condition on {name}", units[name])
        conditions.append(replace(condition, figure=name, value=value))
    return conditions


def describe_stop(condition: Requirement | str, time: float) -> str:
    """Return a message on the condition that ended a run at a time in s."""
    return f"the run ended at t = {time:.6g} s, because {condition} (--stop-when)."


class StoppingRows:
    """Takes rows for a buffer, up to the first one that meets a condition.

    Attributes:
        every: Every `every`-th communication point has a row.
        met: What ended the run: the condition and the time in s; None before.
    """

    def __init__(self, buffer: RowBuffer, conditions: Sequence[StopCondition]) -> None:
        self._buffer, self._conditions = buffer, conditions
        self.every = buffer.every
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
