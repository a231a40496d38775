"""Input clocks of FMI 3.0 FMUs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmpy.model_description import ModelDescription

from ..base.errors import CommandError
from ..base.untrusted_xml import parse_xml

PERIODIC, COUNTDOWN = ("constant", "fixed", "tunable"), "countdown"
"""Kinds of clocks: periodic ones, and the one whose next tick an event can set at any time."""

_BY_TIME = (*PERIODIC, "changing", COUNTDOWN)


@dataclass(frozen=True)
class InputClock:
    """A clock that this master ticks.

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
    inputs = [v for v in description.modelVariables if v.type == "Clock" and v.causality == "input"]
    for clock in inputs:
        own = f"its input '{clock.name}' is one"
        if clock.intervalVariability not in _BY_TIME:
            return f"needs clocks that are triggered from outside, which are not supported: {own}"
        if clock.clocks:
            return f"needs clocks that depend on other clocks, which are not supported: {own}"
    if inputs and description.coSimulation is not None and not description.coSimulation.hasEventMode:
        return f"has the clock '{inputs[0].name}' but no event mode in co-simulation"
    return None


def read_input_clocks(folder: Path, path: Path) -> list[InputClock]:
    """Return the input clocks of an FMU; fmpy (0.3.32) does not read their intervals.

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
    ]


def _read_seconds(path: Path, clock: Any, attribute: str) -> float | None:
    """Return a number of a clock's element; None if it is missing."""
    text = clock.get(attribute)
    try:
        return None if text is None else float(text)
    except ValueError as error:
        raise CommandError(
            f"'{path}' is not a valid FMU: {attribute} of its clock '{clock.get('name')}' is '{text}', "
            "which is no number."
        ) from error
