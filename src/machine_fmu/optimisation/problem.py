"""The data of the optimisation as printed in the paper, their contradictions, and ways to read them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, get_args

import numpy as np

from hdrm_fmu.base import lowest_ground
from hdrm_fmu.dynamics import bias
from hdrm_fmu.parameters import HDRM, PAYLOAD, HdrmParameters, Three

from ..spline import TrajectoryError
from ..trajectory import JOINTS
from .reaching import nearest_position, nearest_posture
from .surroundings import GROUND_POINTS, body_approach, ground_approach, postures


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


Two = tuple[float, float]
"""A position in the plane: x horizontal, y up, in m from O1."""


class Load(NamedTuple):
    """A payload in kg between two moments, which are fractions of the duration."""

    first: float
    last: float
    payload: float


@dataclass(frozen=True)
class Via:
    """A position that the tip passes on its way.

    Raises:
        TrajectoryError: A value is not as described.
    """

    tip: Two
    """Position of the tip from O1, m."""
    at: float | None = None
    """When it is there, as a fraction of the duration; None spreads all way-points evenly."""
    payload: float | None = None
    """Mass at the tip from here on, kg: the machine stops here. None is the mass before."""

    def __post_init__(self) -> None:
        _check("tip of a way-point", self.tip, Two)
        if self.at is not None and (not _is_number(self.at) or not 0.0 < self.at < 1.0):
            raise TrajectoryError(f"at of a way-point is {self.at!r}; it must be between 0 and 1.")
        if self.payload is not None and (not _is_number(self.payload) or self.payload < 0.0):
            raise TrajectoryError(f"payload of a way-point is {self.payload!r}; it must be 0 kg or more.")


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
    tip_E: Two | None = None
    """Position of the tip at the end from O1, m, instead of q_E; the optimiser chooses the strokes."""
    via: tuple[Via, ...] = ()
    """Positions that the tip passes, in order."""
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
    """Mass at the tip, kg; way-points can change it."""
    machine: HdrmParameters = HDRM
    """The manipulator; its strokes q_LB and q_UB bound the positions."""

    def __post_init__(self) -> None:
        for part in fields(self):
            if part.name not in ("machine", "via"):
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
        aims = self._out_of_order() or self._out_of_reach()
        return [*empty, *(message for found in others for message in found), *aims]

    @property
    def moments(self) -> list[float]:
        """When the tip passes its way-points, as fractions of the duration."""
        evenly = [(i + 1) / (len(self.via) + 1) for i in range(len(self.via))]
        return [x if via.at is None else via.at for via, x in zip(self.via, evenly, strict=True)]

    @property
    def loads(self) -> list[Load]:
        """Payloads on the way, in order."""
        found = [Load(0.0, 1.0, self.payload)]
        for moment, via in zip(self.moments, self.via, strict=True):
            if via.payload is not None:
                found[-1:] = [found[-1]._replace(last=moment), Load(moment, 1.0, via.payload)]
        return found

    @property
    def guesses(self) -> list[Three]:
        """Strokes at way-points and at the end from which a solution is sought.

        Each one is the posture nearest to the one before that is above the ground.
        """
        return [found or self.q_S for found in self._guesses]

    @cached_property
    def _guesses(self) -> list[Three | None]:
        """Guesses, None for a position that is out of reach."""
        found, last = list[Three | None](), self.q_S
        for _, position in self._aims():
            found.append(nearest_posture(self.machine, position, last, self._is_high))
            last = found[-1] or last
        return found if self.tip_E is not None else [*found, self.q_E]

    def _aims(self) -> list[tuple[str, Two]]:
        """Return positions that the tip must reach, with their names."""
        ends = [] if self.tip_E is None else [("tip_E", self.tip_E)]
        return [(f"via[{i + 1}].tip", via.tip) for i, via in enumerate(self.via)] + ends

    def _is_high(self, strokes: np.ndarray) -> np.ndarray:
        """Return for each row of strokes whether it keeps the clearance from the ground."""
        if self.ground_clearance is None:
            return np.full(len(strokes), True)
        at = postures(self.machine, strokes)
        lowest = np.min([at[name][:, 1] for name in GROUND_POINTS], axis=0)
        return lowest >= self.ground_height + self.ground_clearance

    def _out_of_order(self) -> list[str]:
        return [
            f"via[{i + 2}].at = {b:g} is not after via[{i + 1}].at = {a:g}"
            for i, (a, b) in enumerate(pairwise(self.moments))
            if a >= b
        ]

    def _out_of_reach(self) -> list[str]:
        """Return messages for positions that no posture reaches above the ground."""
        found = []
        for (name, position), guess in zip(self._aims(), self._guesses, strict=False):
            here, above = f"{name} = {position[0]:g},{position[1]:g} m", position[1] - self.ground_height
            if self.ground_clearance is not None and above < self.ground_clearance:
                side = "above" if above >= 0.0 else "below"
                found.append(f"{here} is {abs(above):.3g} m {side} {self._ground()}")
            elif guess is None:
                near = nearest_position(self.machine, position)
                distance = math.dist(near, position)
                found.append(
                    f"{here} is out of the tip's reach by {distance:.3g} m; the nearest position in reach is "
                    f"{near[0]:.4g},{near[1]:.4g} m"
                )
        return found

    def _ground(self) -> str:
        return (
            f"the ground, which is at y = {self.ground_height:.4g} m; "
            f"ground_clearance = {self.ground_clearance:g} m is required"
        )

    @property
    def _fixed(self) -> list[str]:
        """Names of the ends whose strokes are fixed."""
        return ["q_S"] if self.tip_E is not None else ["q_S", "q_E"]

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
        for name, unit in (*((name, "m") for name in self._fixed), ("v_S", "m/s"), ("v_E", "m/s")):
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
        if self.tip_E is not None:
            return []  # its strokes are not known yet
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
            if self.tip_E is None and not ends[0] - 1e-9 <= way <= ends[1] + 1e-9:
                found.append(
                    f"the {joint}'s way of {way:.4g} m is not possible in t_M = {t_M:g} s with {bounds}: "
                    f"they allow {ends[0]:.4g} to {ends[1]:.4g} m"
                )
        return found

    def _too_heavy(self) -> list[str]:
        """Return messages for postures that the forces cannot hold at rest."""
        found, at_rest = [], (0.0, 0.0, 0.0)
        for name in self._fixed:
            q = getattr(self, name)
            if not self._within_strokes(q):
                continue  # reported before, and triangles may not close there
            payload = self.loads[0 if name == "q_S" else -1].payload
            for i, force in enumerate(bias(self.machine, q, at_rest, payload)):
                if not self.f_LB[i] <= force <= self.f_UB[i]:
                    found.append(
                        f"holding {name} takes {force / 1e3:.4g} kN of the {JOINTS[i]}, beyond its bounds, "
                        f"{self.f_LB[i] / 1e3:g} to {self.f_UB[i] / 1e3:g} kN"
                    )
        return found

    def _too_near(self) -> list[str]:
        """Return messages for postures at the start or end that are too close to the ground or the body."""
        found, machine = [], self.machine
        for name in self._fixed:
            q, time = np.array([getattr(self, name)]), np.zeros(1)
            if not self._within_strokes(q[0]):
                continue
            ground = ground_approach(machine, self.ground_height, time, q)
            if self.ground_clearance is not None and ground.distance < self.ground_clearance:
                side = "above" if ground.distance >= 0.0 else "below"
                height = f"{abs(ground.distance):.3g} m {side}"
                found.append(f"{name} puts {ground.part} {height} {self._ground()}")
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


_FORMS = {
    1: "a finite number",
    2: "two finite numbers: x and y from O1",
    3: "three finite numbers: lift, tilt, telescope",
}
"""Forms of values by their number of numbers."""


def _check(name: str, value: object, kind: object) -> None:
    if value is None and kind in (Three | None, Two | None, float | None):
        return
    count = 3 if kind in (Three, Three | None) else 2 if kind in (Two, Two | None) else 1
    values: Sequence[object] = value if count > 1 and isinstance(value, (tuple, list)) else [value]
    if len(values) != count or not all(_is_number(x) for x in values):
        wanted = _FORMS[count] + (", or off" if type(None) in get_args(kind) and name != "ground" else "")
        raise TrajectoryError(f"{name} is {value!r}; it must be {wanted}.")


def _is_number(x: object) -> bool:
    return isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x) and abs(x) < 1e9
