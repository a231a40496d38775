"""Size the actuators of a scenario."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from ...base.patterns import matches_pattern
from ...base.progress import CompatibilityReport, Progress
from ...base.values import convert_value
from ...recorders.table import TimeSeries
from ...run.option_types import RunOptions
from ...run.remarks import describe_disabled_event_mode
from ...run.requirements import check_no_condition
from ...run.result import Result
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ...study.actuator.actuator import Actuator
from ...study.actuator.model_parameters import get_number
from ...study.criteria import ALL_JOINTS, Criteria, criteria_of
from ...study.limits import WINDING_TEMPERATURE
from ...study.loading import load
from ...study.roles import list_role_patterns
from ...system.model import System
from .cycle import SIGNALS, follow_reference, list_joints, read_cycle
from .data_sheets import find_data_sheet
from .figures import compute_figures
from .folder import SizeFolder
from .limits import Requirements, Unexamined, Utilisation, examine, link_capacity
from .losses import describe_losses
from .plant import find_plant
from .remarks import MAX_ROWS, describe_coupling, describe_cycle
from .result import Candidate, JointSizing, SizeResult
from .winding import Winding, find_winding, warm_up

AMBIENT = 313.15
"""Default temperature around a motor in K, 40 degrees Celsius as in IEC 60034-1."""

LEAD_IN = 1.0
"""Default time in s before the cycle."""


def size(
    source: str | Path | System,
    *,
    candidates: Mapping[str, Sequence[str | Path | Actuator]] | None = None,
    cycle: float | None = None,
    lead_in: float = LEAD_IN,
    ambient: float = AMBIENT,
    life: float | None = None,
    output: str | Path | None = None,
    plots: bool = True,
    report: bool = False,
    progress: Progress | None = None,
    **options: Unpack[RunOptions],
) -> SizeResult:
    """Examine whether actuators do the job of a scenario: continuously, at peak, and for how long.

    The scenario runs once with each candidate; meanwhile, the other joints have their first candidate that
    can be run. The end of the run is one cycle, which repeats for ever. The
    winding temperature is that of the repeated cycle. Each limit of the data sheet is compared with what the
    cycle uses of it.

    Args:
        source: scenario, as for `load`.
        candidates: several data sheets, as files or actuators, by joint.
        cycle: length of the cycle in s. Default: the period of the reference, otherwise the whole run.
        lead_in: time in s before the start time, in which the joints settle. It does not count.
        ambient: temperature around the motors in K.
        life: time in s for which the cycle is to repeat, for the life of the screw.
        output: folder for results.
        plots: draw plots into the folder.
        report: write a page, size.html, into the folder.
        progress: receives the progress.
        **options: options as for `load`.

    Returns:
        Figures, limits and verdicts of all joints, for each candidate.

    Raises:
        CommandError: a name or a value does not fit, or a single actuator cannot do its motion at all.
        RunError: a run fails.

    Examples:
        >>> import emla_cosim as ec
        >>> result = ec.size("prototype", stop_time=4.0)
        >>> joint = result["prototype"]
        >>> joint.holds, joint.limits[0].name
        (True, 'motor speed')
    """
    told = _NotesOnce(progress or Progress())
    _check(cycle, lead_in, ambient, life)
    varied = {joint: _label_sheets(joint, sheets) for joint, sheets in (candidates or {}).items()}
    folder = None
    if output is not None:
        place = convert_value(output, Path, "the output folder")
        folder = SizeFolder(place, bool(options.get("overwrite", False)), plots, report)
    task = _Task(source, cycle, lead_in, Requirements(ambient, life), folder, told)
    with nullcontext() if folder is None else folder.alone():
        if varied:
            name = Path(str(source)).stem if isinstance(source, (str, Path)) else "system"
            found = list(_size_candidates(varied, options, task))
        else:
            scenario = load(source, **options)
            name = scenario.name
            try:
                found = [Candidate(name, _size_scenario(scenario, task))]
            except RunError as error:
                if (overload := _describe_overload(error)) is None:
                    raise
                found = [Candidate(name, {}, overload)]
        result = SizeResult(name, found, list(varied), ambient, life)
        if folder is not None:
            folder.keep(result)
    return result


def _check(cycle: float | None, lead_in: float, ambient: float, life: float | None) -> None:
    for name, value in (("cycle", cycle), ("life", life), ("ambient", ambient)):
        if value is not None and not 0.0 < value < np.inf:
            raise CommandError(f"{name} is {value!r}; it must be a positive number.")
    if not 0.0 <= lead_in < np.inf:
        raise CommandError(f"lead_in is {lead_in!r}; it must be 0 or a positive number.")


_Sheet = str | Path | Actuator


def _label_sheets(joint: str, sheets: Sequence[_Sheet]) -> dict[str, _Sheet]:
    """Return the data sheets of a joint's candidates by label."""
    found: dict[str, _Sheet] = {}
    for sheet in sheets:
        label = sheet.title if isinstance(sheet, Actuator) else str(sheet)
        if label in found:
            raise CommandError(f"'{label}' occurs twice among the actuators of {joint}.")
        found[label] = sheet
    if not found:
        raise CommandError(f"{joint} has no candidates.", joint=joint)
    return found


@dataclass(frozen=True)
class _Task:
    """What all candidates have in common; see `size`."""

    source: Any
    cycle: float | None
    lead_in: float
    needed: Requirements
    folder: SizeFolder | None
    progress: Progress


def _size_candidates(
    varied: Mapping[str, Mapping[str, _Sheet]], options: Mapping[str, Any], task: _Task
) -> Iterator[Candidate]:
    """Yield the candidates of each joint; one that cannot be run has a problem.

    In the run of a candidate, other joints have their first candidate that can be loaded.
    """
    problems = {
        joint: {label: _find_problem({joint: sheet}, options, task) for label, sheet in sheets.items()}
        for joint, sheets in varied.items()
    }
    usable = {
        joint: [label for label, problem in found.items() if problem is None]
        for joint, found in problems.items()
    }
    first = {joint: labels[0] for joint, labels in usable.items() if labels}
    runs: dict[tuple[tuple[str, str], ...], dict[str, JointSizing] | RunError] = {}
    others: dict[str, JointSizing] = {}
    for joint, sheets in varied.items():
        for label in sheets:
            if (problem := problems[joint][label]) is not None:
                yield Candidate(label, {}, problem, joint)
                continue
            chosen = {**first, joint: label}
            key = tuple(chosen.items())
            if key not in runs:
                actuators = {name: varied[name][one] for name, one in chosen.items()}
                runs[key] = _try_run(actuators, options, task)
            result = runs[key]
            if isinstance(result, RunError):
                yield Candidate(label, {}, _describe_overload(result) or str(result), joint)
            elif joint not in result:
                raise CommandError(f"there is no sizing of a joint '{joint}'.", joint=joint)
            else:
                yield Candidate(label, {joint: result[joint]}, None, joint)
                others = {**result, **others}
    for joint, sizing in others.items():
        if joint not in varied:
            yield Candidate(sizing.actuator, {joint: sizing}, None, joint)


def _describe_overload(error: RunError) -> str | None:
    """Return which joints had a load that their motors cannot hold before a run failed; None without one."""
    result = error.fields.get("result")
    joints = {} if result is None else result.metrics.get("joints", {})
    tripped = [str(one["reason"]) for one in joints.values() if (one["trip"] or {}).get("cause")]
    return " ".join(tripped) or None


def _load_with(actuators: Mapping[str, _Sheet], options: Mapping[str, Any], task: _Task) -> Scenario:
    given: dict[str, Any] = {**options, "actuator": {**options.get("actuator", {}), **actuators}}
    return load(task.source, **given)


def _find_problem(actuators: Mapping[str, _Sheet], options: Mapping[str, Any], task: _Task) -> str | None:
    """Return what is wrong with a data sheet, or what its actuator cannot do at all."""
    try:
        _load_with(actuators, options, task)
    except CommandError as error:
        if "problems" not in error.fields:
            raise  # not a fault of the data sheet
        return str(error)
    return None


def _try_run(
    actuators: Mapping[str, _Sheet], options: Mapping[str, Any], task: _Task
) -> dict[str, JointSizing] | RunError:
    """Return the joints of a run, or why the run failed."""
    try:
        return _size_scenario(_load_with(actuators, options, task), task)
    except RunError as error:
        return error


def _size_scenario(scenario: Scenario, task: _Task) -> dict[str, JointSizing]:
    """Run a scenario and return its joints."""
    check_no_condition(scenario.options.stop_when, "size")
    if task.folder is not None:
        task.folder.check_unread([scenario.options.files_read()])
    times, roles = run_times(scenario.options, scenario.name), scenario.options.roles
    wanted = [*dict.fromkeys((*list_role_patterns(*SIGNALS), *roles.values()))]
    whole = times.stop - times.start
    length = whole if task.cycle is None else task.cycle
    if length > whole * (1.0 + 1e-9):
        raise CommandError(f"the cycle of {length:g} s is longer than the run of {whole:g} s.")
    interval = times.step * max(math.ceil(length / times.step / MAX_ROWS), 1)  # peaks need every row
    given: dict[str, Any] = {"output_interval": interval}
    if task.lead_in:
        given["start_time"] = times.start - task.lead_in
    with scenario.prepare(task.progress, **given) as simulation:
        for remark in describe_disabled_event_mode(simulation.system):
            task.progress.note(f"Note: {remark}")
        known = simulation.select_signals([])
        kept = [name for name in known if any(matches_pattern(name, pattern) for pattern in wanted)]
        joints = list_joints(kept, roles)
        if not joints:
            raise CommandError(
                f"'{scenario.name}' has no joint with position, speed, torque, currents, power and load; see "
                "--role."
            )
        if task.folder is not None:
            task.folder.check_pictures(joints)
        own = {
            joint: _cycle_length(scenario, joint, whole) if task.cycle is None else length for joint in joints
        }
        table = _LastRows(times.stop - max(own.values()))
        result = simulation.run(recorders=[table], signals=kept)
        if result.early_end is not None:  # of an FMU; conditions were refused before
            raise RunError(f"{result.early_end.rstrip('.')}, but emla size needs the whole run.")
    chosen = scenario.options.criteria
    criteria = criteria_of(
        joints, {key: chosen[key] for key in chosen if key.rpartition(".")[0] in (*joints, ALL_JOINTS)}
    )
    sizings = {}
    for joint in joints:
        sheet = find_data_sheet(scenario, task.source, joint)
        start = times.stop - own[joint]
        sizings[joint] = _size_joint(result, joint, sheet, criteria[joint], start, times.stop, task.needed)
    return {
        joint: replace(
            sizing,
            remarks=(
                *describe_cycle(sizing, times.step),
                *describe_coupling(joint, sizings, scenario.system),
            ),
        )
        for joint, sizing in sizings.items()
    }


class _NotesOnce(Progress):
    """Passes progress on, and each note once: those of all candidates are alike."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._noted: set[str] = set()

    def begin(self, task: str, total: int, unit: str = "") -> None:
        """Begin a task."""
        self._progress.begin(task, total, unit)

    def advance(self, count: int) -> None:
        """Count further units as done."""
        self._progress.advance(count)

    def finish(self) -> None:
        """End the task."""
        self._progress.finish()

    def report_replacement(self, fit: CompatibilityReport) -> None:
        """Report how the FMU of a replacement fits."""
        self._progress.report_replacement(fit)

    def note(self, sentence: str) -> None:
        """Report a note or warning, unless it was reported before."""
        if sentence not in self._noted:
            self._noted.add(sentence)
            self._progress.note(sentence)


class _LastRows(TimeSeries):
    """Keeps the rows from a time in s on."""

    def __init__(self, start: float) -> None:
        self._start = start - 1e-9

    def append(self, rows: Vector) -> None:
        """Keep a copy of the rows that are late enough."""
        super().append(rows[rows[:, 0] >= self._start])


def _cycle_length(scenario: Scenario, joint: str, whole: float) -> float:
    """Return the length in s of a joint's cycle, from that of the run."""
    period = get_number(scenario.system, scenario.options, f"{joint}.reference", "period")
    return period if period and period <= whole else whole


def _size_joint(
    result: Result,
    joint: str,
    sheet: Actuator,
    criteria: Criteria,
    start: float,
    stop: float,
    needed: Requirements,
) -> JointSizing:
    values, plant = sheet.values, find_plant(joint, result.parameters, sheet.emla)
    cycle = read_cycle(result, plant, start, stop)
    verdict = result.metrics.get("joints", {}).get(joint, {"held": True})
    trip = verdict.get("trip") or {}
    reason = None if verdict.get("held") else str(verdict.get("reason"))
    is_hot = trip.get("what") == WINDING_TEMPERATURE and not verdict.get("oscillation")
    if is_hot and np.abs(cycle.error).max() <= criteria.position_window:
        reason = None  # it follows its motion; that it is too hot is said by its limits
    overloaded = reason is not None and bool(trip.get("cause"))
    required = reason is not None and cycle.has_required
    if required:
        cycle = follow_reference(cycle, plant, result)
    winding, rise = find_winding(plant, values, criteria.over_temperature), None
    if isinstance(winding, Winding):
        rise = winding.rise(cycle)
        cycle = warm_up(cycle, plant, rise)
    figures = compute_figures(cycle, values, link_capacity(values), winding, rise)
    examined = list(examine(cycle, values, figures, needed, winding))
    limits = [one for one in examined if isinstance(one, Utilisation)]
    return JointSizing(
        joint,
        sheet.title or (sheet.file.name if sheet.file else "its own actuator"),
        values,
        cycle,
        figures,
        sorted(limits, key=lambda one: -one.fraction),
        [one for one in examined if isinstance(one, Unexamined)],
        describe_losses(cycle, plant),
        winding,
        rise,
        required,
        reason,
        overloaded,
    )
