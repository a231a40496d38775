"""Inverse and forward dynamics against each other, against Lagrange's equations, and against Pinocchio."""

from functools import lru_cache

import casadi
import numpy as np
import pytest
from hypothesis import given, settings

from hdrm_fmu import HDRM, HdrmParameters, dynamics
from hdrm_fmu.parameters import PAYLOAD
from tests.support.machines import MOMENTS, Moment, machines
from tests.support.reference_manipulator import Lagrangian
from tests.support.reference_model import Vector

REST = (0.0, 0.0, 0.0)
LAGRANGIAN = Lagrangian()


def size(p: HdrmParameters, m: Moment) -> Vector:
    """Forces in N, without regard to signs, that a motion's force is the sum of; rounding goes with them."""
    M = np.abs(dynamics.mass_matrix(p, m.q, m.payload))
    weight = np.abs(dynamics.bias(p, m.q, REST, m.payload))
    speed = np.abs(np.array(dynamics.bias(p, m.q, m.v, m.payload)) - dynamics.bias(p, m.q, REST, m.payload))
    return M @ np.abs(m.a) + weight + speed + 1.0


@pytest.mark.parametrize(
    ("q", "forces"),
    [((0.244, 0.389, 0.499), [56.7, 22.8, -3.4]), ((0.270, 0.442, 0.348), [58.0, 26.1, -2.5])],
)
def test_static_forces_are_those_the_studys_loads_were_taken_from(
    q: tuple[float, ...], forces: list[float]
) -> None:
    found = dynamics.inverse_dynamics(HDRM, q, REST, REST, PAYLOAD)
    assert np.array(found) / 1e3 == pytest.approx(forces, abs=0.05)


def test_static_forces_stay_within_the_bounds_over_the_whole_box() -> None:
    """Of Table II."""
    grid = np.array(np.meshgrid(*(np.linspace(0.0, high, 9) for high in HDRM.q_UB))).reshape(3, -1).T
    found = np.array([dynamics.inverse_dynamics(HDRM, q, REST, REST, PAYLOAD) for q in grid.tolist()])
    assert np.all(np.abs(found) <= [89.8e3, 68.6e3, 6.1e3])


@given(m=MOMENTS, p=machines())
def test_forward_dynamics_undo_inverse_dynamics(m: Moment, p: HdrmParameters) -> None:
    """With and without inertia of motors. The accelerations are large, so that weight does not drown them."""
    M = np.array(dynamics.mass_matrix(p, m.q, m.payload))
    force = np.array(dynamics.inverse_dynamics(p, m.q, m.v, m.a, m.payload))
    # forces agree to 1e-12 of what they are the sums of ...
    assert M @ m.a + dynamics.bias(p, m.q, m.v, m.payload) == pytest.approx(
        force, abs=1e-12 * size(p, m).max()
    )
    # ... and accelerations to what these make of it
    reflected = np.array([7e4, 9e4, 3e2])
    total = force + reflected * m.a
    found = dynamics.forward_dynamics(p, m.q, m.v, total.tolist(), m.payload, reflected.tolist())
    room = np.abs(np.linalg.inv(M + np.diag(reflected))) @ (size(p, m) + reflected * np.abs(m.a))
    assert np.all(np.abs(np.array(found) - m.a) <= 1e-12 * room)
    without = dynamics.forward_dynamics(HDRM, m.q, m.v, _forces(m), m.payload)
    assert without == pytest.approx(m.a, abs=1e-11)


def _forces(m: Moment) -> list[float]:
    return dynamics.inverse_dynamics(HDRM, m.q, m.v, m.a, m.payload)


@given(m=MOMENTS)
def test_both_agree_with_lagrange(m: Moment) -> None:
    M, h, energy, _ = LAGRANGIAN.at(m.q, m.v, m.payload)
    tolerance = 1e-9 * size(HDRM, m).min()
    assert _forces(m) == pytest.approx(LAGRANGIAN.forces(m.q, m.v, m.a, m.payload), abs=tolerance)
    assert np.array(dynamics.mass_matrix(HDRM, m.q, m.payload)) == pytest.approx(M, rel=1e-9, abs=1e-9)
    assert dynamics.energy(HDRM, m.q, m.v, m.payload) == pytest.approx(energy, rel=1e-9, abs=1e-6)
    force = 1e4 * np.array(m.a)
    expected = np.linalg.solve(M, force - h)
    found = dynamics.forward_dynamics(HDRM, m.q, m.v, force.tolist(), m.payload)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(m=MOMENTS, p=machines())
@settings(max_examples=10)
def test_any_machine_agrees_with_lagrange(m: Moment, p: HdrmParameters) -> None:
    found = dynamics.inverse_dynamics(p, m.q, m.v, m.a, m.payload)
    expected = Lagrangian(p).forces(m.q, m.v, m.a, m.payload)
    assert found == pytest.approx(expected, abs=1e-9 * size(p, m).min())


@given(m=MOMENTS, p=machines())
@settings(max_examples=30)
def test_both_agree_with_pinocchio(m: Moment, p: HdrmParameters) -> None:
    """Default directions, because each chain can close in two ways; all else as it comes."""
    pytest.importorskip("pinocchio", reason="Pinocchio has no package for Windows.")
    from dataclasses import replace

    from tests.support.pinocchio_manipulator import PinocchioManipulator

    angles = ("lift_delta", "lift_epsilon", "tilt_delta", "tilt_epsilon")
    p = replace(p, **{name: getattr(HDRM, name) for name in angles})
    judge = PinocchioManipulator(p, m.payload)
    found = dynamics.inverse_dynamics(p, m.q, m.v, m.a, m.payload)
    assert found == pytest.approx(judge.forces(m.q, m.v, np.array(m.a)), abs=1e-9 * size(p, m).min())
    M = judge.mass_matrix(m.q)
    assert np.array(dynamics.mass_matrix(p, m.q, m.payload)) == pytest.approx(M, abs=1e-9 * np.abs(M).max())


@given(m=MOMENTS, p=machines())
def test_the_mass_matrix_is_symmetric_and_positive(m: Moment, p: HdrmParameters) -> None:
    """With what motors and screws add of M_BS; the tubes alone are not all there."""
    M = np.array(dynamics.mass_matrix(p, m.q, m.payload))
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M + np.diag(p.M_BS)).min() > 0.0


@given(m=MOMENTS, p=machines())
def test_power_is_the_change_of_energy(m: Moment, p: HdrmParameters) -> None:
    h = 2e-4

    def energy(t: float) -> float:
        q = [x + v * t + 0.5 * a * t * t for x, v, a in zip(m.q, m.v, m.a, strict=True)]
        return dynamics.energy(p, q, [v + a * t for v, a in zip(m.v, m.a, strict=True)], m.payload)

    change = (8.0 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12.0 * h)
    force = dynamics.inverse_dynamics(p, m.q, m.v, m.a, m.payload)
    rounding = 1e-15 * abs(energy(0.0)) / h
    assert np.dot(force, m.v) == pytest.approx(change, rel=1e-6, abs=100.0 * rounding + 1e-3)


@lru_cache
def _on_symbols() -> casadi.Function:
    q, v, a, payload = (casadi.SX.sym(n, k) for n, k in (("q", 3), ("v", 3), ("a", 3), ("payload", 1)))
    parts = [casadi.vertsplit(x) for x in (q, v, a)]
    inverse = dynamics.inverse_dynamics(HDRM, *parts, payload)
    forward = dynamics.forward_dynamics(HDRM, *parts, payload)
    energy = dynamics.energy(HDRM, parts[0], parts[1], payload)
    return casadi.Function("all", [q, v, a, payload], [casadi.vertcat(*inverse, *forward, energy)])


@given(m=MOMENTS)
@settings(max_examples=20)
def test_symbols_of_casadi_give_the_same(m: Moment) -> None:
    expected = [
        *_forces(m),
        *dynamics.forward_dynamics(HDRM, m.q, m.v, m.a, m.payload),
        dynamics.energy(HDRM, m.q, m.v, m.payload),
    ]
    found = np.array(_on_symbols()(m.q, m.v, m.a, m.payload)).ravel()
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-9)
