"""Options of the system that runs: its components, values and data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..base.option import (
    BUILDING,
    COMPARE,
    EXPORT,
    INFO,
    LINEARIZE,
    LOADING,
    PREPARING,
    RUN,
    SAME,
    SIZE,
    SWEEP,
    SYSTEM,
    FileOrObject,
    option,
)
from ..fmu.models import FLAVOURS, FMI_VERSIONS, PLATFORMS
from ..inputs.input import Input
from ..system.fault import Fault, read_faults
from ..system.model import Replacement, Value

MODES = ("coupled", "replayed", "merged")
"""How a machine and its joints are connected."""

LOAD_CONTROLS = ("none", "motor", "sensor")
"""Sensors by which the position of a load can be controlled."""

ALL = (RUN, EXPORT, SWEEP, COMPARE, INFO, LINEARIZE, SIZE)
"""Commands that load a system."""


def read_kinds(texts: Sequence[str]) -> dict[str, str]:
    """Read as what FMUs run, such as `me` or `plant=me`; a text without a component is for all."""
    return {pattern or "*": kind for pattern, _, kind in (text.rpartition("=") for text in texts)}


_system = partial(option, group=SYSTEM, commands=ALL)
_prepared = partial(_system, stage=PREPARING)
_fixed = partial(_prepared, in_sweep=SAME)
_loading_option = partial(_system, stage=LOADING, in_sweep=SAME)
_exported = partial(option, group=SYSTEM, commands=(EXPORT,), in_file=False, recorded=False, stage=BUILDING)


@dataclass(frozen=True)
class SystemOptions:
    """Options of the system that runs."""

    set: Mapping[str, Value] = _system(
        {},
        help="Set a start value or parameter, optionally with a unit, such as "
        "'lift.disturbance.load.level[*]=30 kN'. In the name, * matches any text (repeatable).",
        metavar="COMPONENT.VARIABLE=VALUE",
        arrays=True,
        in_sweep=SAME,
    )
    replace: Mapping[str, Replacement] = _prepared(
        {},
        help="Replace a component with your FMU, such as lift.controller=mine.fmu (repeatable).",
        metavar="COMPONENT=FILE.fmu",
    )
    input: Sequence[Input] = _prepared(
        [],
        help="Drive signals with data from CSV or Parquet (repeatable).",
        metavar="FILE[:SIGNAL=COLUMN,...,end=repeat]",
    )
    controller: str | type | None = _prepared(
        takes=type,
        help="Controller of all joints: a name from `emla list`, your FMU, or your block as FILE.py:BLOCK.",
        commands=(RUN, EXPORT, SWEEP, INFO, LINEARIZE, SIZE),
        makes="gains",
    )
    gains: str | None = _prepared(
        help="Gain set of controller and observer; `emla list` lists them. Default: that of the scenario; "
        "with --controller, the recommended one.",
        commands=(RUN, EXPORT, SWEEP, INFO, LINEARIZE, SIZE),
        makes="gains",
    )
    mode: str | None = _prepared(
        help="How a machine and its joints are connected: coupled, both exchange motion and force; replayed, "
        "the joints move against the forces of the reference motion; merged, mechanics in one FMU. Default: "
        "coupled.",
        choices=lambda: MODES,
        makes="machine",
    )
    load_control: str | None = _prepared(
        help="How the position of a load that is not rigid is controlled: not at all, with sensors at the "
        "motor, or also with one at the load; see docs/load-control.md. Default: motor for such loads.",
        choices=lambda: LOAD_CONTROLS,
        makes="load control",
    )
    supply: bool = _prepared(
        False,
        help="Let the joints share one supply, through which energy that a joint returns feeds the others; "
        "see docs/systems.md.",
        makes="supply",
    )
    notch: Mapping[str, float | str] = _prepared(
        {},
        help="Remove up to two frequencies from a joint's reference motion, so that it does not excite what "
        "swings with them, such as lift='6.5 Hz' (repeatable; * is all joints).",
        metavar="JOINT=FREQUENCY[,FREQUENCY]",
        makes="reference",
    )
    actuator: Mapping[str, Path | FileOrObject] = _prepared(
        {},
        help="Replace a joint's actuator with one from a data sheet; see docs/actuator.md (repeatable).",
        metavar="JOINT=FILE.toml",
        takes=FileOrObject,
        makes="actuators",
    )
    sheet: Mapping[str, Value] = _prepared(
        {},
        help="Change an entry of an actuator's data sheet, such as 'prototype.screw.lead=5 mm'. Everything "
        "that follows from the entry changes, too (repeatable).",
        metavar="JOINT.TABLE.ENTRY=VALUE",
        makes="actuators",
    )
    fault: Sequence[Fault] = _fixed(
        [],
        help="Inject a fault into a signal: freeze, offset, gain or constant, from START, for DURATION, "
        "both in s. Separate several with commas.",
        metavar="SIGNAL=KIND[:VALUE]@START[+DURATION]",
        parse=read_faults,
    )
    trajectory: Path | None = _prepared(
        help="Motion of the machine: a file written by `emla trajectory`.",
        metavar="FILE.json",
        makes="reference",
    )
    parameters: Sequence[Path] = _prepared(
        [],
        help="Read start values from an SSP parameter file (.ssv) or a table (CSV, Parquet); see "
        "docs/inputs.md. --set overrides them (repeatable).",
        metavar="FILE",
    )
    mapping: Mapping[str, Path] = _fixed(
        {},
        help="SSP parameter mapping with the names that the FMU of --replace uses for its variables "
        "(repeatable).",
        metavar="COMPONENT=FILE.ssm",
    )
    follow_models: bool = _system(
        False,
        help="Adapt the model parameters of controllers and observers to the plant as changed by --set "
        "and --vary. Gains do not change.",
    )
    kind: Mapping[str, str] = _fixed(
        {},
        help="Run FMUs as co-simulation (cs) or Model Exchange (me), all or those of COMPONENT; see "
        "docs/model-exchange.md (repeatable). Default: cs where the FMU has it.",
        metavar="[COMPONENT=]cs|me",
        identity="kind",
        parse=read_kinds,
    )
    no_event_mode: Sequence[str] = _fixed(
        [],
        help="Run a co-simulation FMU of FMI 3.0 without event mode and early return, although it has event "
        "mode (repeatable; * matches any text). Without a name: all components.",
        metavar="[COMPONENT]",
        flag_value="*",
    )
    integrate_together: bool = _loading_option(
        True,
        help="Integrate FMUs that run as Model Exchange and are connected with each other together, with one "
        "integrator; see docs/model-exchange.md.",
        flag="--together",
        commands=(RUN, SWEEP, COMPARE, INFO, LINEARIZE),
        identity="integrators",
    )
    isolate: Sequence[str] = _loading_option(
        [],
        help="Run a component in a separate process, so that a crash ends only that process (repeatable; "
        "* matches any text). Without a name: all components.",
        metavar="[COMPONENT]",
        commands=(RUN, SWEEP, COMPARE),
        flag_value="*",
    )
    lenient: bool = _loading_option(
        False,
        help="Accept FMUs and packages that violate their standard where other tools accept them. The "
        "violations are listed.",
    )
    flavour: str = _system(
        "native",
        help="Implementation of the built-in FMUs: compiled (native), or Python (python).",
        choices=lambda: FLAVOURS,
        stage=BUILDING,
    )
    fmus: Path | None = _system(
        help="Folder of the built-in FMUs; missing ones are built there. Default: fmus/ if it has them, "
        "otherwise your cache.",
        in_file=False,
        recorded=False,
        stage=BUILDING,
    )
    platform: Sequence[str] = _exported(
        [],
        help="Platform to compile the built-in FMUs for (repeatable). Default: this machine's.",
        choices=lambda: PLATFORMS,
    )
    fmi: int = _exported(2, help="Version of FMI of an exported FMU.", choices=lambda: FMI_VERSIONS)
    inputs: Sequence[str] = _exported(
        [],
        help="Input of an exported FMU, among those that nothing drives (repeatable; * matches any text). "
        "Default: all of these.",
        metavar="COMPONENT.VARIABLE",
    )
    outputs: Sequence[str] = _exported(
        [],
        help="Output of an exported FMU or C file (repeatable; * matches any text). Default: position and "
        "reference of each joint; without joints, all outputs; in C, those that drive other components.",
        metavar="COMPONENT.VARIABLE",
    )
    components: Sequence[str] = _exported(
        [],
        help="Component of an exported C file, such as controller or lift.controller (repeatable; * matches "
        "any text).",
        metavar="COMPONENT",
    )
    precision: str = _exported(
        "double", help="Type of the numbers in an exported C file.", choices=lambda: ("double", "float")
    )
