"""Holding forces of machines against virtual work and closed triangles, and their limits."""

import math

import numpy as np
import pytest

from emla_cosim.study.machines.force_map import (
    ForceLimits,
    find_extremes,
    find_levers,
    find_maps,
    read_limits,
)
from emla_cosim.study.machines.machine_info import NEWTON, SLIDE, TRIANGLE, collect_machine
from emla_cosim.study.machines.schema import load_machine, parse_machine
from emla_cosim.study.sketch.machine_maps import draw_machine_pictures
from emla_cosim.study.sketch.workspace import find_workspace
from machine_fmu import Machine
from machine_fmu.model import MachineModel
from tests.support.tiers import mostly_slow

MASS, REACH, ARM, FOOT, REST, STROKE = 300.0, 2.0, 0.5, 0.6, 0.5, 0.35


def boom(dimensions: int = 2) -> Machine:
    """A boom without mass about the origin, with its pin at ARM, an actuator from FOOT below, and a load."""
    up = (0.0, -FOOT) if dimensions == 2 else (0.0, 0.0, -FOOT)
    more = [] if dimensions == 2 else [0.0]
    ram = {"from": "ground.foot", "to": "boom.pin", "length": REST, "stroke": [0.0, STROKE]}
    content = {
        "kind": "machine",
        "description": "",
        "dimensions": dimensions,
        "ground": {"points": {"foot": list(up)}},
        "bodies": {
            "boom": {
                "joint": "revolute",
                "axis": [0, 0, 1] if dimensions == 2 else [0, -1, 0],
                "points": {"pin": [ARM, 0.0, *more], "end": [REACH, 0.0, *more]},
            }
        },
        "actuators": {"ram": ram},
        "payload": {"at": "boom.end", "m": MASS},
    }
    return parse_machine(content, "the boom")


def triangle(stroke: float) -> tuple[float, float]:
    """Force in N and lever of the boom by the law of cosines: angle between pin and foot, moments."""
    length = REST + stroke
    gamma = math.acos((ARM**2 + FOOT**2 - length**2) / (2.0 * ARM * FOOT))
    arm = ARM * FOOT * math.sin(gamma) / length
    angle = gamma - 0.5 * math.pi
    return MASS * 9.81 * REACH * math.cos(angle) / arm, REACH / arm


@pytest.mark.parametrize("dimensions", [2, 3])
def test_boom_is_held_as_its_triangle_says(dimensions: int) -> None:
    machine = MachineModel(boom(dimensions))
    strokes = find_workspace(machine).strokes
    (force_map,) = find_maps(machine, strokes)
    expected = np.array([triangle(q) for q in force_map.strokes[0]])
    assert force_map.forces == pytest.approx(expected[:, 0], rel=1e-9)
    assert force_map.levers == pytest.approx(expected[:, 1], rel=1e-6)
    (extreme,) = find_extremes(machine, strokes)
    fine = [triangle(q)[0] for q in np.linspace(0.0, STROKE, 401)]
    assert (extreme.lowest, extreme.highest) == pytest.approx((min(fine), max(fine)), rel=1e-12)
    assert triangle(extreme.strokes[0])[0] == pytest.approx(extreme.largest)


def test_forces_are_the_slope_of_the_potential_energy() -> None:
    machine = MachineModel(load_machine("hdrm"))
    q = np.random.default_rng(7).uniform(machine.q_LB, machine.q_UB, (5, 3))
    for i, step in enumerate(1e-5 * np.eye(3)):
        rest = np.zeros_like(q)
        slope = (machine.energy(q + step, rest) - machine.energy(q - step, rest)) / 2e-5
        assert machine.holding_forces(q)[:, i] == pytest.approx(slope, rel=1e-6, abs=0.1)


def test_maps_are_over_the_two_strokes_that_matter() -> None:
    machine = MachineModel(load_machine("hdrm"))
    strokes = find_workspace(machine).strokes
    maps = find_maps(machine, strokes)
    assert all(force_map.forces.shape == (41, 41) for force_map in maps)
    lift = maps[0]
    row = np.array(machine.start)
    row[list(lift.axes)] = [lift.strokes[0][3], lift.strokes[1][30]]
    assert lift.forces[3, 30] == pytest.approx(machine.holding_forces(row[None, :])[0, 0])
    assert find_levers(machine, row[None, :], 2) == pytest.approx(1.0)  # the telescope moves the tip itself


@pytest.mark.parametrize("name", mostly_slow(["hdrm", "lift_table", "stewart"], ["hdrm", "lift_table"]))
def test_machines_are_described_and_drawn(name: str) -> None:
    info = collect_machine(load_machine(name), limits={"lift": ForceLimits(30e3, 60e3)})
    assert info.degrees_of_freedom == {"hdrm": 3, "lift_table": 1, "stewart": 6}[name]
    methods = {"hdrm": [TRIANGLE, TRIANGLE, SLIDE], "lift_table": [TRIANGLE, NEWTON, NEWTON]}
    assert [closure.method for closure in info.closures] == methods.get(name, [NEWTON])
    assert all(x.lowest_force <= x.start_force <= x.highest_force for x in info.actuators)
    content = info.as_dict()
    assert content["actuators"][0]["name"] == info.actuators[0].name
    assert not any(key.startswith("_") for key in content)
    if name != "stewart":  # whose maps take seconds
        assert set(info.draw()) == {"machine", "forces", "levers"}


def test_changed_numbers_change_forces() -> None:
    machine = load_machine("hdrm")
    default, heavy, bare = (
        collect_machine(machine, {"inner_boom.m": m}, p) for m, p in [(60, 470), (90, 470), (60, 0)]
    )
    assert heavy.actuators[0].start_force > default.actuators[0].start_force > bare.actuators[0].start_force
    assert bare.payload == 0.0


def test_limits_are_those_of_motor_and_controller() -> None:
    values = {
        **{f"lift.plant.motor.{n}": x for n, x in {"N_p": 8, "Phi_PM": 0.15, "i_N": 29.5}.items()},
        "lift.plant.gearbox.rho": 1 / 7,
        "lift.plant.gearbox.eta_GB": 0.9,
        "lift.plant.screw.lead": 0.02,
        "lift.controller.limit.i_max": 100.0,
    }
    per_ampere = 1.5 * 8 * 0.15 * 0.9 * 7 * 2 * math.pi / 0.02
    limits = read_limits("lift", values, {})
    assert (limits.continuous, limits.largest) == pytest.approx((29.5 * per_ampere, 100.0 * per_ampere))
    assert read_limits("lift", {**values, "lift.plant.motor.i_N": 0.0}, {}).continuous is None
    assert read_limits("tilt", values, {}) == ForceLimits()


def test_pictures_mark_what_an_actuator_holds() -> None:
    machine = MachineModel(boom())
    workspace = find_workspace(machine)
    weakest = 0.8 * find_extremes(machine, workspace.strokes)[0].largest
    figure = draw_machine_pictures(machine, workspace, {"ram": ForceLimits(None, weakest)})["forces"]
    lines = [np.asarray(line.get_ydata(), dtype=float) for line in figure.axes[0].lines]
    assert any(np.allclose(y, 1e-3 * weakest) for y in lines)
