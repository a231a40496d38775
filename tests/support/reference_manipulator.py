"""The manipulator by Lagrange's equations, independently of its file: CasADi differentiates the energies.

Every body has a centre and an angle; nothing is said of levers, joints'
accelerations or forces in pins. Kinetic energy leaves out what the actuators' A_eq has: half of every tube's
mass times its stroke's speed squared.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from tests.support.manipulator_geometry import HDRM, Manipulator
from tests.support.reference_model import Vector


@dataclass(frozen=True)
class Body:
    """Mass in kg, centre of mass in m, angle in rad, and inertia in kg m2 about its centre."""

    m: Any
    centre: ca.SX
    angle: ca.SX
    J: Any


def _direction(angle: Any) -> ca.SX:
    return ca.vertcat(ca.cos(angle), ca.sin(angle))


def _corner(a: float, b: float, L: ca.SX) -> ca.SX:
    """Angle between the sides a and b, opposite L, from half its tangent."""
    s = (a + b + L) / 2.0
    return 2.0 * ca.atan2(ca.sqrt((s - a) * (s - b)), ca.sqrt(s * (s - L)))


@dataclass(frozen=True)
class Lagrangian:
    """Equations of motion of a manipulator with these numbers."""

    p: Manipulator = HDRM

    @cached_property
    def functions(self) -> tuple[ca.Function, ca.Function]:
        """(q, v, a, payload) -> forces; (q, v, payload) -> mass matrix, bias, energy and tip."""
        q, v, a, payload = ca.SX.sym("q", 3), ca.SX.sym("v", 3), ca.SX.sym("a", 3), ca.SX.sym("payload")
        bodies, tip = self._bodies(q, payload)
        T = sum(_kinetic(body, q, v) for body in bodies)
        V = sum(body.m * self.p.gravity * body.centre[1] for body in bodies)
        for i in range(3):
            T -= 0.5 * self.p.tube_share * self.p.M_BS[i] * v[i] ** 2
        momentum = ca.gradient(T, v)
        M = ca.jacobian(momentum, v)
        h = ca.jtimes(momentum, q, v) - ca.gradient(T - V, q)
        inverse = ca.Function("inverse", [q, v, a, payload], [M @ a + h])
        return inverse, ca.Function("state", [q, v, payload], [M, h, T + V, tip])

    def forces(self, q: Sequence[float], v: Sequence[float], a: Sequence[float], payload: float) -> Vector:
        """Forces of the screws in N."""
        return np.array(self.functions[0](q, v, a, payload)).ravel()

    def at(
        self, q: Sequence[float], v: Sequence[float], payload: float
    ) -> tuple[Vector, Vector, float, Vector]:
        """Mass matrix in kg, bias in N, energy in J, and tip in m."""
        M, h, energy, tip = self.functions[1](q, v, payload)
        return np.array(M), np.array(h).ravel(), float(energy), np.array(tip).ravel()

    def _bodies(self, q: ca.SX, payload: ca.SX) -> tuple[list[Body], ca.SX]:
        p = self.p
        lift = p.lift_delta + _corner(p.lift_a, p.lift_b, p.lift_L_0 + q[0]) - p.lift_epsilon
        boom = lift + p.tilt_delta + _corner(p.tilt_a, p.tilt_b, p.tilt_L_0 + q[1]) - p.tilt_epsilon
        O_2 = p.lift_length * _direction(lift)
        tip = O_2 + (p.reach + q[2]) * _direction(boom)
        tubes = [p.tube_share * m for m in p.M_BS]
        housings = [m - tube + motor for m, tube, motor in zip(p.M_BS, tubes, p.motor_m, strict=True)]
        along = _direction(boom)
        bodies = [
            Body(p.lift_m, p.lift_c * _direction(lift), lift, p.lift_J),
            Body(p.outer_m, O_2 + p.outer_c * along, boom, p.outer_J),
            Body(p.inner_m, tip - p.inner_c * along, boom, p.inner_J),
            Body(payload, tip, boom, payload * p.payload_J),
            Body(housings[2], O_2 + p.housing_c[2] * along, boom, p.housing_J[2]),
            Body(tubes[2], tip - p.tube_c[2] * along, boom, p.tube_J[2]),
        ]
        fixed_pins = p.lift_a * _direction(p.lift_delta), O_2 + p.tilt_a * _direction(lift + p.tilt_delta)
        boom_pins = (
            p.lift_b * _direction(lift + p.lift_epsilon),
            O_2 + p.tilt_b * _direction(boom + p.tilt_epsilon),
        )
        for i, (A, B) in enumerate(zip(fixed_pins, boom_pins, strict=True)):
            angle = ca.atan2(B[1] - A[1], B[0] - A[0])
            bodies.append(Body(housings[i], A + p.housing_c[i] * _direction(angle), angle, p.housing_J[i]))
            bodies.append(Body(tubes[i], B - p.tube_c[i] * _direction(angle), angle, p.tube_J[i]))
        return bodies, tip


def _kinetic(body: Body, q: ca.SX, v: ca.SX) -> ca.SX:
    speed, spin = ca.jtimes(body.centre, q, v), ca.jtimes(body.angle, q, v)
    return 0.5 * body.m * ca.dot(speed, speed) + 0.5 * body.J * spin**2


LAGRANGIAN = Lagrangian()


@dataclass(frozen=True)
class Merged:
    """Manipulator and three actuators; values in the order of lift, tilt and telescope."""

    lagrangian: Lagrangian = Lagrangian()
    J: tuple[float, ...] = (0.016, 0.0105, 0.00085)
    """Inertia at the motors, J_m + J_c + J_GB, kg m2."""
    rho: tuple[float, ...] = (1.0 / 7.0, 1.0 / 5.0, 1.0)
    lead: tuple[float, ...] = (0.02, 0.01, 0.01)
    B_m: tuple[float, ...] = (1.67e-3, 1.67e-3, 1.67e-3)
    B_BS: tuple[float, ...] = (0.0, 0.0, 0.0)
    C_eq: tuple[float, ...] = (0.0, 0.0, 0.0)
    eta_GB: tuple[float, ...] = (0.9, 0.9, 0.9)
    F_2: tuple[float, ...] = (0.0, 0.0, 0.0)

    def coefficients(self) -> tuple[Vector, Vector, Vector]:
        """A_eq, B_eq and D_eq of (5)."""
        alpha = 2.0 * np.pi / (np.array(self.rho) * self.lead)
        A = alpha * self.J + np.array(self.lagrangian.p.M_BS) / alpha
        return A, alpha * self.B_m + np.array(self.B_BS) / alpha, 1.0 / (alpha * self.eta_GB)

    def acceleration(self, x: Vector, tau_m: Vector, d_2: Vector, payload: float) -> tuple[Vector, Vector]:
        """Accelerations, and load forces in N: (9) of each actuator with F_L = M a + h."""
        A, B, D = self.coefficients()
        M, h, _, _ = self.lagrangian.at(x[:3], x[3:], payload)
        free = tau_m / A - (1.0 + np.array(self.F_2)) * (B * x[3:] + self.C_eq * x[:3]) / A + d_2
        # a = free - D/A (M a + h)
        a = np.linalg.solve(np.eye(3) + np.diag(D / A) @ M, free - D / A * h)
        return a, M @ a + h

    def energy(self, x: Vector, payload: float) -> float:
        """Energy of manipulator, motors and screws in J."""
        A, _, D = self.coefficients()
        return self.lagrangian.at(x[:3], x[3:], payload)[2] + 0.5 * float(A / D @ x[3:] ** 2)
