"""The experiment for dynamic checks, and its runs: communication points, inputs, outputs."""

import hashlib
import math
import pickle
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector

from ..subject import Subject
from ..subprocess_run import in_fresh_process
from .hosted_instance import HostedInstance

MOST_STEPS = 100
"""Most steps of one run. References reveal later problems."""


# most values that one run exchanges, but for the fewest steps: FMUs with many variables run for fewer
_MOST_VALUES = 100_000

FEWEST_STEPS = 5
"""Fewest steps of a run of an FMU that is slow or has many variables."""


@dataclass(frozen=True)
class Experiment:
    """Communication points in s, and the values of the inputs at each of them."""

    times: Vector
    inputs: dict[str, Vector]

    @property
    def step(self) -> float:
        """The communication step in s."""
        return float(self.times[1] - self.times[0])

    def at(self, k: int) -> dict[str, Any]:
        """Return the inputs by name at communication point `k`, in the types of their columns."""
        return {name: values[k].item() for name, values in self.inputs.items()}


def make_experiment(subject: Subject, steps: int = MOST_STEPS) -> Experiment:
    """Return the first steps of the FMU's default experiment, at most `steps`."""
    start, step, count = read_span(subject)
    inputs = subject.of_causality("input")
    most = _MOST_VALUES // (len(inputs) + len(subject.of_causality("output")) or 1)
    times = start + step * np.arange(min(steps, count, subject.most_steps, max(most, FEWEST_STEPS)) + 1.0)
    return Experiment(times, {v.name: _vary_input(v, i, times) for i, v in enumerate(inputs)})


def read_span(subject: Subject) -> tuple[float, float, int]:
    """Return the start and step in s, and the number of steps, of the FMU's default experiment."""
    default = subject.description.defaultExperiment
    start = parse_number(default.startTime if default else None, 0.0)
    stop = parse_number(default.stopTime if default else None, start + 1.0)
    # a run needs some length
    stop = stop if stop > start else start + 1.0
    step = parse_number(default.stepSize if default else None, (stop - start) / MOST_STEPS)
    # steps that are missing, or make no sense, become a hundredth of the run
    step = step if 0.0 < step <= stop - start else (stop - start) / MOST_STEPS
    solver = subject.tree.find("CoSimulation") if subject.version == 3 else None
    internal = 0.0 if solver is None else parse_number(solver.get("fixedInternalStepSize"), 0.0)
    if 0.0 < internal <= stop - start:  # the FMU is at its end only after whole steps of its own
        multiple = max(1, round(step / internal)) * internal
        step = step if math.isclose(step, multiple, rel_tol=1e-9) else multiple
    return start, step, max(1, round((stop - start) / step))


def _vary_input(variable: ModelVariable, index: int, times: Vector) -> Vector:
    """Return a sine around the start value, a tenth of the range wide, with a different period per input."""
    middle = parse_number(variable.start, 0.0)
    low, high = read_limits(variable)
    typical = abs(parse_number(variable.nominal, middle or 1.0))
    width = 0.1 * (high - low if math.isfinite(high - low) else typical)
    periods = 2.0 + 0.5 * (index % 7)
    phase = 2.0 * np.pi * periods * (times - times[0]) / (times[-1] - times[0])
    return np.clip(middle + width * np.sin(phase), low, high)


def read_limits(variable: ModelVariable) -> tuple[float, float]:
    """Return min and max of a variable or its declared type, infinite if there are none."""
    declared = variable.declaredType
    ends = [
        getattr(variable, name) if getattr(variable, name) is not None else getattr(declared, name, None)
        for name in ("min", "max")
    ]
    return parse_number(ends[0], -math.inf), parse_number(ends[1], math.inf)


def parse_number(value: Any, otherwise: float) -> float:
    """Convert an attribute to a number; return `otherwise` if it is not finite."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return otherwise
    return number if math.isfinite(number) else otherwise


NUMERIC = ("Real", "Integer", "Boolean", "Enumeration")
"""Types whose values are read as numbers."""


@dataclass(frozen=True)
class OutputTrajectory:
    """Values of outputs at communication points: a row for each of `times`, a column for each name.

    It is shorter than its experiment if the FMU asked to end the run.
    """

    times: Vector
    names: list[str]
    values: Vector

    def has_same_values(self, other: "OutputTrajectory") -> bool:
        """Return whether the values of both are bitwise equal."""
        # NaN is the same as NaN here, but 0 is not -0
        return self.values.tobytes() == other.values.tobytes()

    def find_first_difference(self, other: "OutputTrajectory") -> tuple[str, float]:
        """Return the output and the time in s of the first value that is not bitwise equal.

        "the end of the run" and the last common time if all rows are equal that both have.
        """
        rows = min(len(self.times), len(other.times))
        # bits of NaN are equal, although NaN is not
        differs = self.values[:rows].view(np.int64) != other.values[:rows].view(np.int64)
        if not differs.any():
            return "the end of the run", float(self.times[rows - 1])
        k = int(np.argmax(differs.any(axis=1)))
        return self.names[int(np.argmax(differs[k]))], float(self.times[k])

    def describe(self, wrong: "np.ndarray[Any, np.dtype[np.bool_]]") -> str:
        """Return the first of the values that a mask selects: `x is nan at t = 1 s.`"""
        k = int(np.argmax(wrong.any(axis=1)))
        name, value = self.names[int(np.argmax(wrong[k]))], self.values[k][wrong[k]][0]
        return f"{name} is {value} at t = {self.times[k]:.9g} s."

    def take_rows(self, rows: int) -> "OutputTrajectory":
        """Return the first rows, as a trajectory."""
        return OutputTrajectory(self.times[:rows], self.names, self.values[:rows])

    def distance(self, other: "OutputTrajectory") -> Vector:
        """Return the largest difference of each output, relative to its range in both runs.

        The distance of NaN to anything but NaN is infinite. So is that of runs of different length.
        """
        if len(self.times) != len(other.times):
            return np.full(len(self.names), np.inf)
        all_values = np.concatenate([self.values, other.values])
        with np.errstate(invalid="ignore", over="ignore"):
            finite_values = np.where(np.isfinite(all_values), all_values, 0.0)
            # an output that hardly moves is scaled by its magnitude
            scale = np.maximum(np.ptp(finite_values, axis=0), 1e-6 * np.abs(finite_values).max(axis=0))
            deviation = np.abs(self.values - other.values)
            deviation[self.values == other.values] = 0.0
            deviation[np.isnan(self.values) & np.isnan(other.values)] = 0.0
            deviation[np.isnan(deviation)] = np.inf
            return deviation.max(axis=0) / np.where(scale > 0.0, scale, 1.0)


def list_outputs(subject: Subject) -> list[str]:
    """Return the names of all outputs that are numbers, Booleans or Enumerations."""
    variables = subject.description.modelVariables
    return [v.name for v in variables if v.causality == "output" and v.type in NUMERIC]


def run_instance(instance: HostedInstance, course: Experiment) -> OutputTrajectory:
    """Initialize an instance with the first inputs and run it through an experiment."""
    instance.initialize(course.at(0), float(course.times[0]), None)
    return step_instance(instance, course)


def step_instance(
    instance: HostedInstance,
    course: Experiment,
    first: int = 0,
    last: int | None = None,
    names: list[str] | None = None,
    until: float = math.inf,
) -> OutputTrajectory:
    """Step an instance from the communication point `first` to `last`; default: to the end.

    `names` are the variables to read; default: all outputs. No step but the first begins after
    `time.monotonic()` has reached `until`.
    """
    names = list_outputs(instance.subject) if names is None else names
    rows: list[list[Any]] = [instance.get(names)]
    steps = range(first, len(course.times) - 1 if last is None else last)
    for k in steps if not instance.terminated else ():
        instance.set(course.at(k))
        instance.step(float(course.times[k]), course.step)
        if instance.terminated:
            break  # before the end of the step
        rows.append(instance.get(names))
        if time.monotonic() > until:
            break
    times = course.times[first : first + len(rows)]
    return OutputTrajectory(times, names, np.array(rows, dtype=float).reshape(len(rows), len(names)))


def run_alone(
    subject: Subject, course: Experiment | None = None, kind: str | None = None
) -> OutputTrajectory:
    """Run an instance in its own process, or return the same run of an earlier check."""
    course = course or make_experiment(subject)
    kind = kind or subject.kinds[0]
    if (trajectory := find_run(subject, course, kind)) is None:
        trajectory = in_fresh_process(_run_completely, subject, course, kind)
        keep_run(subject, course, kind, trajectory)
    return trajectory


def read_end_of_run(subject: Subject) -> float:
    """Return when `run_alone` of the default experiment ended, in s since 1970."""
    return _find_run_path(subject, make_experiment(subject), subject.kinds[0]).stat().st_mtime


def find_run(subject: Subject, course: Experiment, name: str) -> OutputTrajectory | None:
    """Return what `keep_run` kept; None if there is nothing."""
    with suppress(OSError):
        return pickle.loads(_find_run_path(subject, course, name).read_bytes())
    return None


def keep_run(subject: Subject, course: Experiment, name: str, trajectory: OutputTrajectory) -> None:
    """Keep a run for later checks. The name is the kind if it is one that `run_alone` would do."""
    path = _find_run_path(subject, course, name)
    path.parent.mkdir(exist_ok=True)
    part = path.with_suffix(".part")  # a check that is ended meanwhile leaves no half of it
    part.write_bytes(pickle.dumps(trajectory))
    part.replace(path)


def _find_run_path(subject: Subject, course: Experiment, name: str) -> Path:
    sum_ = hashlib.sha256(pickle.dumps((name, course)))
    return subject.scratch / "runs" / sum_.hexdigest()


def _run_completely(subject: Subject, course: Experiment, kind: str) -> OutputTrajectory:
    return run_instance(HostedInstance(subject, kind=kind), course)


def step_through(
    instance: HostedInstance,
    times: Iterable[float],
    step: float,
    prepare: Callable[[int], object] = lambda _: None,
) -> Iterator[int]:
    """Step an instance from each of these times in s, and yield the number of steps that it has made.

    `prepare` gets the number of a step, from 0, before it. The walk ends early if the FMU asks for it.
    """
    for k, start in enumerate(times):
        prepare(k)
        instance.step(float(start), step)
        if instance.terminated:
            return
        yield k + 1


def take_in_time(items: Iterable[Any], seconds: float) -> Iterator[Any]:
    """Yield items until a time in s has passed, counted from the first one: a slow FMU is not a fault."""
    until = time.monotonic() + seconds
    for item in items:
        if time.monotonic() > until:
            return
        yield item
