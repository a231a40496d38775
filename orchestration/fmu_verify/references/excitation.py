"""Generate inputs that excite an FMU within its declared ranges."""

import math
from collections.abc import Callable

import numpy as np
from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector
from emla_cosim.fmu.elements import number_range

from ..host.experiment import parse_number, read_limits
from ..subject import Subject


def _steps(phase: Vector, number: int) -> Vector:
    """Step up, back, down and back, at different times for each input."""
    levels = np.array([0.0, 1.0, 0.0, -1.0])
    return levels[np.floor(4.0 * phase * (1.0 + 0.25 * (number % 4))).astype(int) % 4]


def _ramps(phase: Vector, number: int) -> Vector:
    """Ramp up, down and back, with different slopes for each input."""
    turns = (1.0 + 0.25 * (number % 4)) * phase
    return 2.0 * np.abs(2.0 * ((turns - 0.25) % 1.0) - 1.0) - 1.0


def _chirps(phase: Vector, number: int) -> Vector:
    """Sweep a sine from 1 to at least 10 periods per run."""
    last = 10.0 + 2.0 * (number % 4)
    return np.sin(2.0 * math.pi * (phase + 0.5 * (last - 1.0) * phase**2))


SHAPES: dict[str, Callable[[Vector, int], Vector]] = {"steps": _steps, "ramps": _ramps, "chirps": _chirps}
"""Shapes by name: functions of the phase (0 to 1) and the input's number, with values from -1 to 1."""


def excite_inputs(subject: Subject, shape: str, times: Vector) -> dict[str, Vector]:
    """Return columns for all numeric inputs, `time` in s first, within their ranges.

    Reals move by a quarter of their range around its middle, or else by a tenth of the nominal value
    around the start value. Integers, enumerations and Booleans take their allowed values.
    """
    phase = (times - times[0]) / (times[-1] - times[0])
    columns = {"time": times}
    inputs = [v for v in subject.description.modelVariables if v.causality == "input" and v.type != "String"]
    for index, variable in enumerate(inputs):
        columns[variable.name] = _excite(variable, SHAPES[shape](phase, index))
    return columns


def _excite(variable: ModelVariable, wave: Vector) -> Vector:
    if variable.type == "Boolean":
        return (wave > 0.5).astype(float)
    low, high = read_limits(variable)
    start = parse_number(variable.start, 0.0)
    if variable.type == "Enumeration" and variable.declaredType is not None:
        values = [int(str(item.value)) for item in variable.declaredType.items or []]
        low, high = (float(min(values)), float(max(values))) if values else (start, start)
    bounded = math.isfinite(low) and math.isfinite(high)
    middle = 0.5 * (low + high) if bounded else start
    width = 0.25 * (high - low) if bounded else 0.1 * abs(parse_number(variable.nominal, start or 1.0))
    if variable.type == "Integer":
        width = max(width, 1.0)  # less would be rounded to nothing
    wave = np.clip(middle + width * wave, low, high)
    return wave if variable.type == "Real" else np.round(np.clip(wave, *number_range(variable)))
