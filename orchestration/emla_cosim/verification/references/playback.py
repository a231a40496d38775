"""An FMU run along a reference: the same inputs, start values and times."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...fmu.variables import convert_start_values
from ..host.experiment import Experiment, span
from ..host.hosted_instance import HostedInstance
from ..host.instance_runs import OutputTrajectory, step_instance
from ..subject import Subject
from .reference_files import ReferenceSolution

_SLIVER = 1e-6
"""Of a step: how far times may be off that are meant to be the same."""


def build_course(subject: Subject, reference: ReferenceSolution) -> Experiment:
    """The communication points of a reference, and its inputs there; CommandError where they do not fit."""
    step = reference.step or min(span(subject)[1], _interval(reference))
    count = round((reference.stop - reference.start) / step)
    if count < 1 or abs(reference.start + count * step - reference.stop) > 1e-3 * step:
        raise CommandError(
            f"the reference goes from {reference.start:g} s to {reference.stop:g} s, which are no whole "
            f"number of steps of {step:g} s."
        )
    times = np.asarray(reference.start + step * np.arange(count + 1), dtype=np.float64)
    return Experiment(times, inputs_at(subject, reference.inputs, times))


def inputs_at(subject: Subject, columns: Mapping[str, Vector], times: Vector) -> dict[str, Vector]:
    """Columns of inputs at these times in s; CommandError for one that is no input of the FMU.

    Continuous ones are linear between rows, others hold what the last row says.
    """
    found = {}
    for name, values in columns.items():
        variable = subject.variables.get(name)
        if name == "time":
            continue
        if variable is None or variable.causality != "input":
            raise CommandError(f"the inputs have the column '{name}', which is no input of the FMU.")
        found[name] = _sampled(variable, columns["time"], values, times)
    return found


def run_reference(subject: Subject, reference: ReferenceSolution) -> OutputTrajectory:
    """What the FMU gives for the columns of a reference that it has, at the latter's intervals.

    Raises CallError, CommandError.
    """
    along = build_course(subject, reference)
    instance = HostedInstance(subject)
    values = read_start_values(subject, reference.start_values) | along.at(0)
    instance.initialize(values, reference.start, reference.stop)
    names = [n for n in reference.solution if n in subject.variables]
    found = step_instance(instance, along, names=names)
    instance.close()
    every = max(1, round((reference.interval or 0.0) / along.step))
    return OutputTrajectory(found.times[::every], found.names, found.values[::every])


def read_start_values(subject: Subject, given: Mapping[str, Any]) -> dict[str, Any]:
    """Start values of their variables' types; CommandError for what cannot be set."""
    typed = convert_start_values(subject.path.stem, subject.interface, given)
    return {str(variable.name): value for variable, value in typed}


def _interval(reference: ReferenceSolution) -> float:
    intervals = np.diff(np.unique(reference.solution["time"]))
    return float(intervals.min()) if len(intervals) else np.inf


def _sampled(variable: ModelVariable, rows: Vector, values: Vector, times: Vector) -> Vector:
    if variable.type == "Real" and variable.variability in (None, "continuous"):
        return np.interp(times, rows, values)
    ahead = _SLIVER * float(times[1] - times[0])
    return values[np.maximum(np.searchsorted(rows, times + ahead, side="right") - 1, 0)]
