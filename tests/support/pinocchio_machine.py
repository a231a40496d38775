"""A machine as a tree in Pinocchio whose chains are closed by constraints, from its description alone.

Each actuator is a housing that turns about its first point, and a rod that slides in it; each link turns
about its first point. That their other ends are points of bodies are constraints, so that nothing here knows
of lengths, slopes, or triangles. Accelerations and forces are those of the equations of motion with
multipliers (KKT), which NumPy solves. Passive joints of one coordinate are variables after the strokes.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from machine_fmu import GROUND, Actuator, Machine, Strut
from tests.support.reference_model import Vector

pin: Any = pytest.importorskip("pinocchio", reason="Pinocchio has no package for Windows.")


class PinocchioMachine:
    """The machine with the values of its description."""

    def __init__(self, machine: Machine) -> None:
        self.machine, self.plane = machine, machine.dimensions == 2
        g = self._number(machine.gravity)
        self.model = pin.Model()
        self.model.gravity.linear = np.array([0.0, -g, 0.0] if self.plane else [0.0, 0.0, -g])
        self._joints: dict[str, int] = {GROUND: 0}
        self._assembly: dict[int, Any] = {}
        self._pairs: list[tuple[int, int]] = []
        self._rods: list[int] = []
        self._rod_masses: list[float] = []
        self._assembled = self._assembled_places()
        self._add_children(GROUND)
        for name, (a, b) in machine.loops.items():
            self._pairs.append((self._frame(f"{name} a", a), self._frame(f"{name} b", b)))
        if machine.payload is not None:
            m, at = machine.payload.m, machine.payload.at
            J = m * self._number(machine.payload.J)
            self._hang(at.partition(".")[0], m, self._point(at), np.diag([J, J, J]))
        self.start = self._start()
        lengths = [self._number(a.L_0) for a in machine.actuators.values()]
        self.lengths = np.array([*lengths, *[0.0] * (len(self._rods) - len(lengths))])

    def close(self, strokes: Sequence[float], parts: int = 8) -> Vector:
        """Return positions of all joints at strokes in m, from the assembly pose by Newton's method."""
        q = self._newton(self.start, None)
        before = self._strokes_of(q)
        for part in np.linspace(0.0, 1.0, parts + 1)[1:]:
            q = self._newton(q, before + part * (np.asarray(strokes) - before))
        return q

    def accelerations(
        self, strokes: Sequence[float], v: Sequence[float], force: Sequence[float], reflected: Sequence[float]
    ) -> Vector:
        """Return the accelerations of strokes; as in `machine_fmu`, rods have no inertia along themselves."""
        M, h, J, drift, _ = self._motion(strokes, v)
        for i, extra in enumerate(reflected):
            M[self.strokes[i], self.strokes[i]] += extra - self._rod_masses[i]
        right = -h
        right[self.strokes] += force
        n, m = len(M), len(J)
        # scaled, so that constraints are as exact as forces
        size = np.abs(np.diag(M)).max()
        K = np.block([[M / size, J.T], [J, np.zeros((m, m))]])
        solution = np.linalg.lstsq(K, np.concatenate([right / size, -drift]), rcond=1e-14)[0]
        return solution[:n][self.strokes]

    def forces(self, strokes: Sequence[float], v: Sequence[float], a: Sequence[float]) -> Vector:
        """Return the forces of the screws for accelerations of the strokes."""
        M, h, J, drift, speed_map = self._motion(strokes, v)
        A = np.vstack([J, np.eye(len(M))[self.strokes]])
        growth = np.linalg.lstsq(A, np.concatenate([-drift, a]), rcond=1e-14)[0]
        return speed_map.T @ (M @ growth + h) - np.array(self._rod_masses) * np.asarray(a)

    def _motion(
        self, strokes: Sequence[float], v: Sequence[float]
    ) -> tuple[Vector, Vector, Vector, Vector, Vector]:
        """Return M, h, J, J' q' and the joints' speeds per speed of strokes."""
        q = self.close(strokes)
        J = self._jacobian(q)
        selection = np.eye(self.model.nv)[self.strokes]
        count = len(self.strokes)
        unit = np.vstack([np.zeros((len(J), count)), np.eye(count)])
        speed_map = np.linalg.lstsq(np.vstack([J, selection]), unit, rcond=1e-14)[0]
        qd = speed_map @ np.asarray(v)
        M = pin.crba(self.model, self.data, q).copy()
        M = np.triu(M) + np.triu(M, 1).T
        h = pin.nonLinearEffects(self.model, self.data, q, qd).copy()
        pin.forwardKinematics(self.model, self.data, q, qd, np.zeros(self.model.nv))
        drift = self._loop_gap(self._acceleration)
        return M, h, J, drift, speed_map

    def _newton(self, q: Vector, strokes: Vector | None) -> Vector:
        """Return positions that close all chains near q; at strokes, or anywhere."""
        for _ in range(60):
            pin.forwardKinematics(self.model, self.data, q)
            pin.updateFramePlacements(self.model, self.data)
            residual, rows = self._loop_gap(lambda f: self.data.oMf[f].translation), self._jacobian(q)
            if strokes is not None:
                residual = np.concatenate([residual, self._strokes_of(q) - strokes])
                rows = np.vstack([rows, np.eye(self.model.nv)[self.strokes]])
            if np.abs(residual).max() < 1e-14:
                break
            q = pin.integrate(self.model, q, -np.linalg.lstsq(rows, residual, rcond=1e-12)[0])
        assert np.abs(residual).max() < 1e-11, "the chains do not close"
        return q

    def _strokes_of(self, q: Vector) -> Vector:
        return np.array([q[self.model.joints[j].idx_q] for j in self._rods]) - self.lengths

    def _loop_gap(self, placement: Any) -> Vector:
        count = 2 if self.plane else 3
        if not self._pairs:
            return np.zeros(0)
        return np.concatenate([(placement(a) - placement(b))[:count] for a, b in self._pairs])

    def _jacobian(self, q: Vector) -> Vector:
        def of(frame: int) -> Vector:
            return pin.computeFrameJacobian(self.model, self.data, q, frame, pin.LOCAL_WORLD_ALIGNED)

        count = 2 if self.plane else 3
        rows = [(of(a) - of(b))[:count] for a, b in self._pairs]
        return np.vstack([np.zeros((0, self.model.nv)), *rows])

    def _acceleration(self, frame: int) -> Vector:
        world = pin.LOCAL_WORLD_ALIGNED
        return pin.getFrameClassicalAcceleration(self.model, self.data, frame, world).linear

    # ---- the tree, depth first -----------------------------------------------------------

    def _add_children(self, parent: str) -> None:
        for name, strut in self.machine.struts():
            if strut.ends[0].partition(".")[0] == parent:
                self._add_strut(name, strut)
        for name, body in self.machine.bodies.items():
            if body.joint.parent == parent:
                self._add_body(name)

    def _add_body(self, name: str) -> None:
        body = self.machine.bodies[name]
        joint, axis = body.joint, np.array(body.joint.axis)
        at = pin.SE3(pin.rpy.rpyToMatrix(*joint.rotation), self._point(f"{joint.parent}.{joint.at}"))
        kinds = {
            "revolute": lambda: pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis)),
            "prismatic": lambda: pin.JointModelPrismaticUnaligned(axis / np.linalg.norm(axis)),
            "universal": lambda: pin.JointModelUniversal(axis[:3], axis[3:]),
            "spherical": pin.JointModelSpherical,
            "free": pin.JointModelPlanar if self.plane else pin.JointModelFreeFlyer,
        }
        number = self.model.addJoint(self._joints[joint.parent], kinds[joint.kind](), at, name)
        self._joints[name] = number
        if joint.assembly:
            self._assembly[number] = list(joint.assembly)
        J = [self._number(x) for x in body.J]
        if self.plane:
            inertia = np.diag([0.0, 0.0, J[0] if J else 0.0])
        else:
            xx, yy, zz, xy, xz, yz = [*J, *[0.0] * 6][:6]
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        self._hang(name, self._number(body.m), self._vector(body.c), inertia)
        self._add_children(name)

    def _add_strut(self, name: str, strut: Strut) -> None:
        """Add housing and rod, or a link; z is along it in space, x in the plane."""
        start, at = strut.ends[0].partition(".")[0], self._point(strut.ends[0])
        R, offset = self._assembled[name]
        base = pin.SE3(R, at)
        hinge = pin.JointModelRZ() if self.plane else pin.JointModelUniversal(np.eye(3)[0], np.eye(3)[1])
        housing = self.model.addJoint(self._joints[start], hinge, base, name)
        self._joints[name] = housing
        if self.plane:
            self._assembly[housing] = [0.0]
        along = np.array([1.0, 0.0, 0.0]) if self.plane else np.array([0.0, 0.0, 1.0])
        J = self._number(strut.J)
        across = np.diag([0.0, 0.0, 1.0]) if self.plane else np.diag([1.0, 1.0, 0.0])
        if isinstance(strut, Actuator):
            m, share = self._number(strut.m), self._number(strut.rod_share)
            motor = self._number(strut.motor_m)
            self._hang(name, (1.0 - share) * m + motor, self._number(strut.c) * along, J * across)
            slide = pin.JointModelPX() if self.plane else pin.JointModelPZ()
            rod = self.model.addJoint(housing, slide, pin.SE3.Identity(), f"{name} rod")
            self._joints[f"{name} rod"] = rod
            self._assembly[rod] = [offset]
            back = -self._number(strut.rod_c) * along
            self._hang(f"{name} rod", share * m, back, self._number(strut.rod_J) * across)
            self._rods.append(rod)
            self._rod_masses.append(share * m)
            end = self.model.addFrame(
                pin.Frame(f"{name} end", rod, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
            )
        else:
            self._hang(name, self._number(strut.m), self._number(strut.c) * along, J * across)
            length = getattr(strut, "length", None)
            far = (offset if length is None else self._number(length)) * along
            end = self.model.addFrame(
                pin.Frame(f"{name} end", housing, 0, pin.SE3(np.eye(3), far), pin.FrameType.OP_FRAME)
            )
        self._pending = getattr(self, "_pending", [])
        self._pending.append((end, strut.ends[1], name))

    def _start(self) -> Vector:
        for end, point, name in self._pending:
            self._pairs.append((end, self._frame(f"{name} pin", point)))
        order = [*self.machine.actuators]
        pairs = sorted(
            zip(self._rods, self._rod_masses, strict=True),
            key=lambda pair: order.index(self.model.names[pair[0]].removesuffix(" rod")),
        )
        passive = [self._joints[name] for name, body in self.machine.bodies.items() if body.joint.is_passive]
        self._rods = [*(rod for rod, _ in pairs), *passive]
        self._rod_masses = [*(m for _, m in pairs), *(0.0 for _ in passive)]
        self.data = self.model.createData()
        self.strokes = np.array([self.model.joints[j].idx_v for j in self._rods])
        q = pin.neutral(self.model)
        for number, values in self._assembly.items():
            joint = self.model.joints[number]
            q[joint.idx_q : joint.idx_q + joint.nq] = _position(joint.nq, values)
        return q

    def _assembled_places(self) -> dict[str, tuple[Vector, float]]:
        """Return for each strut the rotation of its axis in its first body, and its length, at assembly."""
        placements: dict[str, Any] = {GROUND: pin.SE3.Identity()}
        for name, body in self.machine.bodies.items():
            joint = body.joint
            at = pin.SE3(pin.rpy.rpyToMatrix(*joint.rotation), self._point(f"{joint.parent}.{joint.at}"))
            placements[name] = placements[joint.parent] * at * self._placement_of(name)
        values = {}
        for name, strut in self.machine.struts():
            a, b = (placements[p.partition(".")[0]].act(self._point(p)) for p in strut.ends)
            direction = placements[strut.ends[0].partition(".")[0]].rotation.T @ (b - a)
            length = float(np.linalg.norm(direction))
            u = direction / length
            if self.plane:
                R = np.array([[u[0], -u[1], 0.0], [u[1], u[0], 0.0], [0.0, 0.0, 1.0]])
            else:
                R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), u).matrix()
            values[name] = R, length
        return values

    def _placement_of(self, name: str) -> Any:
        """Return the placement of a body at its joint's assembly coordinates."""
        joint = self.machine.bodies[name].joint
        values = list(joint.assembly) or [0.0] * 6
        axis = np.array(joint.axis)
        if joint.kind == "revolute":
            return pin.SE3(pin.AngleAxis(values[0], axis / np.linalg.norm(axis)).matrix(), np.zeros(3))
        if joint.kind == "prismatic":
            return pin.SE3(np.eye(3), values[0] * axis / np.linalg.norm(axis))
        assert not any(values[3:]), "the assembly pose of other joints is not turned here"
        return pin.SE3(np.eye(3), np.array(values[:3]))

    # ---- numbers -------------------------------------------------------------------------

    def _hang(self, name: str, m: float, at: Vector, J: Vector) -> None:
        """Add a mass; Pinocchio takes inertias about the centre that no body has, too."""
        if self._joints[name]:
            inertia = pin.Inertia(m, np.asarray(at), J)
            self.model.appendBodyToJoint(self._joints[name], inertia, pin.SE3.Identity())

    def _frame(self, name: str, point: str) -> int:
        joint = self._joints[point.partition(".")[0]]
        at = pin.SE3(np.eye(3), self._point(point))
        return self.model.addFrame(pin.Frame(name, joint, 0, at, pin.FrameType.OP_FRAME))

    def _point(self, name_of_point: str) -> Vector:
        body, _, name = name_of_point.partition(".")
        if not name:
            return np.zeros(3)
        point = self.machine.points(body)[name]
        at = self._vector(point.position)
        if point.polar is not None:
            radius, angle = (self._number(x) for x in point.polar)
            at = at + radius * np.array([math.cos(angle), math.sin(angle), 0.0])
        return at if point.origin is None else at + self._point(f"{body}.{point.origin}")

    def _vector(self, numbers: Sequence[Any]) -> Vector:
        return np.array([*(self._number(x) for x in numbers), 0.0, 0.0, 0.0][:3])

    def _number(self, x: float | str) -> float:
        if not isinstance(x, str):
            return float(x)
        value = self.machine.parameters[x.removeprefix("-")].value
        return -value if x.startswith("-") else value


def _position(nq: int, values: Sequence[float]) -> list[float]:
    """Return assembly coordinates as Pinocchio has them: quaternions, or cosine and sine."""
    if nq == 7:
        return [*values[:3], 0.0, 0.0, 0.0, 1.0]
    if nq == 4 and len(values) == 3:
        return [*values[:2], math.cos(values[2]), math.sin(values[2])]
    return list(values)
