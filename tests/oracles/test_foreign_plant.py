"""A plant from another tool does what the built-in one does, so that it can replace it."""

import math
from collections.abc import Iterator, Sequence
from itertools import cycle, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.ssp.ssd import read_ssm

from emla_cosim.study.loading import load
from emla_fmu import EmlaPlant
from tests.support.paths import FOREIGN_MAPPING, FOREIGN_PLANT
from tests.support.sessions import Session, opened

TOLERANCE = 1e-9
"""Per largest value of an output; rounding makes 1e-13 of the fastest of them."""


class ForeignVariable(NamedTuple):
    """Their variable is `scale` times ours, plus `offset`."""

    name: str
    scale: float = 1.0
    offset: float = 0.0


def mapped() -> dict[str, ForeignVariable]:
    """Return their variables by ours, from the mapping and the units of their model description."""
    description = read_model_description(str(FOREIGN_PLANT))
    factors = {u.name: float(u.baseUnit.factor) for u in description.unitDefinitions if u.baseUnit}
    units = {v.name: v.unit for v in description.modelVariables}
    result = {}
    for entry in read_ssm(str(FOREIGN_MAPPING)).mappingEntries:
        linear, unit = entry.transformation, units[entry.target]
        scale = (float(linear.factor) if linear else 1.0) / (factors[unit] if unit else 1.0)
        result[entry.source] = ForeignVariable(entry.target, scale, float(linear.offset) if linear else 0.0)
    return result


ALL = mapped()
PLANT = EmlaPlant.layout()
OUTPUTS = {
    s.name: ALL[s.name]
    for s in PLANT.scalars
    if s.name in ALL and s.variable not in PLANT.inputs and s.variable not in PLANT.parameters
}
EVERYTHING = {
    "motor.L_d": 2.3e-3,
    "motor.L_q": 2.6e-3,
    "coupling.J_c": 2e-3,
    "gearbox.J_GB": 1e-3,
    "screw.B_BS": 400.0,
    "screw.C_eq": 80.0,
    "uncertainty.F_2": 0.3,
    "uncertainty.F_3": -0.2,
    "uncertainty.F_4": 0.1,
    "sensor.resolution": 1e-5,
    "sensor.sigma": 2e-5,
    "solver.internal_step": 3e-5,
    "start.x_L": 0.31,
    "v_L": 0.05,
    "i_q": 12.0,
    "i_d": -7.0,
}
"""What the study leaves at 0 or at its default, and axes that differ."""


@pytest.fixture
def foreign(foreign_plant: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(foreign_plant, tmp_path) as session:
        yield session


@pytest.fixture
def built_in(sessions: dict[str, Session]) -> Session:
    return sessions["EmlaPlant"]


# ---- both plants side by side ------------------------------------------------------------------


def study(joint: str) -> dict[str, Any]:
    """The start values of a joint's plant in the study, of what both plants have."""
    parameters = load("study").system.component(f"{joint}.plant").parameters
    return {name: value for name, value in parameters.items() if name in ALL}


def inputs(t: float, u_max: float) -> dict[str, float]:
    """Voltages that pass the inverter's limit for a part of the time, a load in both directions."""
    return {
        "u_q": u_max * (0.5 + 0.8 * math.sin(40.0 * t)),
        "u_d": -0.2 * u_max * math.cos(55.0 * t),
        "i_q_ref": 20.0 * math.sin(30.0 * t),
        "F_L": 6e3 * math.cos(25.0 * t),
        "d_2": 2.0 * math.sin(60.0 * t),
        "d_3": 5.0 * math.cos(33.0 * t),
        "d_4": 3.0 * math.sin(47.0 * t),
        "supply.sag": 0.3 * math.sin(35.0 * t) ** 2,
    }


def translated(values: dict[str, Any]) -> dict[str, Any]:
    """Values of our variables as values of theirs; what has no scale keeps its type."""
    result = {}
    for name, value in values.items():
        variable = ALL[name]
        exact = variable.scale == 1.0 and variable.offset == 0.0
        result[variable.name] = value if exact else variable.scale * value + variable.offset
    return result


def translated_outputs(foreign: Session, slave: FMU2Slave) -> list[float]:
    """Their outputs as values of ours."""
    values = foreign.get(slave, *(v.name for v in OUTPUTS.values()))
    return [(y - v.offset) / v.scale for y, v in zip(values, OUTPUTS.values(), strict=True)]


def both_outputs(
    built_in: Session, foreign: Session, start_values: dict[str, Any], steps: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """All outputs of both plants, a row for the start and one for every step."""
    u_max = start_values["inverter.u_max"]
    start = {**start_values, **inputs(0.0, u_max)}
    our_plant, their_plant = built_in.instance("test", **start), foreign.instance("test", **translated(start))

    def row() -> tuple[list[float], list[float]]:
        return built_in.get(our_plant, *OUTPUTS), translated_outputs(foreign, their_plant)

    time, rows = 0.0, [row()]
    for step in steps:
        values = inputs(time, u_max)
        built_in.set(our_plant, **values)
        foreign.set(their_plant, **translated(values))
        for plant in (our_plant, their_plant):
            plant.doStep(time, step)
        time += step
        rows.append(row())
    table = np.array(rows)
    return table[:, 0], table[:, 1]


def column(rows: np.ndarray, name: str) -> np.ndarray:
    return rows[:, list(OUTPUTS).index(name)]


def differences(actual: np.ndarray, expected: np.ndarray) -> dict[str, float]:
    """Largest difference of every output, per its largest value."""
    largest = np.abs(expected).max(axis=0)
    assert largest.min() > 0.0  # an output that stays 0 would not be compared
    return dict(zip(OUTPUTS, np.abs(actual - expected).max(axis=0) / largest, strict=True))


def without_sensor(differences: dict[str, float]) -> dict[str, float]:
    """What a step of the sensor, which rounding may move, cannot change."""
    return {name: d for name, d in differences.items() if name != "x_measured"}


@pytest.mark.parametrize(
    ("joint", "changes"),
    [("lift", {}), ("telescope", {}), ("lift", EVERYTHING)],
    ids=["lift", "telescope", "everything"],
)
def test_outputs_match_our_plant(
    joint: str, changes: dict[str, Any], built_in: Session, foreign: Session
) -> None:
    start_values = {**study(joint), **changes}
    steps = list(islice(cycle([1e-4, 1e-4, 2.5e-4, 1e-4, 3e-5]), 4000))
    expected, actual = both_outputs(built_in, foreign, start_values, steps)
    relative_differences = differences(actual, expected)
    assert {n: d for n, d in without_sensor(relative_differences).items() if d > TOLERANCE} == {}
    sensor_difference = np.abs(column(actual, "x_measured") - column(expected, "x_measured"))
    assert sensor_difference.max() < 1.001 * start_values["sensor.resolution"]
    assert np.mean(sensor_difference > 1e-12) < 0.01
    assert 0.1 < column(expected, "inverter.saturated").mean() < 0.9
