"""Size the actuators of a scenario."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Unpack

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, CosimError, RunError
from ...base.progress import Progress
from ...base.wording import matches_pattern
from ...recorders.table import TimeSeries
from ...run.option_types import RunOptions
from ...run.registered import list_roles
from ...run.remarks import describe_disabled_event_mode
from ...run.requirements import check_no_condition
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ...study.actuator.actuator import Actuator
from ...study.actuator.model_parameters import get_number
from ...study.criteria import ALL_JOINTS, resolve_criteria
from ...study.loading import load
from ...study.roles import list_role_patterns
from ...system.model import System
from ..execution.executor import Scheduler
from ..frame.session import Session
from ..variants.factors import merge_options
from .cycle import SIGNALS, find_data_sheet, list_joints
from .draws import SizedRun, Variation, run_draws
from .joints import MAX_ROWS, Examination, describe_coupling, describe_cycle, describe_overload
from .limits import Requirements
from .report import OUTPUTS, name_pictures
from .result import Candidate, JointSizing, SizeResult

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
    vary: Mapping[str, Any] | None = None,
    runs: int | None = None,
    seed: int = 0,
    scheduler: Scheduler = None,
    workers: int | None = None,
    output: str | Path | None = None,
    plots: bool = True,
    report: bool = False,
    progress: Progress | None = None,
    **options: Unpack[RunOptions],
) -> SizeResult:
    """Examine whether actuators do the job of a scenario: continuously, at peak, and for how long.

    The scenario runs once with each candidate; meanwhile, the other joints have their first candidate that
    can be run. The end of the run is one cycle, which repeats permanently. The
    winding temperature is that of the repeated cycle. Each limit of the data sheet is compared with what the
    cycle uses of it.

    Args:
        source: scenario, as for `load`.
        candidates: several data sheets, as files or actuators, by joint.
        cycle: length of the cycle in s. Default: the period of the reference, otherwise the whole run.
        lead_in: time in s before the start time, in which the joints settle. It does not count.
        ambient: temperature around the motors in K.
        life: time in s for which the cycle is to repeat, for the life of the screw.
        vary: tolerances, as for `sweep`: start values, entries of data sheets, and `ambient`. Each candidate
            runs with all combinations of their low and high ends; it holds if it holds in all of them.
        runs: number of random draws from the tolerances, instead of their ends.
        seed: seed of the draws.
        scheduler: address or client of a Dask scheduler for these runs. Default: this machine.
        workers: number of processes on this machine. Default: one for each core.
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
    _check_arguments(cycle, lead_in, ambient, life)
    arguments = {"runs": runs, "scheduler": scheduler}
    if not vary and (idle := [name for name, value in arguments.items() if value is not None]):
        raise CommandError(f"'{idle[0]}' is for tolerances; add 'vary' (--vary NAME=LOW:HIGH), or remove it.")
    if seed and runs is None:
        raise CommandError("a seed is for random draws; add 'runs' (--runs), or remove it.")
    variation = Variation(vary, runs, seed) if vary else None
    varied = {joint: _label_sheets(joint, sheets) for joint, sheets in (candidates or {}).items()}
    overwrite = bool(options.get("overwrite", False))
    session = Session(OUTPUTS, output, overwrite, plots, report, scheduler, workers, progress)
    task = _Task(
        source, options, varied, cycle, lead_in, Requirements(ambient, life), variation, session, plots
    )
    with session.reserve_folder():
        rows = list(_plan_rows(task)) if varied else [_Row("", None, ())]
        sized = {
            key: _try_run(dict(key), task) for key in dict.fromkeys(x.key for x in rows if not x.problem)
        }
        failure: CosimError | None = None
        nominal = {key: run for key, run in sized.items() if isinstance(run, SizedRun)}
        try:
            sized |= run_draws(session, nominal)
        except CosimError as error:  # what is computed is kept, and says that it is not all
            failure = error
            sized |= {key: _drop_tolerances(run, error) for key, run in nominal.items()}
        name = Path(str(source)).stem if isinstance(source, (str, Path)) else "system"
        if isinstance(run := sized.get(()), SizedRun):
            name = run.name
        all_candidates = list(_list_candidates(rows, sized, name))
        result = SizeResult(name, all_candidates, list(varied), ambient, life, lead_in)
        session.keep(result)
    if failure is not None:
        files = "" if session.path is None else f" The results without tolerances are in {session.path}."
        raise type(failure)(f"{failure}{files}", **failure.fields) from failure
    return result


def _drop_tolerances(run: SizedRun, error: CosimError) -> SizedRun:
    """Return a run whose joints say that their tolerances were not judged, and why."""
    remark = f"the tolerances are not judged: {error}"
    joints = {joint: replace(x, remarks=(*x.remarks, remark)) for joint, x in run.joints.items()}
    return replace(run, joints=joints)


def _check_arguments(cycle: float | None, lead_in: float, ambient: float, life: float | None) -> None:
    """Raise CommandError unless cycle, ambient and life are positive, and `lead_in` is not negative."""
    for name, value in (("cycle", cycle), ("life", life), ("ambient", ambient)):
        if value is not None and not 0.0 < value < np.inf:
            raise CommandError(f"{name} is {value!r}; it must be a positive, finite number.")
    if not 0.0 <= lead_in < np.inf:
        raise CommandError(f"lead_in is {lead_in!r}; it must be a finite number from 0.")


_Sheet = str | Path | Actuator


def _label_sheets(joint: str, sheets: Sequence[_Sheet]) -> dict[str, _Sheet]:
    """Return the data sheets of a joint's candidates by label; CommandError for none, or for one twice."""
    labels = [sheet.title if isinstance(sheet, Actuator) else str(sheet) for sheet in sheets]
    if twice := [label for label in labels if labels.count(label) > 1]:
        raise CommandError(f"'{twice[0]}' occurs twice among the actuators of {joint}; remove one.")
    if not labels:
        raise CommandError(f"{joint} has no candidates; name a data sheet, or remove it.", joint=joint)
    return dict(zip(labels, sheets, strict=True))


@dataclass(frozen=True)
class _Task:
    """What all candidates have in common; see `size`."""

    source: Any
    options: Mapping[str, Any]
    varied: Mapping[str, Mapping[str, _Sheet]]
    cycle: float | None
    lead_in: float
    needed: Requirements
    variation: Variation | None
    session: Session[SizeResult]
    plots: bool

    def load(self, labels: Mapping[str, str], more: Mapping[str, Any] = MappingProxyType({})) -> Scenario:
        """Load the scenario with these candidates by joint, and with further options."""
        sheets = {joint: self.varied[joint][label] for joint, label in labels.items()}
        layers = [self.options, {"actuator": sheets} if sheets else {}, more]
        return load(self.source, **merge_options(layers))


_Key = tuple[tuple[str, str], ...]
"""The joints with several candidates in a run, each with the label of one."""


class _Row(NamedTuple):
    """A candidate of a joint: the key of its run, or what is wrong with it."""

    label: str
    joint: str | None
    key: _Key
    problem: str | None = None


def _plan_rows(task: _Task) -> Iterator[_Row]:
    """Yield the candidates of each joint.

    In the run of a candidate, other joints have their first candidate that can be loaded.
    """
    problems = {
        (joint, label): _find_problem({joint: label}, task)
        for joint, sheets in task.varied.items()
        for label in sheets
    }
    # reversed: the first of each joint overrides the later ones
    first = dict(reversed([key for key, problem in problems.items() if problem is None]))
    first = {joint: first[joint] for joint in task.varied if joint in first}
    for (joint, label), problem in problems.items():
        yield _Row(label, joint, tuple({**first, joint: label}.items()), problem)


def _list_candidates(
    rows: Sequence[_Row], sized: Mapping[_Key, SizedRun | RunError], name: str
) -> Iterator[Candidate]:
    """Yield all rows with their results, then joints without candidates."""
    remaining: dict[str, JointSizing] = {}
    for row in rows:
        label, run = row.label or name, sized.get(row.key)
        if run is None or row.problem:
            yield Candidate(label, {}, row.problem, row.joint)
        elif isinstance(run, RunError):
            yield Candidate(label, {}, describe_overload(run.fields.get("result")) or str(run), row.joint)
        elif row.joint is None:
            yield Candidate(label, run.joints)
        elif row.joint not in run.joints:
            raise CommandError(f"there is no sizing of a joint '{row.joint}'.", joint=row.joint)
        else:
            yield Candidate(label, {row.joint: run.joints[row.joint]}, None, row.joint)
            remaining = {**run.joints, **remaining}
    for joint, sizing in remaining.items():
        if all(row.joint != joint for row in rows):
            yield Candidate(sizing.actuator, {joint: sizing}, None, joint)


def _find_problem(labels: Mapping[str, str], task: _Task) -> str | None:
    """Return what is wrong with a data sheet, or what its actuator cannot do at all."""
    try:
        task.load(labels)
    except CommandError as error:
        if "problems" not in error.fields:
            raise  # not a fault of the data sheet
        return str(error)
    return None


def _try_run(labels: Mapping[str, str], task: _Task) -> SizedRun | RunError:
    """Return the joints of a run, or why the run of a candidate failed.

    Raises:
        RunError: A run without candidates failed, and not because of its load.
    """
    scenario = task.load(labels)
    try:
        return _size_scenario(scenario, labels, task)
    except RunError as error:
        if not labels and describe_overload(error.fields.get("result")) is None:
            raise
        return error


def _size_scenario(scenario: Scenario, labels: Mapping[str, str], task: _Task) -> SizedRun:
    """Run a scenario with these candidates by joint, and return its joints."""
    check_no_condition(scenario.options.stop_when, "size")
    session = task.session
    session.check_unread([scenario.options.files_read()])
    times = run_times(scenario.options, scenario.name)
    roles = list_roles(scenario.system, scenario.options)
    patterns = [*dict.fromkeys((*list_role_patterns(*SIGNALS), *roles.values()))]
    run_length = times.stop - times.start
    length = run_length if task.cycle is None else task.cycle
    if length > run_length * (1.0 + 1e-9):
        raise CommandError(
            f"the cycle of {length:g} s is longer than the run of {run_length:g} s; choose "
            "a shorter cycle or a later stop time."
        )
    interval = times.step * max(math.ceil(length / times.step / MAX_ROWS), 1)  # peaks need every row
    run_options: dict[str, Any] = {"output_interval": interval}
    run_options |= {"start_time": times.start - task.lead_in} if task.lead_in else {}
    planned = scenario.with_options(run_options)
    draws = None if task.variation is None else task.variation.draw(planned, session.progress)
    with planned.prepare(session.progress) as simulation:
        for remark in describe_disabled_event_mode(simulation.system):
            session.progress.note(f"Note: {remark}")
        names = simulation.select_signals([])
        signals = [name for name in names if any(matches_pattern(name, pattern) for pattern in patterns)]
        # before the run: a scenario without such a joint would be run in vain
        joints = list_joints(signals, roles)
        if not joints:
            raise CommandError(
                f"'{scenario.name}' has no joint with position, speed, torque, currents, power and load; see "
                "--role."
            )
        if session.folder is not None and task.plots:
            session.folder.check_files(name for joint in joints for name in name_pictures(joint))
        starts = dict.fromkeys(joints, times.stop - length)
        if task.cycle is None:
            for joint in joints:
                period = get_number(scenario.system, scenario.options, f"{joint}.reference", "period")
                starts[joint] = times.stop - (period if period and period <= run_length else run_length)
        table = _LastRows(min(starts.values()))
        result = simulation.run(recorders=[table], signals=signals)
        if result.early_end is not None:  # of an FMU; conditions were refused before
            raise RunError(f"{result.early_end.rstrip('.')}, but emla size needs the whole run.")
    keys = [key for key in scenario.options.criteria if key.rpartition(".")[0] in (*joints, ALL_JOINTS)]
    criteria = {key: scenario.options.criteria[key] for key in keys}

    def examine(scenario: Scenario) -> Examination:
        sheets = {joint: find_data_sheet(scenario, task.source, joint) for joint in joints}
        return Examination(sheets, resolve_criteria(joints, criteria), starts, times.stop, task.needed)

    def change(more: Mapping[str, Any]) -> tuple[Scenario, Examination]:
        changed = task.load(labels, more)
        return changed.with_options(run_options), examine(changed)

    examination = examine(scenario)
    sizings = examination.size(result)
    for joint, sizing in sizings.items():
        coupling = describe_coupling(joint, sizings, scenario.system)
        sizings[joint] = replace(sizing, remarks=(*describe_cycle(sizing, times.step), *coupling))
    return SizedRun(sizings, scenario.name, examination, signals, change, draws)


class _LastRows(TimeSeries):
    """Keeps the rows from a time in s on."""

    def __init__(self, start: float) -> None:
        self._start = start - 1e-9

    def append(self, rows: Vector) -> None:
        """Keep a copy of the rows that are late enough."""
        super().append(rows[rows[:, 0] >= self._start])
