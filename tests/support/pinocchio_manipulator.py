"""The manipulator as a tree of seven joints in Pinocchio, whose two chains are closed as constraints.

Joints turn about z and slide along x; gravity is against y. Of the closed chains it is told only that the
end of a tube and the pin of its boom are one point: angles come from Newton's method, speeds, accelerations
and forces from Pinocchio's Jacobians.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from hdrm_fmu import HdrmParameters
from tests.support.reference_model import Vector

STROKES = ("lift tube", "tilt tube", "inner")
"""The joints whose positions are strokes, in the order of lift, tilt and telescope."""

NEAR_THE_MIDDLE = {"lift": 0.2, "outer": -1.1, "lift housing": 1.5, "tilt housing": -0.1}
"""Angles of a posture in the middle of the strokes, roughly: each chain can close in two ways."""


class PinocchioManipulator:
    """The manipulator of these parameters with a payload in kg."""

    def __init__(self, p: HdrmParameters, payload: float) -> None:
        self.p = p
        self.model = pin.Model()
        self.model.gravity.linear = np.array([0.0, -p.gravity, 0.0])
        self._joints: dict[str, int] = {"base": 0}
        self._add("lift", "base", pin.JointModelRZ(), (0.0, 0.0))
        self._add("outer", "lift", pin.JointModelRZ(), (p.lift_length, 0.0))
        self._add("inner", "outer", pin.JointModelPX(), (p.reach, 0.0))
        # depth first, as Pinocchio wants it
        self._add_actuator(1, "lift", p.tilt_a, p.tilt_delta, (p.lift_length, 0.0), p.tilt_L_0)
        self._add_actuator(0, "base", p.lift_a, p.lift_delta, (0.0, 0.0), p.lift_L_0)
        self._hang("lift", p.lift_m, p.lift_c, p.lift_J)
        self._hang("outer", p.outer_m, p.outer_c, p.outer_J)
        self._hang("outer", self._housing(2), p.housing_c[2], p.housing_J[2])
        self._hang("inner", p.inner_m, -p.inner_c, p.inner_J)
        self._hang("inner", self._tubes[2], -p.tube_c[2], p.tube_J[2])
        self._hang("inner", payload, 0.0, payload * p.payload_J)
        self.pairs = [
            (self._frame("lift tube", (0.0, 0.0)), self._frame("lift", self._pin(p.lift_b, p.lift_epsilon))),
            (self._frame("tilt tube", (0.0, 0.0)), self._frame("outer", self._pin(p.tilt_b, p.tilt_epsilon))),
        ]
        self.data = self.model.createData()
        places = [self.model.joints[self._joints[name]].idx_v for name in STROKES]
        self.chosen = np.eye(self.model.nv)[places]

    def forces(self, q: Sequence[float], v: Sequence[float], a: Sequence[float]) -> Vector:
        """Forces of the screws in N, without the tubes' inertia along the screws."""
        tree, to_tree, drift = self._closed(q, v)
        torques = pin.rnea(self.model, self.data, tree, to_tree @ v, to_tree @ a + drift)
        return to_tree.T @ torques - np.array(self._tubes) * a

    def mass_matrix(self, q: Sequence[float]) -> Vector:
        """M in kg, without the tubes' inertia along the screws."""
        tree, to_tree, _ = self._closed(q, np.zeros(3))
        M = np.triu(pin.crba(self.model, self.data, tree))
        M = M + np.triu(M, 1).T
        return to_tree.T @ M @ to_tree - np.diag(self._tubes)

    def _closed(self, q: Sequence[float], v: Sequence[float]) -> tuple[Vector, Vector, Vector]:
        """Positions of all joints, their speeds per stroke, and their accelerations without the strokes'."""
        tree = self._position(q)
        J = np.vstack([self._jacobian(tree), self.chosen])
        to_tree = np.linalg.solve(J, np.vstack([np.zeros((4, 3)), np.eye(3)]))
        pin.forwardKinematics(self.model, self.data, tree, to_tree @ v, np.zeros(self.model.nv))
        drift = np.concatenate([self._apart(self._acceleration), np.zeros(3)])
        return tree, to_tree, np.linalg.solve(J, -drift)

    def _position(self, q: Sequence[float]) -> Vector:
        """Positions of all joints: from the middle of the strokes to q in small moves, by Newton's method."""
        tree, middle = np.zeros(self.model.nq), np.array([0.25, 0.3, 0.5])
        for name, angle in NEAR_THE_MIDDLE.items():
            tree[self.model.joints[self._joints[name]].idx_q] = angle
        for part in (0.0, 0.25, 0.5, 0.75, 1.0):
            stroke = middle + part * (np.asarray(q) - middle)
            for _ in range(6):
                pin.forwardKinematics(self.model, self.data, tree)
                pin.updateFramePlacements(self.model, self.data)
                residual = np.concatenate([self._apart(self._place), self.chosen @ tree - stroke])
                tree -= np.linalg.solve(np.vstack([self._jacobian(tree), self.chosen]), residual)
        return tree

    def _apart(self, what: Any) -> Vector:
        """x and y by which the ends of both chains differ in something."""
        return np.concatenate([(what(end) - what(boom))[:2] for end, boom in self.pairs])

    def _jacobian(self, tree: Vector) -> Vector:
        def of(frame: int) -> Vector:
            return pin.computeFrameJacobian(self.model, self.data, tree, frame, pin.LOCAL_WORLD_ALIGNED)

        return np.vstack([(of(end) - of(boom))[:2] for end, boom in self.pairs])

    def _place(self, frame: int) -> Vector:
        return self.data.oMf[frame].translation

    def _acceleration(self, frame: int) -> Vector:
        world = pin.LOCAL_WORLD_ALIGNED
        return pin.getFrameClassicalAcceleration(self.model, self.data, frame, world).linear

    @cached_property
    def _tubes(self) -> list[float]:
        return [self.p.tube_share * m for m in self.p.M_BS]

    def _housing(self, i: int) -> float:
        return self.p.M_BS[i] - self._tubes[i] + self.p.motor_m[i]

    def _add_actuator(
        self, i: int, carrier: str, a: float, delta: float, turning: tuple[float, float], L_0: float
    ) -> None:
        """A housing that turns about its pin, and a tube whose joint is at the other pin."""
        p, joint = self.p, ("lift", "tilt")[i]
        pin_x, pin_y = self._pin(a, delta)
        self._add(f"{joint} housing", carrier, pin.JointModelRZ(), (turning[0] + pin_x, turning[1] + pin_y))
        self._add(f"{joint} tube", f"{joint} housing", pin.JointModelPX(), (L_0, 0.0))
        self._hang(f"{joint} housing", self._housing(i), p.housing_c[i], p.housing_J[i])
        self._hang(f"{joint} tube", self._tubes[i], -p.tube_c[i], p.tube_J[i])

    def _add(self, name: str, parent: str, joint: Any, place: tuple[float, float]) -> None:
        at = pin.SE3(np.eye(3), np.array([*place, 0.0]))
        self._joints[name] = self.model.addJoint(self._joints[parent], joint, at, name)

    def _hang(self, name: str, m: float, x: float, J: float) -> None:
        inertia = pin.Inertia(m, np.array([x, 0.0, 0.0]), np.diag([0.0, J, J]))
        self.model.appendBodyToJoint(self._joints[name], inertia, pin.SE3.Identity())

    def _frame(self, name: str, place: tuple[float, float]) -> int:
        joint = self._joints[name]
        at = pin.SE3(np.eye(3), np.array([*place, 0.0]))
        return self.model.addFrame(pin.Frame(f"{name} pin", joint, 0, at, pin.FrameType.OP_FRAME))

    @staticmethod
    def _pin(length: float, angle: float) -> tuple[float, float]:
        return length * float(np.cos(angle)), length * float(np.sin(angle))
