"""Machines from descriptions against Pinocchio with constraints."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmublock.symbolic import evaluate_symbolically
from machine_fmu import Actuator, Body, Joint, Machine, Payload, Point, plant_block
from tests.support.machine_states import Case, MachineState
from tests.support.pinocchio_machine import PinocchioMachine
from tests.support.reference_model import Vector

MACHINES = ("hdrm", "crane", "excavator", "lift_table", "stewart")
CASE = cache(Case.of)


PINS = [(1.0, 0.2, 0.0), (-0.6, 0.9, 0.1), (-0.5, -0.8, -0.1)]
"""Pins of actuators around a joint, m."""


def tripod(joint: Joint, count: int) -> Machine:
    """A mast on a joint in space, held by actuators, with an arm that turns about an oblique axis."""
    actuators = {
        f"leg_{i}": Actuator(
            (f"ground.foot_{i}", f"mast.pin_{i}"), 40.0, 0.3, 2.0, 0.9, 10.0, 0.3, 0.2, 1.0, (0.0, 0.5)
        )
        for i in range(count)
    }
    hinge = Joint("revolute", "mast", "top", (0.2, 1.0, 0.3), (0.3, -0.2, 0.5), (0.4,))
    arm = {"end": Point((0.8, 0.1, 0.2))}
    bodies = {
        "mast": Body(
            joint,
            200.0,
            (0.1, 0.0, 0.8),
            (90.0, 80.0, 20.0, 3.0, -2.0, 1.0),
            {
                "top": Point((0.2, 0.0, 1.5)),
                "side": Point((0.1, -0.3, 0.8)),
                **{f"pin_{i}": Point((0.5 * x, 0.5 * y, 0.9)) for i, (x, y, _) in enumerate(PINS)},
            },
        ),
        "arm": Body(hinge, 50.0, (0.4, 0.0, 0.1), (2.0, 9.0, 8.0), arm),
        "carriage": Body(
            Joint("prismatic", "arm", "end", (1.0, 0.5, -0.2), assembly=(0.2,)), 20.0, (0.1, 0.2, 0.0)
        ),
    }
    more = {
        "arm": Actuator(("mast.side", "arm.end"), 30.0, 0.3, 1.0, 0.8, 5.0, 0.3, 0.2, 0.5, (0.0, 0.4)),
        "carriage": Actuator(("mast.top", "carriage"), 10.0, 0.2, 0.5, 0.7, 2.0, 0.3, 0.2, 0.2, (0.0, 0.4)),
    }
    # turned against the pins, or nothing would hold the mast against a turn about z
    feet = {f"foot_{i}": Point((x + 1.5 * y, y - 1.5 * x, z)) for i, (x, y, z) in enumerate(PINS)}
    return Machine(3, bodies, feet, {**actuators, **more}, payload=Payload("carriage", 30.0, 0.1))


SPATIAL = {
    "universal": tripod(Joint("universal", axis=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)), 2),
    "spherical": tripod(Joint("spherical"), 3),
}


def relative(actual: object, expected: object) -> float:
    """Largest difference, as a fraction of the largest entry."""
    a, b = np.asarray(actual, dtype=float), np.asarray(expected, dtype=float)
    return float(np.abs(a - b).max() / np.abs(b).max())


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("states", [6, pytest.param(1000, marks=pytest.mark.slow)])
def test_machines_agree_with_constraints_in_pinocchio(name: str, states: int) -> None:
    """Which knows nothing of lengths and triangles: rods are bodies whose ends are held at pins."""
    case = CASE(name)
    oracle = PinocchioMachine(case.machine)
    count = len(case.machine.actuators)
    for state in case.states(states, seed=3):
        dynamics = case.dynamics(state)
        reflected = [2e3] * count + [0.0] * len(state.passive)
        forces = oracle.forces(state.variables, state.v, state.a)
        assert relative(dynamics.inverse(state.v, state.a), forces) < 1e-10
        expected = oracle.accelerations(state.variables, state.v, state.force, reflected)
        assert relative(dynamics.forward(state.v, state.force, reflected), expected) < 1e-10


def scissors() -> Machine:
    """The lift table with its actuator between both arms, so that both of its ends move."""
    machine = CASE("lift_table").machine
    arms = {
        name: replace(machine.bodies[name], points={**machine.bodies[name].points, "push": Point(position)})
        for name, position in (("arm", (1.2, 0.1)), ("other_arm", (1.1, -0.15)))
    }
    lift = replace(
        machine.actuators["lift"], ends=("other_arm.push", "arm.push"), L_0=0.1, rod_share=0.4, start=None
    )
    return replace(machine, bodies={**machine.bodies, **arms}, actuators={"lift": lift})


FURTHER = {**SPATIAL, "scissors": scissors()}


@pytest.mark.parametrize("name", FURTHER)
def test_further_machines_agree_with_pinocchio(name: str) -> None:
    """Universal, spherical and oblique joints, a slide that is pushed from aside, an actuator that moves."""
    case = Case.of_machine(name, FURTHER[name])
    oracle = PinocchioMachine(case.machine)
    draw = np.random.default_rng(4)
    assembled = [case.closure.lengths[bar.name] - bar.length for bar in case.mechanism.actuators]
    for _ in range(5):
        strokes = (np.array(assembled) + draw.uniform(-0.04, 0.04, len(assembled))).tolist()
        v, a = draw.uniform(-0.3, 0.3, len(strokes)).tolist(), draw.uniform(-5.0, 5.0, len(strokes)).tolist()
        dynamics = case.dynamics(MachineState(strokes, [], v, a, []))
        assert relative(dynamics.inverse(v, a), oracle.forces(strokes, v, a)) < 1e-11
        force = (1e4 * draw.uniform(-1.0, 1.0, len(strokes))).tolist()
        expected = oracle.accelerations(strokes, v, force, [1e3] * len(strokes))
        assert relative(dynamics.forward(v, force, [1e3] * len(strokes)), expected) < 1e-11


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("seconds", [0.5, pytest.param(5.0, marks=pytest.mark.slow)])
def test_merged_block_moves_as_pinocchio(name: str, seconds: float) -> None:
    """Under springs and dampers, each side with its own integration of its own states."""
    case = CASE(name)
    count, J_m, lead = len(case.machine.actuators), 0.02, 0.02
    ideal = {"B_m": [0.0] * count, "eta_GB": [1.0] * count, "J_m": [J_m] * count, "lead": [lead] * count}
    block = plant_block(case.machine, "Plant", actuators=ideal)()
    layout, symbolic = block.layout(), evaluate_symbolically(block)
    states, torque = list(layout.references(layout.states)), layout.reference("tau_m[1]")
    values = np.array([s.start for s in layout.scalars])
    values[states] = [values[layout.start_reference(r)] for r in states]
    first = values[states]
    alpha = 2.0 * np.pi / lead
    reflected = [alpha * alpha * J_m + float(m) for m in case.mechanism.actuator_masses]
    passive = [case.closure.assembly[i] for i in case.mechanism.passive]
    n = count + len(passive)
    rest = case.dynamics(MachineState(first[:count].tolist(), passive, [], [], []))
    weight, mass = np.array(rest.bias([0.0] * n)), np.diag(rest.mass_matrix())[:count] + reflected

    def force(t: float, x: Vector, v: Vector) -> Vector:
        target = first[:count] + 0.06 * (1.0 - np.cos(3.0 * t))
        return weight[:count] + mass * (36.0 * (target - x) - 8.0 * v)

    def slope(t: float, y: Vector) -> Vector:
        now = values.copy()
        now[states] = y
        now[torque : torque + count] = force(t, y[:count], y[count : 2 * count]) / alpha
        return symbolic.derivatives(t, now).full().ravel()

    oracle = PinocchioMachine(case.machine)

    def expected_slope(t: float, y: Vector) -> Vector:
        x, v = np.split(y, 2)
        damping = -np.array(case.mechanism.dampings) * v[count:]
        forces = [*force(t, x[:count], v[:count]), *damping]
        extra = [*reflected, *[0.0] * len(passive)]
        return np.concatenate([v, oracle.accelerations(x.tolist(), v.tolist(), forces, extra)])

    start = np.array([*first[:count], *passive, *[0.0] * n])
    tight: Any = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-10}
    expected = solve_ivp(expected_slope, (0.0, seconds), start, **tight).y[:count, -1]
    actual = solve_ivp(slope, (0.0, seconds), first, **tight).y[:count, -1]
    assert actual == pytest.approx(expected, abs=1e-8)
    assert np.abs(expected - first[:count]).min() > 0.005


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("steps", [5, pytest.param(150, marks=pytest.mark.slow)])
def test_energy_is_the_work_of_the_forces(name: str, steps: int) -> None:
    """Over a motion by Runge-Kutta, without friction and with the inertia of motors."""
    case = CASE(name)
    state = case.states(1, seed=5)[0]
    count = len(state.strokes)
    reflected = [5e3] * count + [0.0] * len(state.passive)
    rest = MachineState(state.strokes, state.passive, [0.0] * len(reflected), [], [])
    weight = case.dynamics(rest).bias(rest.v)[:count]  # a constant force has a potential, too
    pushed = [w + 0.1 * x for w, x in zip(weight, state.force, strict=False)]
    force = np.array([*pushed, *(0.0 for _ in state.passive)])

    def slope(y: Vector) -> Vector:
        x, v = np.split(y, 2)
        at = MachineState(x[:count].tolist(), x[count:].tolist(), v.tolist(), [], [])
        return np.concatenate([v, case.dynamics(at).forward(v.tolist(), force.tolist(), reflected)])

    def energy(y: Vector) -> float:
        x, v = np.split(y, 2)
        at = MachineState(x[:count].tolist(), x[count:].tolist(), v.tolist(), [], [])
        return case.dynamics(at).energy(v.tolist(), reflected) - float(force @ x)

    first = y = np.array([*state.variables, *(0.1 * x for x in state.v)])
    h = 2e-3
    for _ in range(steps):
        k_1 = slope(y)
        k_2 = slope(y + 0.5 * h * k_1)
        k_3 = slope(y + 0.5 * h * k_2)
        y = y + h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + slope(y + h * k_3))
    kinetic = 0.5 * float(np.abs(y[len(y) // 2 :]) @ (np.array(reflected) * np.abs(y[len(y) // 2 :])))
    assert energy(y) == pytest.approx(energy(first), abs=1e-8 * max(kinetic, 1.0))
