"""Run an FMU with the inputs, start values and times of a reference."""

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector
from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.variables import convert_start_values

from ..host.experiment import Experiment, read_span
from ..host.hosted_instance import HostedInstance
from ..host.instance_runs import OutputTrajectory, list_outputs, step_instance
from ..subject import Subject
from .reference_files import ReferenceSolution

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
        inputs[name] = _sample(variable, columns["time"], values, times)
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
    values = read_start_values(subject, reference.start_values) | course.at(0)
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


def read_start_values(subject: Subject, values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert start values to the types of their variables. Raise CommandError for invalid ones."""
    typed = convert_start_values(subject.path.stem, subject.interface, values)
    return {str(variable.name): value for variable, value in typed}


def _sample(variable: ModelVariable, rows: Vector, values: Vector, times: Vector) -> Vector:
    ahead = _TIME_TOLERANCE * float(times[1] - times[0])
    # of rows at the same time, which are an event, the last one counts
    last = np.maximum(np.searchsorted(rows, times + ahead, side="right") - 1, 0)
    if variable.type == "Real" and variable.variability in (None, "continuous"):
        at_event = (np.abs(rows[last] - times) <= ahead) & (rows[np.maximum(last - 1, 0)] == rows[last])
        return np.where(at_event & (last > 0), values[last], np.interp(times, rows, values))
    types = {"Real": np.float64, "Boolean": np.bool_}
    return values[last].astype(types.get(str(variable.type), np.int64))
