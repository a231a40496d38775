"""An instance taken through an experiment, and what it gave."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Vector
from ..subject import Subject
from .experiment import Experiment
from .instance import Instance

NUMERIC = ("Real", "Integer", "Boolean", "Enumeration")


@dataclass(frozen=True)
class Trajectory:
    """Values of outputs at communication points: a row for each of `times`, a column for each name."""

    times: Vector
    names: list[str]
    values: Vector

    def same(self, other: "Trajectory") -> bool:
        """Whether both are the same to the last bit."""
        return self.values.tobytes() == other.values.tobytes()

    def first_difference(self, other: "Trajectory") -> tuple[str, float]:
        """Name and time in s of the first value that is not the same to the last bit."""
        differs = self.values.view(np.int64) != other.values.view(np.int64)
        k = int(np.argmax(differs.any(axis=1)))
        return self.names[int(np.argmax(differs[k]))], float(self.times[k])


def outputs(subject: Subject) -> list[str]:
    """Names of all outputs that are numbers."""
    found = subject.description.modelVariables
    return [v.name for v in found if v.causality == "output" and v.type in NUMERIC]


def driven(instance: Instance, experiment: Experiment) -> Trajectory:
    """Initialize an instance with the first inputs, and take it through an experiment."""
    instance.initialize(experiment.at(0), float(experiment.times[0]), None)
    return stepped(instance, experiment)


def stepped(
    instance: Instance, experiment: Experiment, first: int = 0, names: list[str] | None = None
) -> Trajectory:
    """Take an instance that is at the communication point `first` on to the end of an experiment.

    `names` are the variables to read, by default all outputs.
    """
    names = outputs(instance.subject) if names is None else names
    rows: list[list[Any]] = [instance.get(names)]
    for k in range(first, len(experiment.times) - 1):
        instance.set(experiment.at(k))
        instance.step(float(experiment.times[k]), experiment.step)
        rows.append(instance.get(names))
    return Trajectory(experiment.times[first:], names, np.array(rows, dtype=float))
