"""The plan of a run: what follows from its options alone, before any FMU is used."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..base.errors import CommandError
from ..base.wording import find_names, select_names
from ..inputs.stored_runs import StoredRun, open_stored_run
from ..master.algorithms.algorithm import Algorithm
from ..master.run_loop import Pacing
from ..master.stepping.step_size_control import StepSizeControl
from ..master.stepping.timing import MAXIMUM_STEPS, CommunicationPoints, make_communication_points
from ..system.model import System
from .options import Options
from .origin import RunOrigin
from .requirements import Requirement, parse_requirement
from .stored_margins import read_margins

DEFAULT_INTERVAL = 1e-3
"""Default time between rows of a table in s."""

FEW_ROWS, MANY_ROWS = 10, 100
"""A run shorter than so many default intervals has about so many rows, or one per step."""


@dataclass(frozen=True)
class RunPlan:
    """What follows from the options of a run.

    Attributes:
        options: Values of all options.
        times: Communication points.
        steps_per_row: Every n-th communication point has a row in tables.
        algorithm: The algorithm, before its `setup`.
        control: The step-size control.
        pacing: Limit of the speed; None without one.
        requirements: Conditions of `require`.
        stored: The run of the option `reference`.
        margins: The stability margins of the option `margins`.
        notes: Notes to read before the run, without full stops.
        origin: The scenario, and the options set for it.
        recorded: Signals to keep in the table; without any, the run chooses some.
        conditions: Conditions of `stop_when`, with full names.
    """

    options: Options
    times: CommunicationPoints
    steps_per_row: int
    algorithm: Algorithm
    control: StepSizeControl
    pacing: Pacing | None
    requirements: Sequence[Requirement]
    stored: StoredRun | None
    margins: Mapping[str, Any] | None
    notes: Sequence[str]
    origin: RunOrigin = field(default_factory=RunOrigin)
    recorded: Sequence[str] = ()
    conditions: Sequence[Requirement] = ()


def plan_run(options: Options, name: str, notes: Sequence[str] = ()) -> RunPlan:
    """Return the plan of a run, as far as it needs no names of signals.

    Args:
        options: Values of all options.
        name: Name of the scenario.
        notes: Notes on the scenario.

    Raises:
        CommandError: An option is wrong, or a file cannot be read.
    """
    times = run_times(options, name)
    stored = None
    steps_per_row, algorithm = count_steps_per_row(options, times), options.make_algorithm()
    control = options.make_step_size_control()
    requirements = [parse_requirement(text) for text in options.require]
    if options.reference is not None:
        stored = open_stored_run(options.reference, start=times.start)
        notes = [*notes, *stored.notes]
    margins = read_margins(options.margins) if options.margins is not None else None
    pacing = Pacing(options.real_time) if options.real_time is not None else None
    return RunPlan(
        options, times, steps_per_row, algorithm, control, pacing, requirements, stored, margins, notes
    )


def run_times(options: Options, name: str) -> CommunicationPoints:
    """Return the communication points. Raise CommandError if the stop time or the step size is missing."""
    if options.stop_time is None:
        raise CommandError(f"'{name}' has no stop time; set --stop-time.")
    if options.step_size is None:
        raise CommandError(f"'{name}' has no step size; set --step-size.")
    return make_communication_points(options.stop_time, options.step_size, options.start_time or 0.0)


def describe_times(options: Options) -> list[str]:
    """Return start, stop and step size of runs as short texts, as far as they are set."""
    facts = list[str]()
    if options.stop_time is not None:
        facts.append(f"{options.start_time or 0.0:g} s to {options.stop_time:g} s")
    if options.step_size is not None:
        facts.append(f"step {options.step_size:g} s")
    return facts


def count_steps_per_row(options: Options, times: CommunicationPoints) -> int:
    """Return the number of fixed steps per output interval.

    The default interval is 1 ms, a step that is longer, or a fraction of a run that is short.

    Raises:
        CommandError: If the interval is not a whole number of steps.
    """
    interval = options.output_interval
    row_interval = max(DEFAULT_INTERVAL, times.step) if interval is None else interval
    if not 0.0 < row_interval < float("inf"):
        raise CommandError(f"the output interval {row_interval:g} s must be positive and finite.")
    if (times.stop - times.start) / row_interval > MAXIMUM_STEPS:
        raise CommandError(
            f"an output interval of {row_interval:g} s makes more than {MAXIMUM_STEPS:g} rows."
        )
    if not options.make_step_size_control().is_regular:
        return 1  # the control makes steps that end at the rows
    if _is_short(options, times):
        return max(times.steps // MANY_ROWS, 1)
    steps = round(min(row_interval / times.step, 1e18))  # the quotient may be infinite
    # decimal fractions such as 1e-4 are not exact in binary
    if steps >= 1 and abs(steps * times.step - row_interval) <= 1e-9 * row_interval:
        return steps
    if interval is None:
        return max(steps, 1)
    raise CommandError(
        f"the output interval {row_interval:g} s is not a whole number of steps of {times.step:g} s."
    )


def describe_interval(plan: RunPlan) -> list[str]:
    """Return a remark on the distance of rows, if the run is too short for the default one."""
    if not (_is_short(plan.options, plan.times) and plan.control.is_regular):
        return []
    distance = (
        f"every {plan.steps_per_row * plan.times.step:g} s" if plan.steps_per_row > 1 else "after each step"
    )
    return [f"the run is short: its rows are {distance}, not every 1 ms (--output-interval)."]


def _is_short(options: Options, times: CommunicationPoints) -> bool:
    """Return whether a run would have few rows at the default interval, although its steps are shorter."""
    is_brief = times.stop - times.start < (FEW_ROWS - 0.5) * DEFAULT_INTERVAL
    return options.output_interval is None and is_brief and times.steps > 0 and times.step < DEFAULT_INTERVAL


def select_signals(
    patterns: Sequence[str], names: Sequence[str], further: Collection[str] = (), main: str = ""
) -> list[str]:
    """Return the signals to keep, in the order of `names`, then of `further`.

    Args:
        patterns: names or patterns of signals. Without one, all `names` are kept.
        names: outputs.
        further: other variables. A name or pattern selects them if it matches no output.
        main: component whose variables need no component's name; empty without one.

    Raises:
        CommandError: a pattern has no match.
    """
    if not patterns:
        return list(names)
    of_outputs = [p for p in patterns if p not in further and find_names(p, names, main)]
    variable_patterns = [p for p in patterns if p not in of_outputs]
    outputs = {*select_names(of_outputs, names, "signal", main)}
    candidates = [*further, *names] if variable_patterns else []  # a similar name may be among both
    hint = "without --signals, all outputs are kept."
    rest = {*select_names(variable_patterns, candidates, "signal", main, hint)}
    return [n for n in names if n in outputs] + [n for n in candidates if n in rest]


def select_components(patterns: Sequence[str], system: System, otherwise: str) -> list[str]:
    """Return the components that match patterns of an option, in the order of the system.

    Args:
        patterns: Names or patterns of components.
        system: The system.
        otherwise: What an error message says if no name is similar.

    Raises:
        CommandError: A pattern has no match.
    """
    names = [c.name for c in system.components]
    selected = {*select_names(patterns, names, "component", hint=otherwise)}
    return [name for name in names if name in selected]
