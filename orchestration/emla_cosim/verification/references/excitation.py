"""Inputs that shake an FMU within the ranges that it declares."""

import math
from collections.abc import Callable

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ..host.experiment import parse_number
from ..subject import Subject


def _steps(phase: Vector, number: int) -> Vector:
    """Up, back, down and back, each input at times of its own."""
    levels = np.array([0.0, 1.0, 0.0, -1.0])
    return levels[np.floor(4.0 * phase * (1.0 + 0.25 * (number % 4))).astype(int) % 4]


def _ramps(phase: Vector, number: int) -> Vector:
    """Up, down and back, with slopes of each input's own."""
    turns = (1.0 + 0.25 * (number % 4)) * phase
    return 2.0 * np.abs(2.0 * ((turns - 0.25) % 1.0) - 1.0) - 1.0


def _chirps(phase: Vector, number: int) -> Vector:
    """Sines that become quicker, from one to ten and more periods."""
    last = 10.0 + 2.0 * (number % 4)
    return np.sin(2.0 * math.pi * (phase + 0.5 * (last - 1.0) * phase**2))


SHAPES: dict[str, Callable[[Vector, int], Vector]] = {"steps": _steps, "ramps": _ramps, "chirps": _chirps}
"""What inputs can do, by name: values from -1 to 1 over a run, from 0 to 1, for the input of a number."""


def excite_inputs(subject: Subject, shape: str, times: Vector) -> dict[str, Vector]:
    """Columns of all inputs that are numbers, `time` in s first, within their ranges.

    Reals move by a quarter of their range around its middle, or by a tenth of what is nominal around
    the start value; whole numbers and truths take the values that they may have.
    """
    phase = (times - times[0]) / (times[-1] - times[0])
    found = {"time": times}
    inputs = [v for v in subject.description.modelVariables if v.causality == "input" and v.type != "String"]
    for index, variable in enumerate(inputs):
        found[variable.name] = _moved(variable, SHAPES[shape](phase, index))
    return found


def _moved(variable: ModelVariable, wave: Vector) -> Vector:
    if variable.type == "Boolean":
        return (wave > 0.5).astype(float)
    low, high = parse_number(variable.min, -math.inf), parse_number(variable.max, math.inf)
    start = parse_number(variable.start, 0.0)
    if variable.type == "Enumeration" and variable.declaredType is not None:
        values = [int(str(item.value)) for item in variable.declaredType.items or []]
        low, high = (float(min(values)), float(max(values))) if values else (start, start)
    bounded = math.isfinite(low) and math.isfinite(high)
    middle = 0.5 * (low + high) if bounded else start
    width = 0.25 * (high - low) if bounded else 0.1 * abs(parse_number(variable.nominal, start or 1.0))
    found = np.clip(middle + width * wave, low, high)
    return found if variable.type == "Real" else np.round(found)
