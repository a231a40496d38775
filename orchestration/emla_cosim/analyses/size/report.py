"""The report of a sizing: figures, limits, tolerances and verdicts, with plots of all candidates."""

import math
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...study.actuator.entries import ROOT_2, TURN
from ..frame.outputs import Outputs
from ..frame.report import Report, ReportTable, Section, Text
from .limits import Utilisation, format_percent, format_value
from .pictures import draw_limits, draw_motion, draw_motor
from .result import Candidate, JointSizing, SizeResult
from .tolerances import AMBIENT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


_ASSUMED = (
    (("motor.kT",), "motor.K_E", "torque constant of K_E"),
    (("motor.tau_N",), "motor.i_N", "continuous torque of i_N"),
    (("motor.tau_R",), "motor.n_max", "the same continuous torque at all speeds"),
    (("motor.B_m", "screw.B_BS"), "motor.n_max", "no viscous friction"),
    (("friction.F_C",), "motor.n_max", "Coulomb friction of the scenario"),
    (("coupling.J_c", "screw.J_BS"), "motor.n_max", "no inertia of coupling and screw"),
    (("gearbox.ratio",), "motor.n_max", "no gearbox"),
    (("screw.f_w",), "screw.C_a", "no shocks"),
)
"""Entries, and what is assumed if a data sheet has none of them, but the one that follows."""


def build_report(result: SizeResult) -> Report:
    """Return the report of a sizing: of several candidates their table, the rest on the page only."""
    notes = (f"Note: {text}" for text in _list_remarks(result))
    losses = (f"{_label(result, candidate, x)}: {x.losses.sentence}." for candidate, x in result.sizings)
    lines: list[Text | str] = [*_list_assumptions(result), *notes, *losses]
    sections = list[Section]()
    for candidate, sizing in result.sizings:
        tables = [_tabulate_figures(sizing), _tabulate_limits(sizing), *_tabulate_tolerances(sizing)]
        if result.varied:
            title = f"{sizing.joint}: {candidate.label}"
            sections.append(Section(title, [_mark(sizing.verdict, sizing.holds)], tables, is_detail=True))
        else:
            sections.append(Section(sizing.joint, tables=tables, pictures=_describe_pictures(sizing.joint)))
    if result.varied:
        captions = {name: text for joint in result.joints for name, text in _describe_pictures(joint).items()}
        tables = [_tabulate_candidates(result), *_tabulate_draws(result)]
        under = [*lines, *_describe_verdicts(result)]
        sections.insert(0, Section("Candidates", tables=tables, pictures=captions, under=under))
    else:
        problems = [candidate.problem for candidate in result.candidates if candidate.problem is not None]
        lines += [_mark(f"{result.name} does not hold: {problem}", False) for problem in problems]
        lines += [_mark(sizing.verdict, sizing.holds) for _, sizing in result.sizings]
        tables = [_tabulate_actuators(result)] if len(result.sizings) > 1 else []
        sections.append(Section("Verdict", tables=tables, under=lines))
    return Report("Sizing", result.name, list(_list_facts(result)), sections)


def _label(result: SizeResult, candidate: Candidate, sizing: JointSizing) -> str:
    return f"{sizing.joint}, {candidate.label}" if result.varied else sizing.joint


def _mark(sentence: str, holds: bool | None) -> Text | str:
    """Return a message, marked if it reports a failure."""
    return sentence if holds else Text(sentence, is_failure=True)


def _list_facts(result: SizeResult) -> Iterator[str]:
    """Yield for each joint whether it holds, or how many of its candidates do; then the ambient."""
    for joint, sizing in result.joints.items():
        if joint in result.varied:
            verdicts = [candidate.holds for candidate in result.candidates if candidate.joint == joint]
            yield f"{joint}: {verdicts.count(True)} of {len(verdicts)} hold"
        else:
            holds = sizing.holds
            yield f"{joint} {'holds' if holds else 'not judged' if holds is None else 'does not hold'}"
    yield f"ambient {_format_ambient(result)}"


def _format_ambient(result: SizeResult) -> str:
    return f"{format_value(result.ambient - 273.15)} °C"


def _list_assumptions(result: SizeResult) -> Iterator[str]:
    """Yield what is assumed: surroundings and cycles, then for entries that data sheets lack."""
    cycles = dict.fromkeys(f"{format_value(x.figures.cycle_s)} s" for _, x in result.sizings)
    cycle = f", cycle of {' and '.join(cycles)}" if cycles else ""
    life = "no required life" if result.life is None else f"for {format_value(result.life / 3600.0)} h"
    lead_in = f"{format_value(result.lead_in)} s lead-in"
    yield f"Assumed: {_format_ambient(result)} around the motors{cycle}, {lead_in}, {life}."
    labels = dict[str, list[str]]()
    for candidate, sizing in result.sizings:
        values = sizing.values
        missing = [text for names, x, text in _ASSUMED if x in values and values.keys().isdisjoint(names)]
        if missing:
            label = candidate.label if result.varied else sizing.joint
            labels.setdefault(", ".join(missing), []).append(label)
    for text, names in labels.items():
        yield f"Assumed, as the data sheet of {', '.join(names)} has no such entries: {text}."


def _describe_verdicts(result: SizeResult) -> Iterator[Text | str]:
    """Yield which candidates fall out, and which hold."""
    joints = dict.fromkeys(candidate.joint for candidate in result.candidates)
    several = len(joints) > 1
    for candidate in (candidate for candidate in result.candidates if not candidate.holds):
        label = f"{candidate.joint}, {candidate.label}" if several else candidate.label
        verb = "could not be judged" if candidate.holds is None else "falls out"
        yield Text(f"{label} {verb}: {'; '.join(candidate.reasons)}.", is_failure=True)
    limits = [limit for _, sizing in result.sizings for limit in sizing.unexamined]
    if unexamined := dict.fromkeys(f"{limit.name} ({limit.missing})" for limit in limits):
        yield f"Not examined for at least one actuator: {', '.join(unexamined)}."
    for joint in joints:
        labels = [c.label for c in result.candidates if c.joint == joint and c.holds]
        verdict = f"{', '.join(labels) or 'No actuator'} hold{'' if len(labels) > 1 else 's'}."
        yield f"{joint}: {verdict}" if several else verdict


def _list_remarks(result: SizeResult) -> list[str]:
    """Return the remarks, each once, with the candidates that they are about."""
    labels = dict[str, list[str]]()
    for candidate, sizing in result.sizings:
        for remark in sizing.remarks:
            labels.setdefault(remark, []).append(candidate.label)
    return [f"{', '.join(names)}: {remark}" if result.varied else remark for remark, names in labels.items()]


def _tabulate_figures(sizing: JointSizing) -> ReportTable:
    rows = [
        (label, format_value(factor * value), unit)
        for label, name, factor, unit in _FIGURES
        if (value := getattr(sizing.figures, name)) is not None
    ]
    return ReportTable(f"{sizing.joint}, {sizing.actuator}", ("", "value", ""), rows, texts=(0, 2))


def _tabulate_limits(sizing: JointSizing) -> ReportTable:
    rows = list[list[Text | str]]()
    for limit in sizing.limits:
        used, bound = format_value(limit.used), f"{format_value(limit.limit)} {limit.unit}"
        rows.append([_mark_limit(limit), format_percent(limit.fraction), used, bound, limit.source])
    rows += [[x.name, "?", "", "", f"not examined: needs {x.missing}"] for x in sizing.unexamined]
    title = f"Limits of {sizing.joint}, the most used first"
    return ReportTable(title, ("", "%", "used", "limit", "from"), rows, texts=(0, 4))


def _mark_limit(limit: Utilisation) -> Text:
    return Text(f"{limit.name}{'' if limit.holds else ' (!)'}", is_failure=not limit.holds)


def _tabulate_tolerances(sizing: JointSizing) -> Iterator[ReportTable]:
    """Yield a table of the worst draw of each limit; none without tolerances."""
    if (study := sizing.tolerances) is None:
        return
    more = ["95 % below\n%"] if study.is_random else []
    header = ["", "nominal\n%", "worst\n%", "margin\n%", *more, "with"]
    rows = list[list[Text | str]]()
    for use in study.limits(sizing.limits):
        nominal = "" if use.nominal is None else format_percent(use.nominal)
        percents = [nominal, format_percent(use.worst.fraction), format_percent(use.margin)]
        if more:
            percents.append(format_percent(use.quantile) if math.isfinite(use.quantile) else "failed")
        values = (text.replace(" ", "\N{NO-BREAK SPACE}") for text in study.texts(use.at))
        rows.append([_mark_limit(use.worst), *percents, ", ".join(values)])
    under = [f"Values are those of {', '.join(study.units)}. With tolerances, {study.sentence}."]
    sources = {limit.source for draw in study.draws for limit in draw.limits}
    if AMBIENT in study.units and sources and "thermal.T_max" not in sources:
        under.append(f"{AMBIENT} changes nothing: only the limit thermal.T_max depends on it.")
    if failed := [draw for draw in study.failures if draw.reason is not None]:
        under.append(f"With {study.label(failed[0])}: {failed[0].reasons[0]}.")
    noun = "random draws" if study.is_random else "combinations of the ends"
    title = f"Tolerances of {sizing.joint}, worst of {len(study.draws)} {noun}"
    yield ReportTable(title, header, rows, under, texts=(0, len(header) - 1))


def _tabulate_draws(result: SizeResult) -> Iterator[ReportTable]:
    """Yield a table of what the draws of each candidate use most."""
    rows, sentences = list[list[Text | str]](), list[str]()
    for candidate, sizing in result.sizings:
        if (study := sizing.tolerances) is not None:
            label, count = _label(result, candidate, sizing), f"{len(study.failures)} of {len(study.draws)}"
            cells = ["all runs failed", "", ""]
            for use in study.limits(sizing.limits)[:1]:
                cells = [use.worst.name, format_percent(use.worst.fraction), format_percent(use.margin)]
            rows.append([Text(label, is_failure=bool(study.failures)), count, *cells])
            sentences += [f"{label}: {study.sentence}."] if study.is_random else []
    if rows:
        header = ("", "do not hold", "most used", "worst\n%", "margin\n%")
        yield ReportTable("Tolerances, worst of all draws", header, rows, sentences, texts=(0, 2))


_HOLDS = {True: "yes", False: "no", None: "?"}
_USE_HEADER = ("holds", "most used", "%", "peak %", "rms %", "rise/K", "net/J", "life/h")


def _tabulate_actuators(result: SizeResult) -> ReportTable:
    """Return one table of all actuators: what each uses most, and the energy that it takes."""
    rows = list[list[Text | str]]()
    for candidate, sizing in result.sizings:
        label = Text(sizing.joint, is_failure=sizing.holds is False)
        rows.append([label, _HOLDS[sizing.holds], *_list_cells(candidate, sizing.joint)])
    figures = [sizing.figures for _, sizing in result.sizings]
    net = sum(x.energy_in_J - x.energy_regenerated_J for x in figures)
    total = f"All together take {format_value(net)} J per cycle if each uses what another one regenerates."
    return ReportTable("All actuators", ("", *_USE_HEADER), rows, [total], texts=range(3))


def _tabulate_candidates(result: SizeResult) -> ReportTable:
    joints = list(dict.fromkeys(str(candidate.joint) for candidate in result.candidates))
    life = "" if result.life is None else f", for a life of {format_value(result.life / 3600.0)} h"
    header = ("joint", "", *_USE_HEADER)
    rows = list[list[Text | str]]()
    for candidate in result.candidates:
        joint, label = str(candidate.joint), Text(candidate.label, is_failure=candidate.holds is False)
        rows.append([joint, label, _HOLDS[candidate.holds], *_list_cells(candidate, joint)])
    first = 0 if len(joints) > 1 else 1  # all are of the same joint
    title, cells = f"Actuators of {', '.join(joints)}{life}", [row[first:] for row in rows]
    return ReportTable(title, header[first:], cells, texts=range(4 - first))


def _list_cells(candidate: Candidate, joint: str) -> list[str]:
    """Return the cells of `_USE_HEADER` after the first one for a joint of a candidate."""
    if joint not in candidate.joints:
        return ["cannot be run", *[""] * 6]
    figures, limits = candidate.joints[joint].figures, candidate.joints[joint].limits
    used = {limit.name: limit.fraction for limit in limits}
    percents = [limits[0].fraction, used.get("peak torque"), used.get("rms torque")]
    net, life_s = figures.energy_in_J - figures.energy_regenerated_J, figures.life_s
    values = [figures.temperature_rise_peak_K, net, None if life_s is None else life_s / 3600.0]
    return [
        limits[0].name,
        *("" if x is None else format_percent(x) for x in percents),
        *("" if x is None else format_value(x) for x in values),
    ]


def _describe_pictures(joint: str) -> dict[str, str]:
    """Return what the pictures of a joint show, by file name."""
    curves = "over speed with the curves of the motors, winding temperature, and power"
    texts = (
        f"Torque and force of {joint} {curves}",
        f"Motion and load of {joint} over the cycle",
        f"How much of each limit of {joint} is used",
    )
    return dict(zip(name_pictures(joint), texts, strict=True))


def name_pictures(joint: str) -> list[str]:
    """Return the names of the files of a joint's plots: of its motor, of its motion, and of its limits."""
    name = re.sub(r"[^\w-]", "_", joint)
    return [f"{name}.png", f"{name}-motion.png", f"{name}-limits.png"]


def _draw(result: SizeResult) -> "Iterator[tuple[str, Figure]]":
    """Draw the plots of each joint with all its candidates."""
    for joint in result.joints:
        sizings = {c.label: c.joints[joint] for c in result.candidates if joint in c.joints}
        for name, draw in zip(name_pictures(joint), (draw_motor, draw_motion, draw_limits), strict=True):
            yield name, draw(sizings)


OUTPUTS = Outputs[SizeResult](
    subject="sizing",
    name="size",
    tables={
        "limits.csv": lambda result: result.table.write_csv(),
        "cycles.csv": lambda result: result.cycles.write_csv(),
        "tolerances.csv": lambda result: None if result.draws is None else result.draws.write_csv(),
    },
    report=build_report,
    draw=_draw,
    list_pictures=lambda result: [name for joint in result.joints for name in name_pictures(joint)],
)
