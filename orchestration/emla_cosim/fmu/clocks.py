"""Input clocks of FMI 3.0 FMUs."""

from dataclasses import dataclass
from pathlib import Path

from fmpy.model_description import ModelDescription

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


def read_input_clocks(folder: Path) -> list[InputClock]:
    """Return the input clocks of an unpacked FMU; fmpy (0.3.32) does not read their intervals.

    Raises:
        ValueError: If a number cannot be read.
    """
    from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # slow to import

    root = etree.parse(str(folder / "modelDescription.xml"), etree.XMLParser(resolve_entities=False))
    found = []
    for clock in root.iterfind("ModelVariables/Clock[@causality='input']"):
        interval = clock.get("intervalDecimal")
        found.append(
            InputClock(
                name=str(clock.get("name")),
                reference=int(clock.get("valueReference")),
                kind=str(clock.get("intervalVariability")),
                interval=None if interval is None else float(interval),
                shift=float(clock.get("shiftDecimal", "0")),
            )
        )
    return found
