"""The experiment for dynamic checks: communication points, and inputs that vary within their ranges."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector

from ..subject import Subject

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
