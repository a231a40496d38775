"""The entries of an actuator's file, with units and conventions, and data sheets as files."""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from ...base.errors import CommandError
from ...base.quantities import parse_quantity, parse_unit_name
from ...base.table_entries import Location
from ...base.toml_structs import QUANTITY, describe, extend_struct
from ...base.values import as_float

ROOT_2, ROOT_3 = math.sqrt(2.0), math.sqrt(3.0)
TURN = 2.0 * math.pi


@dataclass(frozen=True)
class SheetEntry:
    """One entry of a table, converted to a number in the unit of the model.

    Attributes:
        unit: An SI unit; empty for a plain number.
        example: A value as data sheets print it.
        rms: Factor from the rms to the peak value; None if the quantity has no such choice.
        between: Factor from a line-to-line value to that of a phase; None if there is no such choice.
        about: Its meaning.
        positive: Whether zero is excluded; not used for a signed entry.
        signed: Whether it can be negative.
        is_integer: Whether it must be an integer.
        most: Largest number.
        per_turn: Whether the number is per turn, so that a unit such as mm/rev is allowed.
        needed: Whether its table must have it.
        kind: float for a number, bool for true or false.
        choices: Allowed texts; the number is the position of the text.
        is_difference: Whether a temperature is a difference, so that 180 °F are 100 K.
    """

    key: str
    unit: str
    example: str
    about: str
    rms: float | None = None
    between: float | None = None
    positive: bool = True
    signed: bool = False
    is_integer: bool = False
    most: float = math.inf
    per_turn: bool = False
    needed: bool = False
    kind: type = float
    choices: tuple[str, ...] = ()
    is_difference: bool = False


ENDS = ("fixed-free", "supported-supported", "fixed-supported", "fixed-fixed")
"""Bearings at the ends of a screw."""


def _make_current_entry(key: str, about: str) -> SheetEntry:
    return SheetEntry(key, "A", "12 A rms", about, rms=ROOT_2)


TABLES: dict[str, tuple[SheetEntry, ...]] = {
    "motor": (
        SheetEntry("N_p", "", "4", "pole pairs", is_integer=True),
        SheetEntry("poles", "", "8", "poles, instead of N_p", is_integer=True),
        SheetEntry("kT", "N.m/A", "1.66 N m/A rms", "torque constant", rms=1.0 / ROOT_2),
        SheetEntry("K_E", "V.s/rad", "107 V/krpm rms line to line", "voltage constant", ROOT_2, 1.0 / ROOT_3),
        SheetEntry("R", "Ohm", "2.3 Ohm line to line", "winding resistance", between=0.5, needed=True),
        SheetEntry("L", "H", "11.5 mH line to line", "inductance of both axes", between=0.5),
        SheetEntry("L_d", "H", "5 mH per phase", "inductance of the d-axis, with L_q", between=0.5),
        SheetEntry("L_q", "H", "7 mH per phase", "inductance of the q-axis, with L_d", between=0.5),
        SheetEntry("J_m", "kg.m2", "9.6 kg cm^2", "rotor inertia", needed=True),
        SheetEntry("B_m", "N.m.s/rad", "0.05 N m/krpm", "viscous friction of the rotor", positive=False),
        _make_current_entry("i_N", "continuous stall current"),
        _make_current_entry("i_max", "peak current"),
        SheetEntry("tau_N", "N.m", "8.4 N m", "continuous stall torque"),
        SheetEntry("tau_max", "N.m", "25 N m", "peak torque"),
        SheetEntry("tau_R", "N.m", "7.1 N m", "continuous torque at the speed n_R"),
        SheetEntry("n_R", "rad/s", "3000 rpm", "speed of the continuous torque tau_R"),
        SheetEntry("n_max", "rad/s", "3500 rpm", "largest speed", needed=True),
        SheetEntry("m", "kg", "45 kg", "mass, for machines that carry it"),
    ),
    "coupling": (SheetEntry("J_c", "kg.m2", "0.4 kg cm^2", "inertia of the coupling", positive=False),),
    "gearbox": (
        SheetEntry("ratio", "", "7.7", "motor turns per turn of the screw", needed=True),
        SheetEntry("efficiency", "", "95 %", "efficiency of the gearbox", most=1.0, needed=True),
        SheetEntry("J_GB", "kg.m2", "1.2 kg cm^2", "inertia at the motor", positive=False),
    ),
    "screw": (
        SheetEntry("lead", "m", "10 mm", "travel per turn", per_turn=True, needed=True),
        SheetEntry("efficiency", "", "0.85", "efficiency of the screw", most=1.0, needed=True),
        SheetEntry("M_BS", "kg", "60 kg", "mass that moves with the nut, load included", needed=True),
        SheetEntry("stroke", "m", "500 mm", "travel from end to end", needed=True),
        SheetEntry("q_LB", "m", "0 mm", "position of the lower end", signed=True),
        SheetEntry("J_BS", "kg.m2", "3 kg cm^2", "inertia of the screw that turns", positive=False),
        SheetEntry("B_BS", "N.s/m", "100 N s/m", "viscous friction", positive=False),
        SheetEntry("v_max", "m/s", "200 mm/s", "largest speed, if less than the motor's"),
        SheetEntry("F_max", "N", "30 kN", "largest axial force"),
        SheetEntry("C_a", "N", "67 kN", "dynamic load rating, for 1e6 turns"),
        SheetEntry("C_0a", "N", "120 kN", "static load rating"),
        SheetEntry("f_w", "", "1.2", "factor on the load for the life; default: 1"),
        SheetEntry("d_root", "m", "27 mm", "root diameter of the thread"),
        SheetEntry("L_free", "m", "800 mm", "longest unsupported length of the screw"),
        SheetEntry("ends", "", "fixed-supported", f"bearings of the screw: {', '.join(ENDS)}", choices=ENDS),
    ),
    "inverter": (
        SheetEntry("U_DC", "V", "560 V", "voltage of the DC link"),
        SheetEntry("U_supply", "V", "400 V rms line to line", "supply of the inverter", ROOT_2, 1.0 / ROOT_3),
        SheetEntry(
            "u_max",
            "V",
            "326 V peak",
            "length of the largest voltage vector: peak voltage of a phase",
            ROOT_2,
        ),
        _make_current_entry("i_max", "largest current"),
        SheetEntry("delay", "s", "0.1 ms", "time after which a voltage takes effect", positive=False),
        SheetEntry("dead_time", "s", "0.4 us", "dead time that is not compensated", positive=False),
        SheetEntry("f_PWM", "Hz", "8 kHz", "switching frequency"),
        _make_current_entry("i_N", "continuous current"),
        SheetEntry("C_DC", "A.s/V", "470 uF", "capacitance of the DC link, with U_brake"),
        SheetEntry("U_brake", "V", "780 V", "voltage of the DC link at which the brake resistor turns on"),
        SheetEntry("P_brake", "W", "150 W", "continuous power of the brake resistor"),
        _make_current_entry("i_0", "phase current below which dead time has less effect"),
    ),
    "sensor": (
        SheetEntry("bits", "", "20", "bits per motor turn", is_integer=True, most=64.0),
        SheetEntry("steps", "", "4096", "steps per motor turn", is_integer=True),
        SheetEntry("resolution", "m", "1 um", "step of a sensor at the screw"),
        SheetEntry("sigma", "m", "10 nm", "standard deviation of the position noise", positive=False),
        SheetEntry(
            "sigma_i",
            "A",
            "20 mA peak",
            "standard deviation of the noise of i_q and i_d",
            ROOT_2,
            positive=False,
        ),
        SheetEntry("resolution_i", "A", "10 mA peak", "current step", ROOT_2, positive=False),
    ),
    "friction": (
        SheetEntry("F_C", "N", "200 N", "Coulomb friction at the screw", positive=False, needed=True),
        SheetEntry("F_S", "N", "300 N", "breakaway friction; default: F_C", positive=False),
        SheetEntry("v_S", "m/s", "5 mm/s", "speed at which friction is halfway from F_S to F_C"),
        SheetEntry("v_0", "m/s", "0.05 mm/s", "speed below which friction acts like a damper"),
        SheetEntry(
            "directional", "", "true", "whether losses of gearbox and screw oppose the motion", kind=bool
        ),
        SheetEntry("eta_back", "", "0.7", "efficiency when the load drives", signed=True, most=1.0),
    ),
    "stop": (
        SheetEntry(
            "stiffness", "N/m2", "2e8 N/m^2", "force of an end stop per squared penetration", needed=True
        ),
        SheetEntry(
            "damping", "s/m", "5 s/m", "increase of this force with the speed of approach", positive=False
        ),
    ),
    "thermal": (
        SheetEntry("tau_th", "s", "20 min", "thermal time constant of the winding", needed=True),
        SheetEntry(
            "permitted_rise", "K", "100 K", "final temperature rise at i_N", needed=True, is_difference=True
        ),
        SheetEntry("T_max", "K", "130 °C", "largest temperature of the winding"),
    ),
    "compliance": (
        SheetEntry("bearing", "N/m", "1200 N/um", "axial stiffness of the screw's bearing"),
        SheetEntry("screw", "N/m", "600 N/um", "axial stiffness of the screw"),
        SheetEntry("nut", "N/m", "900 N/um", "axial stiffness of the nut"),
        SheetEntry("backlash", "m", "3 um", "play between motor and load", positive=False),
    ),
    "control": (
        SheetEntry("a_max", "m/s2", "1.2 m/s^2", "braking acceleration; default: by rule"),
        SheetEntry("k_1", "", "0.05", "position bandwidth times T_s; default: that of the joint", most=0.5),
        SheetEntry("k_2", "", "0.09", "speed bandwidth times T_s; default: that of the joint", most=0.5),
        SheetEntry("observer", "", "0.3", "observer poles times T_s; default: those of the joint", most=1.0),
    ),
}
"""Entries of every table."""

REQUIRED_TABLES = ("motor", "screw", "inverter", "sensor")
"""Required tables."""

ONE_OF: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("motor", ("N_p", "poles")),
    ("inverter", ("U_DC", "U_supply", "u_max")),
    ("sensor", ("bits", "steps", "resolution")),
)
"""Entries of which a table needs exactly one."""

ANY_OF: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("motor", ("kT", "K_E")),
    ("motor", ("i_max", "tau_max")),
)
"""Entries of which a table needs one or both."""


RMS, PEAK = "rms", "peak"
BETWEEN, PHASE = "line to line", "per phase"

_CONVENTIONS = (
    (RMS, re.compile(r"(?<=[AV])[ _]?rms\b|\brms\b", re.IGNORECASE)),
    (PEAK, re.compile(r"(?<=[AV])[ _]?(?:peak|pk)\b|\bpeak\b", re.IGNORECASE)),
    (
        BETWEEN,
        re.compile(r"\b(?:line|phase)[- ](?:to[- ])?(?:line|phase)\b|\bl-l\b|\bph-ph\b", re.IGNORECASE),
    ),
    (PHASE, re.compile(r"\b(?:per )?phase\b", re.IGNORECASE)),
)
"""Conventions beside a unit, in the order of search: "phase to phase" contains "phase"."""

_SPELLINGS = (
    (re.compile(r"\(\s*\)|,(?!\d)"), " "),
    (re.compile(r"\b(?:1 ?/ ?min|min\^?-1|min⁻¹|r ?/ ?min)(?![\w.])"), "rpm"),
    (re.compile(r"\b1000 ?(?:rpm|RPM)\b"), "krpm"),
)
"""Spellings in data sheets only: 1/min is a speed of turns."""


@dataclass(frozen=True)
class SheetValue:
    """An entry, and its number in the model: in SI units, peak values, those of a phase."""

    text: str
    number: float


def read_sheet_value(value: Any, entry: SheetEntry, label: str) -> SheetValue:
    """Read an entry of a file; raise CommandError, with `label`, if it is invalid or ambiguous."""
    if entry.choices:
        if value not in entry.choices:
            raise CommandError(f"{label} is {value!r}; it must be {' or '.join(entry.choices)}.")
        return SheetValue(str(value), float(entry.choices.index(value)))
    if entry.kind is bool:
        if not isinstance(value, bool):
            raise CommandError(f"{label} is {value!r}; it must be true or false.")
        return SheetValue(str(value).lower(), float(value))
    # true is an int in Python
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise CommandError(f'{label} is {value!r}; write it as "{entry.example}".')
    if isinstance(value, str):
        text, number = " ".join(value.split()), _read_number(value, entry, label)
    elif entry.unit:
        raise CommandError(f'{label} is {value!r} without a unit; add one, as in "{entry.example}".')
    else:
        number = as_float(value)
        text = f"{number:.9g}"
    _check_range(number, entry, f"{label} is {text}")
    return SheetValue(text, number)


def _read_number(text: str, entry: SheetEntry, label: str) -> float:
    """Return the number of a text in the unit of the model: a peak value of a phase."""
    remainder, factor = _remove_conventions(text, entry, label)
    for pattern, spelling in _SPELLINGS:
        remainder = pattern.sub(spelling, remainder)
    unit = replace(parse_unit_name(entry.unit or "1", label), is_difference=entry.is_difference)
    quantity = parse_quantity(remainder, label, unit)
    number = quantity.in_unit(unit, label) * factor
    if not entry.unit:
        return number
    if quantity.unit is None:
        raise CommandError(f"{label} is '{text}' without a unit; add one, as in \"{entry.example}\".")
    # a turn and a radian have the same dimension, so that units alone do not tell
    powers, expected = quantity.unit.powers.get("rad", 0), unit.powers.get("rad", 0)
    if powers == expected:
        return number
    if entry.per_turn and powers == -1:
        return number * TURN
    raise CommandError(
        f"{label} is '{text}'; state whether it is in turns or radians: write it as \"{entry.example}\"."
    )


def _remove_conventions(text: str, entry: SheetEntry, label: str) -> tuple[str, float]:
    """Return the text without its conventions, such as rms, and the factor that follows from them."""
    conventions = set[str]()
    for convention, pattern in _CONVENTIONS:
        text, count = pattern.subn(" ", text)
        if count:
            conventions.add(convention)
    factor = 1.0
    for choice, (first, second) in ((entry.rms, (RMS, PEAK)), (entry.between, (BETWEEN, PHASE))):
        stated = conventions & {first, second}
        if choice is None and stated:
            raise CommandError(f'{label} must not be {sorted(stated)[0]}; write it as "{entry.example}".')
        if choice is not None and len(stated) != 1:
            raise CommandError(f'{label} is ambiguous, {first} or {second}; write it as "{entry.example}".')
        if choice is not None and first in stated:
            factor *= choice
    return text, factor


def _check_range(number: float, entry: SheetEntry, fault: str) -> None:
    """Raise CommandError if a number is out of range; its message begins with `fault`, such as "R is 0"."""
    if not math.isfinite(number):
        raise CommandError(f"{fault}; it must be a finite number.")
    if entry.positive and not entry.signed and number <= 0.0:
        raise CommandError(f"{fault}; it must be more than 0.")
    if not entry.signed and number < 0.0:
        raise CommandError(f"{fault}; it must not be less than 0.")
    if number > entry.most:
        raise CommandError(f"{fault}; it must be at most {entry.most:g}.")
    if entry.is_integer and number != round(number):
        raise CommandError(f"{fault}; it must be a whole number.")


def _build_field(table: str, entry: SheetEntry) -> Any:
    """Return an entry as a field of a struct."""

    def read(value: Any, _at: Location, _folder: Path | None) -> SheetValue:
        return read_sheet_value(value, entry, f"{table}.{entry.key}")

    schema: dict[str, Any] = {} if entry.choices or entry.kind is bool else {"pattern": QUANTITY}
    if entry.most < math.inf and not entry.unit:
        schema["maximum"] = entry.most
    type_: Any = Literal[entry.choices] if entry.choices else str if entry.unit else entry.kind
    meta = describe(entry.about, entry.example, read, extra_json_schema=schema)
    return (entry.key, Annotated[type_, meta], *([] if entry.needed else [msgspec.UNSET]))


class SheetTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An actuator as its data sheets describe it; docs/actuator.md has the entries."""

    name: str = ""
    source: str = ""


def _build_table(name: str, entries: tuple[SheetEntry, ...]) -> Any:
    struct = extend_struct(msgspec.Struct, name, [_build_field(name, entry) for entry in entries])
    return (name, struct, *([] if name in REQUIRED_TABLES else [msgspec.UNSET]))


ACTUATOR = extend_struct(
    SheetTable, "Actuator", [_build_table(name, entries) for name, entries in TABLES.items()]
)
"""The struct of an actuator's file; entries become `SheetValue`."""
