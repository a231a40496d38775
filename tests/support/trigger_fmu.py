"""Builds the FMU of `triggers/`: it has output clocks and triggered input clocks."""

from pathlib import Path

import fmpy

from .handwritten_fmu import build_handwritten_fmu

SOURCE = Path(__file__).parent / "triggers" / "triggers.c"

_SUB = """<Clock name="beat" valueReference="31" causality="input" intervalVariability="constant"
      intervalDecimal="0.1"/>
    <Clock name="sub" valueReference="32" causality="input" clocks="31" intervalVariability="constant"
      intervalDecimal="{}"/>
    <Int32 name="beats" valueReference="33" causality="output" variability="discrete"/>
    <Int32 name="subs" valueReference="34" causality="output" variability="discrete"/>"""


def build_trigger_fmu(path: Path, sub: float | None = None) -> Path:
    """Build the FMU.

    Args:
        path: The FMU file.
        sub: Interval in s of a clock that depends on a periodic one; without both by default.
    """
    placeholders = {"clocks": "" if sub is None else _SUB.format(sub)}
    placeholders["structure"] = (
        "" if sub is None else '<Output valueReference="33"/><Output valueReference="34"/>'
    )
    macros = {"SUB": int(sub is not None)}
    return build_handwritten_fmu(path, SOURCE, placeholders, macros, platform=fmpy.platform_tuple)
