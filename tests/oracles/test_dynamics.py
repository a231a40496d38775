"""The manipulator of `hdrm.toml` against Lagrange's equations of its numbers, and against Pinocchio."""

import numpy as np
import pytest
from hypothesis import given, settings

from emla_cosim.study.machines.schema import load_machine
from machine_fmu import Dynamics, assemble, find_closure
from machine_fmu.exact import plain
from machine_fmu.model import MachineModel
from tests.support.machines import MOMENTS, Moment, machines, named_values
from tests.support.manipulator_geometry import HDRM, Manipulator
from tests.support.reference_manipulator import LAGRANGIAN, Lagrangian

FILE = load_machine("hdrm")
CLOSURE = find_closure(FILE)
MODEL = MachineModel(FILE)
REFLECTED = np.array([7e4, 9e4, 3e2])
"""Inertia of motors in kg."""


def dynamics(m: Moment, p: Manipulator = HDRM) -> Dynamics:
    return Dynamics(assemble(FILE, named_values(p).__getitem__, m.payload), CLOSURE, m.q)


@pytest.mark.parametrize(
    ("q", "forces"),
    [((0.244, 0.389, 0.499), [56.7, 22.8, -3.4]), ((0.270, 0.442, 0.348), [58.0, 26.1, -2.5])],
)
def test_static_forces_match_the_loads_of_the_study(q: tuple[float, ...], forces: list[float]) -> None:
    assert MODEL.holding_forces(np.array([q]))[0] / 1e3 == pytest.approx(forces, abs=0.05)


def test_static_forces_stay_within_the_bounds_over_the_whole_box() -> None:
    """Of Table II."""
    grid = np.array(np.meshgrid(*(np.linspace(0.0, high, 9) for high in HDRM.q_UB))).reshape(3, -1).T
    assert np.all(np.abs(MODEL.holding_forces(grid)) <= [89.8e3, 68.6e3, 6.1e3])


def assert_is_judged(m: Moment, p: Manipulator, judge: Lagrangian) -> None:
    """To fractions of what forces and accelerations are the sums of; rounding goes with them."""
    actual = dynamics(m, p)
    M, h, energy, tip = judge.at(m.q, m.v, m.payload)
    weight = judge.at(m.q, [0.0] * 3, m.payload)[1]
    summands = np.abs(M) @ np.abs(m.a) + np.abs(weight) + np.abs(h - weight) + 1.0
    assert actual.mass_matrix() == pytest.approx(M, rel=1e-9, abs=1e-9 * float(np.abs(M).max()))
    assert actual.bias(m.v) == pytest.approx(h, abs=1e-9 * summands.max())
    assert actual.inverse(m.v, m.a) == pytest.approx(
        judge.forces(m.q, m.v, m.a, m.payload), abs=1e-9 * summands.max()
    )
    inertia = M + np.diag(REFLECTED)
    force = h + inertia @ m.a
    rounding = np.abs(np.linalg.inv(inertia)) @ (summands + REFLECTED * np.abs(m.a))
    accelerations = np.array(actual.forward(m.v, force.tolist(), REFLECTED.tolist()))
    assert np.all(np.abs(accelerations - m.a) <= 1e-9 * rounding)
    height = float(np.abs(tip).max()) + 1.0
    assert actual.energy(m.v) == pytest.approx(
        energy, rel=1e-9, abs=1e-10 * (1.0 + m.payload) * height * 10.0
    )
    assert actual.mechanism.payload is not None
    assert [plain(x) for x in actual.pose.point(actual.mechanism.payload)[:2]] == pytest.approx(
        tip, abs=1e-11
    )


@given(m=MOMENTS)
@settings(deadline=None)
def test_manipulator_agrees_with_lagrange(m: Moment) -> None:
    assert_is_judged(m, HDRM, LAGRANGIAN)


@given(m=MOMENTS, p=machines())
@settings(max_examples=10, deadline=None)
def test_any_manipulator_agrees_with_lagrange(m: Moment, p: Manipulator) -> None:
    """Each number of the file is the one with its name."""
    assert_is_judged(m, p, Lagrangian(p))


@given(m=MOMENTS, p=machines())
@settings(max_examples=15, deadline=None)
def test_any_manipulator_agrees_with_pinocchio(m: Moment, p: Manipulator) -> None:
    """Default directions, because each chain can close in two ways; all else as it comes."""
    from dataclasses import replace

    from tests.support.pinocchio_machine import PinocchioMachine

    angles = ("lift_delta", "lift_epsilon", "tilt_delta", "tilt_epsilon")
    p = replace(p, **{name: getattr(HDRM, name) for name in angles})
    machine = MachineModel(FILE, named_values(p)).machine
    assert machine.payload is not None
    judge = PinocchioMachine(replace(machine, payload=replace(machine.payload, m=m.payload)))
    actual, v, a = dynamics(m, p), m.v, m.a
    size = (
        np.abs(actual.mass_matrix()) @ np.abs(a)
        + np.abs(actual.bias([0.0] * 3))
        + np.abs(actual.bias(v))
        + 1.0
    )
    assert actual.inverse(v, a) == pytest.approx(judge.forces(m.q, v, a), abs=1e-9 * size.max())


@given(m=MOMENTS)
@settings(max_examples=20, deadline=None)
def test_many_poses_at_once_have_the_same_forces_and_energies(m: Moment) -> None:
    rows = [np.array([x, [0.9 * y for y in x]]) for x in (m.q, m.v, m.a)]
    forces, energies = MODEL.forces(*rows, m.payload), MODEL.energy(rows[0], rows[1], m.payload)
    for i, (q, v, a) in enumerate(zip(*(row.tolist() for row in rows), strict=True)):
        single = dynamics(Moment(q, v, a, m.payload))
        assert forces[i] == pytest.approx(single.inverse(v, a), rel=1e-12, abs=1e-9)
        assert energies[i] == pytest.approx(single.energy(v), rel=1e-12, abs=1e-9)
