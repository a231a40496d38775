"""The problem of a motion between two postures: ends, bounds, payloads and obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from ..model import MachineModel
from ..spline import TrajectoryError
from .checks import check_numbers, is_number, is_position
from .obstacles import Obstacle
from .reaching import Reach, nearest_posture
from .surroundings import moving_points

Numbers = tuple[float, ...]
"""One number for each actuator, or the coordinates of a position."""


class EndSpeed(StrEnum):
    """How to read a speed v_E beyond its own bound, such as the printed one of the paper's telescope."""

    CLIP = "clip"
    """As the bound, which is our substitution."""
    EXEMPT = "exempt"
    """As printed: only the end point and the approach to it may exceed the bound."""
    DECIMAL = "decimal"
    """As a tenth, for a misprinted decimal point."""
    REST = "rest"
    """All joints end at rest."""


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

    tip: Numbers
    """Position of the tip, m."""
    at: float | None = None
    """When it is there, as a fraction of the duration; None spreads all way-points evenly."""
    payload: float | None = None
    """Mass at the tip from this point on, kg: the machine stops there. None keeps the mass."""

    def __post_init__(self) -> None:
        if not is_position(self.tip):
            raise TrajectoryError(f"tip of a way-point is {self.tip!r}; it must be a position.")
        if self.at is not None and (not is_number(self.at) or not 0.0 < self.at < 1.0):
            raise TrajectoryError(f"at of a way-point is {self.at!r}; it must be between 0 and 1.")
        if self.payload is not None and (not is_number(self.payload) or self.payload < 0.0):
            raise TrajectoryError(f"payload of a way-point is {self.payload!r}; it must be 0 kg or more.")


STROKES = ("q_S", "q_E", "v_S", "v_E", "v_LB", "v_UB", "f_LB", "f_UB", "a_LB", "a_UB", "j_LB", "j_UB")
"""Fields with a number for each actuator."""

CAN_BE_OFF = ("tip_E", "a_LB", "a_UB", "j_LB", "j_UB", "ground_clearance", "body_clearance")
"""Fields that are None for what does not limit the motion."""


@dataclass(frozen=True, kw_only=True)
class MotionProblem:
    """Conditions on the motion of a machine, by actuator.

    Raises:
        TrajectoryError: A value has another form than its field, or is not positive if it must be.
    """

    machine: MachineModel
    """The machine; its strokes q_LB and q_UB bound the positions."""
    machine_name: str = "machine"
    """Its name, or its file."""
    q_S: Numbers
    """Strokes at the start, m."""
    q_E: Numbers
    """Strokes at the end, m; not used with `tip_E`."""
    tip_E: Numbers | None = None
    """Position of the tip at the end, m, instead of q_E; the optimiser chooses the strokes."""
    via: tuple[Via, ...] = ()
    """Positions that the tip passes, in order."""
    v_S: Numbers
    """Speeds at the start, m/s."""
    v_E: Numbers
    """Speeds at the end, m/s."""
    v_LB: Numbers
    """Lower bounds of the speeds, m/s."""
    v_UB: Numbers
    """Upper bounds of the speeds, m/s."""
    f_LB: Numbers
    """Lower bounds of the actuators' forces, N."""
    f_UB: Numbers
    """Upper bounds of the actuators' forces, N."""
    a_LB: Numbers | None = None
    """Lower bounds of the accelerations, m/s2; None for no bound."""
    a_UB: Numbers | None = None
    """Upper bounds of the accelerations, m/s2; None for no bound."""
    j_LB: Numbers | None = None
    """Lower bounds of the jerks, m/s3; None for no bound."""
    j_UB: Numbers | None = None
    """Upper bounds of the jerks, m/s3; None for no bound."""
    ground: float | None = None
    """Height of the ground, m; None is the lowest corner of the machine's outline."""
    ground_clearance: float | None = None
    """Smallest height of moving points above the ground, m; None without a limit."""
    body_clearance: float | None = None
    """Smallest distance of moving bodies from the base and actuators on it, m; None without a limit."""
    obstacles: tuple[Obstacle, ...] = ()
    """What the machine keeps clear of."""
    t_M: float
    """The longest time that the motion may take, s."""
    payload: float
    """Mass at the tip, kg; way-points can change it."""

    def __post_init__(self) -> None:
        for name in (*STROKES, "tip_E", "ground", "ground_clearance", "body_clearance", "t_M", "payload"):
            labels = self.names if name in STROKES else self.axes if name == "tip_E" else ()
            value = getattr(self, name)
            if value is not None or name != "ground":
                check_numbers(name, value, labels, name in CAN_BE_OFF)
        self._check_positions()
        for name in ("ground_clearance", "body_clearance"):
            if (getattr(self, name) or 0.0) < 0.0:
                raise TrajectoryError(f"{name} is {getattr(self, name):g}; it must be 0 m or more, or off.")
        for name, least in (("t_M", "more than 0 s"), ("payload", "0 kg or more")):
            if getattr(self, name) < 0.0 or (name == "t_M" and self.t_M == 0.0):
                raise TrajectoryError(f"{name} is {getattr(self, name):g}; it must be {least}.")
        if self.ground_clearance is not None and self.ground is None and not len(self.machine.outline):
            raise TrajectoryError(
                "ground_clearance needs the height of the ground; write ground = 0.0, in m."
            )
        if self.body_clearance is not None and (len(self.axes) == 3 or not len(self.machine.outline)):
            raise TrajectoryError(
                "body_clearance needs a machine in the plane with [ground] outline, the corners of its base."
            )

    def _check_positions(self) -> None:
        """Raise TrajectoryError for positions of another dimension, and of a tip without payload."""
        if (self.via or self.tip_E is not None) and self.machine.mechanism.payload is None:
            raise TrajectoryError("the machine has no [payload], so it has no tip; write q_E without via.")
        for i, via in enumerate(self.via, 1):
            check_numbers(f"tip of via[{i}]", via.tip, self.axes, False)
        for obstacle in self.obstacles:
            if obstacle.dimensions != len(self.axes):
                coordinates = ", ".join(self.axes)
                raise TrajectoryError(
                    f"positions of {obstacle.label} must have the coordinates {coordinates}."
                )

    @property
    def names(self) -> tuple[str, ...]:
        """The actuators in their order."""
        return self.machine.names

    @property
    def axes(self) -> str:
        """Names of the coordinates of a position."""
        return "xyz"[: self.machine.dimensions]

    @property
    def moments(self) -> list[float]:
        """When the tip passes its way-points, as fractions of the duration."""
        evenly = [(i + 1) / (len(self.via) + 1) for i in range(len(self.via))]
        return [x if via.at is None else via.at for via, x in zip(self.via, evenly, strict=True)]

    @property
    def loads(self) -> list[Load]:
        """Payloads on the way, in order."""
        loads = [Load(0.0, 1.0, self.payload)]
        for moment, via in zip(self.moments, self.via, strict=True):
            if via.payload is not None:
                loads[-1:] = [loads[-1]._replace(last=moment), Load(moment, 1.0, via.payload)]
        return loads

    def payload_until(self, moment: float) -> float:
        """Return the payload in kg with which the machine arrives at a moment, a fraction of the duration."""
        return next(load.payload for load in self.loads if moment <= load.last)

    @property
    def tip(self) -> str:
        """The name of the tip among the machine's points."""
        payload = self.machine.machine.payload
        assert payload is not None  # positions need one
        return payload.at

    @property
    def aims(self) -> list[tuple[str, float, Numbers]]:
        """Positions that the tip must reach, with their names and moments."""
        ends = [] if self.tip_E is None else [("tip_E", 1.0, self.tip_E)]
        pairs = enumerate(zip(self.moments, self.via, strict=True), 1)
        return [(f"via[{i}].tip", moment, via.tip) for i, (moment, via) in pairs] + ends

    @property
    def guesses(self) -> list[Numbers]:
        """Strokes at way-points and at the end from which a solution is sought.

        Each one is the posture nearest to the one before that is above the ground.
        """
        return [posture or self.q_S for posture in self.postures]

    @cached_property
    def postures(self) -> list[Numbers | None]:
        """Guesses, None for a position that is out of reach."""
        postures, last = list[Numbers | None](), self.q_S
        for _, moment, position in self.aims:
            payload = self.payload_until(moment)
            heights = partial(self._heights, payload=payload)
            postures.append(nearest_posture(Reach(self.machine, payload), position, last, heights))
            last = postures[-1] or last
        return postures if self.tip_E is not None else [*postures, self.q_E]

    def _heights(self, strokes: np.ndarray, payload: float) -> np.ndarray:
        """Return for each row of strokes the heights in m of all points above those that are required."""
        if self.ground_clearance is None:
            return np.zeros((len(strokes), 1))
        points = self.machine.points(strokes, payload=payload)
        heights = np.column_stack([points[name][:, -1] for name in moving_points(self.machine)])
        return heights - self.ground_height - self.ground_clearance

    @property
    def ground_height(self) -> float:
        """Height of the ground in m."""
        if self.ground is not None:
            return self.ground
        return float(self.machine.outline[:, -1].min()) if len(self.machine.outline) else 0.0

    def beyond_bounds(self) -> list[int]:
        """Return the joints, counted from 0, whose v_E is beyond its own bound."""
        bounds = zip(self.v_LB, self.v_E, self.v_UB, strict=True)
        return [i for i, (low, v, high) in enumerate(bounds) if not low <= v <= high]

    def read_as(self, reading: EndSpeed) -> "MotionProblem":
        """Return the problem with the end speeds of a reading."""
        joints, v_E = self.beyond_bounds(), list(self.v_E)
        for i in joints:
            if reading == EndSpeed.CLIP:
                v_E[i] = min(max(v_E[i], self.v_LB[i]), self.v_UB[i])
            elif reading == EndSpeed.DECIMAL:
                v_E[i] /= 10.0
        if reading == EndSpeed.REST:
            v_E = [0.0] * len(v_E)
        return replace(self, v_E=tuple(v_E))

    def within_strokes(self, q: Sequence[float] | np.ndarray) -> bool:
        """Return whether strokes are within their bounds."""
        return all(a <= x <= b for a, x, b in zip(self.machine.q_LB, q, self.machine.q_UB, strict=True))
