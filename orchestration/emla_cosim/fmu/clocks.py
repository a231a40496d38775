"""Clocks of FMI 3.0 FMUs: which ones tick at times, and which ones are triggered."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmpy.model_description import ModelDescription, ModelVariable

from ..base.errors import CommandError
from ..base.untrusted_xml import parse_xml

PERIODIC, COUNTDOWN = ("constant", "fixed", "tunable"), "countdown"
"""Kinds of clocks: periodic ones, and the one whose next tick an event can set at any time."""

TRIGGERED = "triggered"
"""The kind of clocks that tick when another clock ticks: output clocks, and the input clocks they drive."""

_ALL_VARIABILITIES = (*PERIODIC, "changing", COUNTDOWN, TRIGGERED)

CLOCK = "Clock"
"""The type of these variables. In tables, their value is the number of their ticks since the start."""


@dataclass(frozen=True)
class InputClock:
    """An input clock that ticks at times.

    Attributes:
        name: The name of the variable.
        reference: Its value reference.
        kind: Its `intervalVariability`.
        interval: The interval of a periodic clock in s; None if the FMU tells it in initialization mode.
        shift: The time from the start to the first tick of a periodic clock in s.
    """

    name: str
    reference: int
    kind: str
    interval: float | None
    shift: float


def explain_unsupported_clock(description: ModelDescription) -> str | None:
    """Return why this master cannot tick the clocks of an FMU, as the end of a message; None if it can."""
    # output clocks tick in the FMU, whatever their kind
    inputs = [v for v in description.modelVariables if v.type == CLOCK and v.causality == "input"]
    for clock in inputs:
        if clock.intervalVariability is None:
            return (
                f"has the clock '{clock.name}' without intervalVariability, which must be one of "
                f"{', '.join(_ALL_VARIABILITIES)}"
            )
        if clock.intervalVariability not in _ALL_VARIABILITIES:
            return (
                f"has the clock '{clock.name}' with intervalVariability = '{clock.intervalVariability}', "
                f"which is not one of {', '.join(_ALL_VARIABILITIES)}"
            )
    if inputs and description.coSimulation is not None and not description.coSimulation.hasEventMode:
        return f"has the clock '{inputs[0].name}' but no event mode in co-simulation"
    return None


def is_triggered_input(variable: ModelVariable) -> bool:
    """Return whether a variable is an input clock that ticks when the clock that drives it ticks."""
    is_input = variable.type == CLOCK and variable.causality == "input"
    return is_input and variable.intervalVariability == TRIGGERED


def clocks_of(variable: ModelVariable) -> list[int]:
    """Return the value references of the clocks of a variable; fmpy replaces them by variables."""
    return [int(getattr(clock, "valueReference", clock)) for clock in variable.clocks or ()]


def is_clocked(variable: ModelVariable) -> bool:
    """Return whether a variable belongs to clocks."""
    return bool(variable.clocks)


def belongs(variable: ModelVariable, clocks: Collection[int]) -> bool:
    """Return whether a variable belongs to one of these clocks, by value reference."""
    return any(clock in clocks for clock in clocks_of(variable))


def read_input_clocks(folder: Path, path: Path) -> list[InputClock]:
    """Return the input clocks of an FMU that tick at times; fmpy (0.3.32) does not read their intervals.

    Args:
        folder: The folder with the unpacked FMU.
        path: The FMU, for messages.

    Raises:
        CommandError: A number cannot be read.
    """
    root = parse_xml((folder / "modelDescription.xml").read_bytes())
    return [
        InputClock(
            name=str(clock.get("name")),
            reference=int(clock.get("valueReference")),
            kind=str(clock.get("intervalVariability")),
            interval=_read_seconds(path, clock, "intervalDecimal"),
            shift=_read_seconds(path, clock, "shiftDecimal") or 0.0,
        )
        for clock in root.iterfind("ModelVariables/Clock[@causality='input']")
        if clock.get("intervalVariability") != TRIGGERED
    ]


def _read_seconds(path: Path, clock: Any, attribute: str) -> float | None:
    """Return a number of a clock's element; None if it is missing."""
    text = clock.get(attribute)
    try:
        return None if text is None else float(text)
    except ValueError as error:
        raise CommandError(
            f"'{path}' is not a valid FMU: {attribute} of its clock '{clock.get('name')}' is '{text}', "
            "not a number."
        ) from error
