"""Terminal output of a sizing."""

from rich.box import SIMPLE
from rich.markup import escape
from rich.table import Table

from ...study.actuator.entries import ROOT_2, TURN
from .limits import format_percent, format_value
from .result import Candidate, JointSizing, SizeResult

_RMS, _RPM = 1.0 / ROOT_2, 60.0 / TURN
_FIGURES = (
    ("cycle", "cycle_s", 1.0, "s"),
    ("torque, peak", "torque_peak_N_m", 1.0, "N m"),
    ("torque that the motion requires, peak", "required_torque_peak_N_m", 1.0, "N m"),
    ("torque, rms", "torque_rms_N_m", 1.0, "N m"),
    ("current, peak", "current_peak_A", _RMS, "A rms"),
    ("current, rms over the cycle", "current_rms_A", _RMS, "A rms"),
    ("axial force, peak", "force_peak_N", 1e-3, "kN"),
    ("axial force, rms", "force_rms_N", 1e-3, "kN"),
    ("axial force, cubic mean over the travel", "force_mean_N", 1e-3, "kN"),
    ("speed, peak", "speed_peak_m_s", 1e3, "mm/s"),
    ("speed, mean", "speed_mean_m_s", 1e3, "mm/s"),
    ("motor speed, peak", "motor_speed_peak_rad_s", _RPM, "rpm"),
    ("mechanical power of the motor, peak", "mechanical_power_peak_W", 1.0, "W"),
    ("electrical power, peak", "electrical_power_peak_W", 1.0, "W"),
    ("electrical power, mean", "electrical_power_mean_W", 1.0, "W"),
    ("regenerated power, peak", "regenerated_power_peak_W", 1.0, "W"),
    ("energy into the motor, per cycle", "energy_in_J", 1.0, "J"),
    ("energy regenerated, per cycle", "energy_regenerated_J", 1.0, "J"),
    ("energy into the load, per cycle", "energy_load_J", 1.0, "J"),
    ("loss in the motor, per cycle", "energy_motor_loss_J", 1.0, "J"),
    ("energy of the brake resistor, per cycle", "energy_brake_J", 1.0, "J"),
    ("brake resistor, peak", "brake_power_peak_W", 1.0, "W"),
    ("brake resistor, mean", "brake_power_mean_W", 1.0, "W"),
    ("winding temperature rise, peak when warm", "temperature_rise_peak_K", 1.0, "K"),
    ("winding temperature rise, mean when warm", "temperature_rise_mean_K", 1.0, "K"),
    ("cycles from cold to 95 % of the rise", "cycles_until_warm", 1.0, ""),
    ("time from cold until the winding trips", "trip_time_s", 1.0, "s"),
    ("life of the screw L10, turns", "life_turns", 1e-6, "million"),
    ("life of the screw L10, travel", "life_travel_m", 1e-3, "km"),
    ("life of the screw L10, time", "life_s", 1.0 / 3600.0, "h"),
)


def list_figures(sizing: JointSizing) -> list[tuple[str, str, str]]:
    """Return label, value and unit of the figures that are known."""
    found = [(label, getattr(sizing.figures, name), factor, unit) for label, name, factor, unit in _FIGURES]
    return [(label, format_value(factor * v), unit) for label, v, factor, unit in found if v is not None]


def format_tables(result: SizeResult) -> list[Table]:
    """Return the tables of a result: one of the candidates, or figures and limits of each joint."""
    if result.varied:
        return [_candidates(result)]
    (one,) = result.candidates
    return [table for sizing in one.joints.values() for table in (_figures(sizing), _limits(sizing))]


def format_lines(result: SizeResult) -> list[str]:
    """Return the verdicts and remarks."""
    sizings = [sizing for one in result.candidates for sizing in one.joints.values()]
    lines = [f"Note: {remark}" for remark in _remarks(result)] + _losses(result)
    if not result.varied:
        failed = [f"{result.name} does not hold: {one.problem}" for one in result.candidates if one.problem]
        return [*lines, *failed, *(sizing.verdict for sizing in sizings)]
    several = len({one.joint for one in result.candidates}) > 1
    for one in result.candidates:
        if not one.holds:
            place = f"{one.joint}, {one.label}" if several else one.label
            verb = "could not be judged" if one.holds is None else "falls out"
            lines.append(f"{place} {verb}: {'; '.join(one.reasons)}.")
    unexamined = {f"{limit.name} ({limit.missing})": None for one in sizings for limit in one.unexamined}
    lines += [f"Not examined for at least one actuator: {', '.join(unexamined)}."] if unexamined else []
    for joint in dict.fromkeys(one.joint for one in result.candidates):
        left = [one.label for one in result.candidates if one.joint == joint and one.holds]
        said = f"{', '.join(left)} hold{'s' if len(left) == 1 else ''}." if left else "No actuator holds."
        lines.append(f"{joint}: {said}" if several else said)
    return lines


def _remarks(result: SizeResult) -> list[str]:
    """Return the remarks, each once, with the candidates that they are about."""
    found: dict[str, list[str]] = {}
    for one in result.candidates:
        for sizing in one.joints.values():
            for remark in sizing.remarks:
                found.setdefault(remark, []).append(one.label)
    return [f"{', '.join(labels)}: {remark}" if result.varied else remark for remark, labels in found.items()]


def _losses(result: SizeResult) -> list[str]:
    """Return the losses in the figures of each joint and candidate."""
    return [
        f"{f'{joint}, {one.label}' if result.varied else joint}: {sizing.losses.sentence}."
        for one in result.candidates
        for joint, sizing in one.joints.items()
    ]


def _figures(sizing: JointSizing) -> Table:
    table = Table(title=escape(f"{sizing.joint}, {sizing.actuator}"), title_justify="left")
    for heading in ("", "value", ""):
        table.add_column(heading, justify="right" if heading else "left")
    for label, value, unit in list_figures(sizing):
        table.add_row(label, value, unit)
    return table


def _limits(sizing: JointSizing) -> Table:
    table = Table(title=escape(f"Limits of {sizing.joint}, the most used first"), title_justify="left")
    for heading in ("", "%", "used", "limit", "from"):
        justify = "right" if heading in ("%", "used", "limit") else "left"
        table.add_column(heading, justify=justify, overflow="fold")
    for one in sizing.limits:
        mark = "" if one.holds else " (!)"
        used, limit = format_value(one.used), f"{format_value(one.limit)} {one.unit}"
        table.add_row(f"{one.name}{mark}", format_percent(one.fraction), used, limit, one.source)
    for left in sizing.unexamined:
        table.add_row(left.name, "?", "", "", escape(f"not examined: needs {left.missing}"))
    return table


def _candidates(result: SizeResult) -> Table:
    joints = list(dict.fromkeys(str(one.joint) for one in result.candidates))
    life = "" if result.life is None else f", for a life of {format_value(result.life / 3600.0)} h"
    title = escape(f"Actuators of {', '.join(joints)}{life}")
    table = Table(title=title, title_justify="left", box=SIMPLE, padding=(0, 1, 0, 0), pad_edge=False)
    headings = (
        *(["joint"] if len(joints) > 1 else []),
        "",
        "holds",
        "most used",
        "%",
        "peak %",
        "rms %",
        "rise/K",
        "net/J",
        "life/h",
    )
    for heading in headings:
        text = heading in ("joint", "", "holds", "most used")
        table.add_column(
            heading,
            justify="left" if text else "right",
            no_wrap=heading != "most used",
            min_width=len(heading),
            overflow="fold",
        )
    for one in result.candidates:
        place = [escape(str(one.joint))] if len(joints) > 1 else []
        verdict = {True: "yes", False: "no", None: "?"}[one.holds]
        table.add_row(*place, escape(one.label), verdict, *_cells(one, str(one.joint)))
    return table


def _cells(one: Candidate, joint: str) -> list[str]:
    if joint not in one.joints:
        return ["cannot be run", *[""] * 6]
    sizing = one.joints[joint]
    used = {limit.name: limit.fraction for limit in sizing.limits}
    figures, worst = sizing.figures, sizing.limits[0]
    percents = [worst.fraction, used.get("peak torque"), used.get("rms torque")]
    return [
        worst.name,
        *("" if x is None else format_percent(x) for x in percents),
        *(
            "" if x is None else format_value(x)
            for x in (
                figures.temperature_rise_peak_K,
                figures.energy_in_J - figures.energy_regenerated_J,
                None if figures.life_s is None else figures.life_s / 3600.0,
            )
        ),
    ]
