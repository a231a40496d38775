"""Builds the FMU of `events/`: it has events and a clock, and refuses calls at the wrong time."""

from pathlib import Path

import fmpy

from .handwritten_fmu import build_handwritten_fmu

SOURCE = Path(__file__).parent / "events" / "events.c"
CLOCKS = {
    "periodic": (1, 'intervalVariability="constant" intervalDecimal="0.1" shiftDecimal="0.25"'),
    "asked": (2, 'intervalVariability="fixed"'),
    "changing": (3, 'intervalVariability="changing"'),
    "countdown": (4, 'intervalVariability="countdown"'),
    "triggered": (0, 'intervalVariability="triggered"'),
}
"""The clocks, each with its number in the C file and its attributes."""

_CLOCK = """<Clock name="tick" valueReference="20" causality="input" {}/>
    <Float64 name="w" valueReference="21" causality="input" variability="discrete" start="0" clocks="20"/>
    <Float64 name="sum" valueReference="22" causality="output" variability="discrete" clocks="20"/>"""


def build_event_fmu(
    path: Path, events: bool = True, early: bool = True, varies: bool = True, clock: str | None = None
) -> Path:
    """Build the FMU.

    Args:
        path: The FMU file.
        events: Whether it has event mode.
        early: Whether its steps may end early.
        varies: Whether it can do steps of any size.
        clock: The kind of its clock, one of `CLOCKS`; without a clock by default.
    """
    number, attributes = CLOCKS[clock] if clock else (0, "")
    flags = {"events": events, "early": early, "varies": varies}
    placeholders = {name: str(value).lower() for name, value in flags.items()}
    placeholders["clocks"] = _CLOCK.format(attributes) if clock else ""
    placeholders["structure"] = '<Output valueReference="22" dependencies="20 21"/>' if clock else ""
    macros = {"CLOCK": number, "VARIES": int(varies)}
    return build_handwritten_fmu(path, SOURCE, placeholders, macros, platform=fmpy.platform_tuple)
