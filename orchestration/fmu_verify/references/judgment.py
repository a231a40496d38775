"""Run an FMU along a reference, and judge runs by tubes around their references."""

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector
from emla_cosim.base.errors import CommandError
from emla_cosim.base.tolerances import (
    Comparison,
    compare_signal,
    describe_departure,
    find_tolerance,
    select_outside,
)
from emla_cosim.fmu.variables import convert_start_values

from ..check import CheckOutcome, Verdict, failed, passed, skipped
from ..host.experiment import Experiment, OutputTrajectory, list_outputs, read_span, step_instance
from ..host.hosted_instance import HostedInstance
from ..subject import Subject
from .reference_files import ReferenceSolution


def check_columns(subject: Subject, reference: ReferenceSolution) -> None:
    """Raise CommandError if a reference has a column that is not a variable of the FMU."""
    unknown = [n for n in reference.solution if n != "time" and n not in subject.variables]
    if unknown:
        raise CommandError(f"the reference has the column '{unknown[0]}', but the FMU has no such variable.")


def judge_run(
    subject: Subject, reference: ReferenceSolution, trajectory: OutputTrajectory, is_experiment: bool = False
) -> CheckOutcome:
    """Compare all columns of a reference with the run along it.

    A tolerance with a folder of references is for these: experiments in the FMU have other references.
    """
    tolerances = dict(reference.tolerance)
    if not (is_experiment and subject.settings.reference is not None):
        tolerances |= subject.settings.tolerance
    comparisons = tuple(
        compare_signal(
            name,
            str(subject.interface.unit(name) or ""),
            trajectory.times,
            trajectory.values[:, i],
            reference.solution["time"],
            reference.solution[name],
            find_tolerance(name, tolerances),
            subject.interface.is_discrete(name),
        )
        for i, name in enumerate(trajectory.names)
        if name in reference.solution
    )
    departures = select_outside(comparisons)
    if departures:
        more = (*(describe_departure(c) + "." for c in departures[1:]), *reference.notes)
        return failed(f"{describe_departure(departures[0])}.", details=more, comparisons=comparisons)
    if not comparisons:
        return failed("The reference has only the column time.")
    closest = max(comparisons, key=_compute_tolerance_share)
    return passed(
        f"{len(comparisons)} signals stay within their tubes; {closest.signal} comes closest to its limit, "
        f"with {_compute_tolerance_share(closest):.0%} of the tolerance.",
        details=tuple(reference.notes),
        comparisons=comparisons,
    )


def _compute_tolerance_share(comparison: Comparison) -> float:
    """Return the largest difference as a fraction of the tolerance."""
    return comparison.worst / comparison.tube.value if comparison.tube.value else 0.0


_ORDER = (Verdict.FAILED, Verdict.WARNING, Verdict.PASSED, Verdict.SKIPPED)


def combine_outcomes(outcomes: Mapping[str, CheckOutcome], missing: str) -> CheckOutcome:
    """Return the worst of several outcomes, with a line for each of the others.

    Args:
        outcomes: Outcomes by what they are of, such as `The result a.csv`.
        missing: Message if there are none.
    """
    if not outcomes:
        return skipped(missing)
    labels = sorted(outcomes, key=lambda label: _ORDER.index(outcomes[label].verdict))
    first = outcomes[labels[0]]
    lines = {label: f"{label}: {outcomes[label].sentence}" for label in labels}
    return CheckOutcome(
        first.verdict,
        lines[labels[0]],
        details=(
            *(lines.values() if len(labels) > 1 else ()),
            *(line for label in labels for line in outcomes[label].details),
        ),
        comparisons=tuple(c for o in outcomes.values() if o.verdict == Verdict.FAILED for c in o.comparisons),
        figures={"compared": sum(len(o.comparisons) for o in outcomes.values())},
        hint=first.hint,
        clause=first.clause,
        gaps=tuple(f"{label}: {gap}" for label in labels for gap in outcomes[label].gaps),
    )


_STEPS_PER_CHECK = 10
"""Steps between two looks at the clock."""

_TIME_TOLERANCE = 1e-6
"""Tolerance for equal times, relative to a step."""


def build_course(subject: Subject, reference: ReferenceSolution) -> Experiment:
    """Return the communication points of a reference and its inputs. Raise CommandError on a mismatch."""
    intervals = np.diff(np.unique(reference.solution["time"]))
    step = reference.step or min(read_span(subject)[1], float(intervals.min(initial=np.inf)))
    count = round((reference.stop - reference.start) / step)
    if count < 1 or abs(reference.start + count * step - reference.stop) > 1e-3 * step:
        raise CommandError(
            f"the reference covers {reference.start:g} s to {reference.stop:g} s, which is not a whole "
            f"number of steps of {step:g} s."
        )
    times = np.asarray(reference.start + step * np.arange(count + 1), dtype=np.float64)
    return Experiment(times, sample_inputs(subject, reference.inputs, times))


def sample_inputs(subject: Subject, columns: Mapping[str, Vector], times: Vector) -> dict[str, Vector]:
    """Return the input columns at these times in s. Raise CommandError if a column is not an input.

    Continuous inputs are linear between rows. Others hold the value of the last row, and have the type of
    their variable. Of rows at the same time, which are an event, the last one counts.
    """
    inputs = {}
    for name, values in columns.items():
        variable = subject.variables.get(name)
        if name == "time":
            continue
        if variable is None or variable.causality != "input":
            raise CommandError(f"the inputs have the column '{name}', but the FMU has no such input.")
        inputs[name] = _sample_input(variable, columns["time"], values, times)
    return inputs


def run_reference(
    subject: Subject, reference: ReferenceSolution, until: float = math.inf
) -> OutputTrajectory:
    """Run the FMU along a reference. Return the columns of the reference, at its output interval.

    Without columns, return all outputs. The run is shorter if the FMU asks to end it, or if time is up.

    Args:
        subject: The FMU.
        reference: How to run it.
        until: The time of `time.monotonic()` at which to end the run, in s.

    Raises:
        CallError: A call failed.
        CommandError: The reference does not match the FMU.
    """
    course = build_course(subject, reference)
    instance = HostedInstance(subject)
    values = convert_values_by_name(subject, reference.start_values) | course.at(0)
    tolerance = reference.solver_tolerance or subject.interface.tolerance
    instance.begin_initialization(reference.start, reference.stop, tolerance, lambda: instance.set(values))
    instance.exit_initialization()
    names = [n for n in reference.solution if n != "time" and n in subject.variables] or list_outputs(subject)
    part = step_instance(instance, course, 0, 0, names)
    rows, step_count, count = [part.values], 0, len(course.times) - 1
    while step_count < count and not instance.terminated and time.monotonic() < until:
        part = step_instance(instance, course, step_count, min(step_count + _STEPS_PER_CHECK, count), names)
        rows.append(part.values[1:])
        step_count += len(part.values) - 1
    instance.close()
    steps_per_row = max(1, round((reference.interval or 0.0) / course.step))
    times = course.times[: step_count + 1 : steps_per_row]
    return OutputTrajectory(times, names, np.concatenate(rows)[::steps_per_row])


def convert_values_by_name(subject: Subject, values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert start values to the types of their variables. Raise CommandError for invalid ones."""
    typed = convert_start_values(subject.path.stem, subject.interface, values)
    return {str(variable.name): value for variable, value in typed}


def _sample_input(variable: ModelVariable, rows: Vector, values: Vector, times: Vector) -> Vector:
    """Return the values of an input at `times`, from its values at the times `rows`."""
    ahead = _TIME_TOLERANCE * float(times[1] - times[0])
    # of rows at the same time, which are an event, the last one counts
    last = np.maximum(np.searchsorted(rows, times + ahead, side="right") - 1, 0)
    if variable.type == "Real" and variable.variability in (None, "continuous"):
        at_event = (np.abs(rows[last] - times) <= ahead) & (rows[np.maximum(last - 1, 0)] == rows[last])
        return np.where(at_event & (last > 0), values[last], np.interp(times, rows, values))
    types = {"Real": np.float64, "Boolean": np.bool_}
    return values[last].astype(types.get(str(variable.type), np.int64))
