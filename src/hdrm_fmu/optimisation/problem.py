"""The data of the optimisation as printed in the paper, their contradictions, and ways to read them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum

import numpy as np

from ..dynamics import bias
from ..parameters import HDRM, PAYLOAD, HdrmParameters, Three
from ..spline import TrajectoryError
from ..trajectory import JOINTS
from .surroundings import body_approach, ground_approach, lowest_ground


class EndSpeed(StrEnum):
    """How to read a speed v_E beyond its own bound, such as the printed one of the telescope."""

    CLIP = "clip"
    """As the bound, which is our substitution."""
    EXEMPT = "exempt"
    """As printed: only the end point and the approach to it may exceed the bound."""
    DECIMAL = "decimal"
    """As a tenth, for a misprinted decimal point."""
    REST = "rest"
    """All three joints end at rest."""


@dataclass(frozen=True)
class MotionProblem:
    """Conditions on the motion by joint: lift, tilt, telescope; the defaults are Table II.

    Raises:
        TrajectoryError: A value is not three finite numbers, or not positive if it must be.
    """

    q_S: Three = (0.244, 0.389, 0.499)
    """Strokes at the start, m."""
    q_E: Three = (0.270, 0.442, 0.348)
    """Strokes at the end, m."""
    v_S: Three = (0.0016, 0.0, -0.0024)
    """Speeds at the start, m/s."""
    v_E: Three = (0.0607, -0.0808, -0.5477)
    """Speeds at the end, m/s."""
    v_LB: Three = (-0.136, -0.100, -0.210)
    """Lower bounds of the speeds, m/s."""
    v_UB: Three = (0.136, 0.100, 0.210)
    """Upper bounds of the speeds, m/s."""
    f_LB: Three = (-89.8e3, -68.6e3, -6.1e3)
    """Lower bounds of the actuators' forces, N."""
    f_UB: Three = (89.8e3, 68.6e3, 6.1e3)
    """Upper bounds of the actuators' forces, N."""
    a_LB: Three | None = None
    """Lower bounds of the accelerations, m/s2; None is no bound."""
    a_UB: Three | None = None
    """Upper bounds of the accelerations, m/s2; None is no bound."""
    j_LB: Three | None = None
    """Lower bounds of the jerks, m/s3; None is no bound."""
    j_UB: Three | None = None
    """Upper bounds of the jerks, m/s3; None is no bound."""
    ground: float | None = None
    """Height of the ground above O1, m; None is the foot of the base, where pictures draw it."""
    ground_clearance: float | None = 0.2
    """Smallest height of tip, elbow and pins above the ground, m; None is no ground."""
    body_clearance: float | None = 0.2
    """Smallest distance of the outer and inner boom from base and lift actuator, m; None is no limit."""
    t_M: float = 37.7
    """The longest time that the motion may take, s."""
    payload: float = PAYLOAD
    """Mass at the tip, kg."""
    machine: HdrmParameters = HDRM
    """The manipulator; its strokes q_LB and q_UB bound the positions."""

    def __post_init__(self) -> None:
        for part in fields(self):
            if part.name != "machine":
                _check(part.name, getattr(self, part.name), part.type)
        for name in ("ground_clearance", "body_clearance"):
            if (getattr(self, name) or 0.0) < 0.0:
                raise TrajectoryError(f"{name} is {getattr(self, name):g}; it must be 0 m or more, or off.")
        for name, least in (("t_M", "more than 0 s"), ("payload", "0 kg or more")):
            if getattr(self, name) < 0.0 or (name == "t_M" and self.t_M == 0.0):
                raise TrajectoryError(f"{name} is {getattr(self, name):g}; it must be {least}.")

    def contradictions(self) -> list[str]:
        """Return a message for each contradiction found in the data."""
        empty = self._empty_bounds()
        gentle = [] if empty else self._too_gentle()
        others = (self._broken_bounds(), self._too_late(), gentle, self._too_heavy(), self._too_near())
        return [*empty, *(message for found in others for message in found)]

    @property
    def ground_height(self) -> float:
        """Height of the ground in m from O1."""
        return lowest_ground(self.machine) if self.ground is None else self.ground

    def beyond_bounds(self) -> list[int]:
        """Return the joints, counted from 0, whose v_E is beyond its own bound."""
        return [i for i in range(3) if not self.v_LB[i] <= self.v_E[i] <= self.v_UB[i]]

    def read_as(self, reading: EndSpeed) -> "MotionProblem":
        """Return the problem with the end speeds of a reading."""
        beyond, v_E = self.beyond_bounds(), list(self.v_E)
        for i in beyond:
            if reading == EndSpeed.CLIP:
                v_E[i] = min(max(v_E[i], self.v_LB[i]), self.v_UB[i])
            elif reading == EndSpeed.DECIMAL:
                v_E[i] /= 10.0
        if reading == EndSpeed.REST:
            v_E = [0.0] * 3
        return replace(self, v_E=(v_E[0], v_E[1], v_E[2]))

    def _empty_bounds(self) -> list[str]:
        bounds = [(f"{x}_LB", f"{x}_UB") for x in "vfaj"]
        bounds = [names for names in bounds if None not in (getattr(self, names[0]), getattr(self, names[1]))]
        pairs = [(low, high, i) for low, high in bounds for i in range(3)]
        values = [(getattr(self, low)[i], getattr(self, high)[i]) for low, high, i in pairs]
        return [
            f"{low}[{i + 1}] = {below:g} is above {high}[{i + 1}] = {above:g}"
            for (low, high, i), (below, above) in zip(pairs, values, strict=True)
            if below > above
        ]

    def _broken_bounds(self) -> list[str]:
        """Return messages for end points that are beyond the bounds of the motion between them."""
        found = []
        for name, unit in (("q_S", "m"), ("q_E", "m"), ("v_S", "m/s"), ("v_E", "m/s")):
            of = self.machine if name.startswith("q") else self
            lows, highs = (getattr(of, f"{name[0]}_{end}") for end in ("LB", "UB"))
            for i, (x, low, high) in enumerate(zip(getattr(self, name), lows, highs, strict=True)):
                if not low <= x <= high:
                    found.append(
                        f"{name}[{i + 1}] = {x:g} {unit} of the {JOINTS[i]} is beyond its own bounds, "
                        f"{low:g} to {high:g} {unit}{_times(x, low, high)}"
                    )
        return found

    def _too_late(self) -> list[str]:
        found = []
        for i, joint in enumerate(JOINTS):
            way = self.q_E[i] - self.q_S[i]
            speed = self.v_UB[i] if way > 0.0 else self.v_LB[i]
            least = math.inf if way and way * speed <= 0.0 else way / speed if way else 0.0
            if least > self.t_M:
                found.append(
                    f"the {joint}'s {abs(way):g} m take {least:.3g} s at its bound of {abs(speed):g} m/s, "
                    f"more than t_M = {self.t_M:g} s"
                )
        return found

    def _too_gentle(self) -> list[str]:
        """Return messages for ends that the bounds of the accelerations do not join within t_M.

        The farthest motion in t_M has its highest acceleration first, and then its lowest, and the nearest
        one the reverse.
        """
        if self.a_LB is None or self.a_UB is None:
            return []
        found, t_M = [], self.t_M
        for i, joint in enumerate(JOINTS):
            low, high, gain = self.a_LB[i], self.a_UB[i], self.v_E[i] - self.v_S[i]
            bounds = f"a_LB[{i + 1}] = {low:g} and a_UB[{i + 1}] = {high:g} m/s2"
            if not low * t_M <= gain <= high * t_M:
                found.append(
                    f"the {joint}'s change from v_S[{i + 1}] = {self.v_S[i]:g} to v_E[{i + 1}] = "
                    f"{self.v_E[i]:g} m/s is not possible in t_M = {t_M:g} s with {bounds}"
                )
                continue
            ends = [self.v_S[i] * t_M + _way(a, b, gain, t_M) for a, b in ((low, high), (high, low))]
            way = self.q_E[i] - self.q_S[i]
            if not ends[0] - 1e-9 <= way <= ends[1] + 1e-9:
                found.append(
                    f"the {joint}'s way of {way:.4g} m is not possible in t_M = {t_M:g} s with {bounds}: "
                    f"they allow {ends[0]:.4g} to {ends[1]:.4g} m"
                )
        return found

    def _too_heavy(self) -> list[str]:
        """Return messages for postures that the forces cannot hold at rest."""
        found, at_rest = [], (0.0, 0.0, 0.0)
        for name in ("q_S", "q_E"):
            q = getattr(self, name)
            if not self._within_strokes(q):
                continue  # reported before, and triangles may not close there
            for i, force in enumerate(bias(self.machine, q, at_rest, self.payload)):
                if not self.f_LB[i] <= force <= self.f_UB[i]:
                    found.append(
                        f"holding {name} takes {force / 1e3:.4g} kN of the {JOINTS[i]}, beyond its bounds, "
                        f"{self.f_LB[i] / 1e3:g} to {self.f_UB[i] / 1e3:g} kN"
                    )
        return found

    def _too_near(self) -> list[str]:
        """Return messages for postures at the start or end that are too close to the ground or the body."""
        found, machine = [], self.machine
        for name in ("q_S", "q_E"):
            q, time = np.array([getattr(self, name)]), np.zeros(1)
            if not self._within_strokes(q[0]):
                continue
            ground = ground_approach(machine, self.ground_height, time, q)
            if self.ground_clearance is not None and ground.distance < self.ground_clearance:
                side = "above" if ground.distance >= 0.0 else "below"
                found.append(
                    f"{name} puts {ground.part} {abs(ground.distance):.3g} m {side} the ground, which is at "
                    f"y = {self.ground_height:.4g} m; ground_clearance = {self.ground_clearance:g} m "
                    "is required"
                )
            body = body_approach(machine, time, q)
            if self.body_clearance is not None and body.distance < self.body_clearance:
                found.append(
                    f"{name} puts {body.part} {body.distance:.3g} m from the base or the lift actuator; "
                    f"body_clearance = {self.body_clearance:g} m is required"
                )
        return found

    def _within_strokes(self, q: Sequence[float] | np.ndarray) -> bool:
        return all(a <= x <= b for a, x, b in zip(self.machine.q_LB, q, self.machine.q_UB, strict=True))


def _way(first: float, last: float, gain: float, duration: float) -> float:
    """Return the way in m from rest with two accelerations in turn, which change the speed by gain."""
    until = (gain - last * duration) / (first - last) if first != last else duration
    rest = duration - until
    return 0.5 * first * until**2 + first * until * rest + 0.5 * last * rest**2


def _times(x: float, low: float, high: float) -> str:
    bound = high if x > high else low
    return f": {x / bound:.2g} times as much" if bound * x > 0.0 else ""


def _check(name: str, value: object, kind: object) -> None:
    if value is None and kind in (Three | None, float | None):
        return
    count = 3 if kind in (Three, Three | None) else 1
    values: Sequence[object] = value if count == 3 and isinstance(value, (tuple, list)) else [value]
    if len(values) != count or not all(_is_number(x) for x in values):
        wanted = "a finite number" if count == 1 else "three finite numbers: lift, tilt, telescope"
        raise TrajectoryError(f"{name} is {value!r}; it must be {wanted}.")


def _is_number(x: object) -> bool:
    return isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x) and abs(x) < 1e9
