"""The data of the optimisation as printed in the paper, their contradictions, and ways to read them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum

from ..dynamics import bias
from ..parameters import HDRM, PAYLOAD, HdrmParameters, Three
from ..spline import TrajectoryError
from ..trajectory import JOINTS


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
    t_M: float = 37.7
    """The longest time that the motion may take, s."""
    payload: float = PAYLOAD
    """Mass at the tip, kg."""
    machine: HdrmParameters = HDRM
    """The manipulator; its strokes q_LB and q_UB bound the positions."""

    def __post_init__(self) -> None:
        for part in fields(self):
            if part.name != "machine":
                _check(part.name, getattr(self, part.name), 3 if part.type is Three else 1)
        for name, least in (("t_M", "more than 0 s"), ("payload", "0 kg or more")):
            if getattr(self, name) < 0.0 or (name == "t_M" and self.t_M == 0.0):
                raise TrajectoryError(f"{name} is {getattr(self, name):g}; it must be {least}.")

    def contradictions(self) -> list[str]:
        """Return a message for each contradiction found in the data."""
        return [*self._empty_bounds(), *self._broken_bounds(), *self._too_late(), *self._too_heavy()]

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
        pairs = [(low, high, i) for low, high in (("v_LB", "v_UB"), ("f_LB", "f_UB")) for i in range(3)]
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

    def _too_heavy(self) -> list[str]:
        """Return messages for postures that the forces cannot hold at rest."""
        found, at_rest = [], (0.0, 0.0, 0.0)
        for name in ("q_S", "q_E"):
            q = getattr(self, name)
            if not all(a <= x <= b for a, x, b in zip(self.machine.q_LB, q, self.machine.q_UB, strict=True)):
                continue  # reported before, and triangles may not close there
            for i, force in enumerate(bias(self.machine, q, at_rest, self.payload)):
                if not self.f_LB[i] <= force <= self.f_UB[i]:
                    found.append(
                        f"holding {name} takes {force / 1e3:.4g} kN of the {JOINTS[i]}, beyond its bounds, "
                        f"{self.f_LB[i] / 1e3:g} to {self.f_UB[i] / 1e3:g} kN"
                    )
        return found


def _times(x: float, low: float, high: float) -> str:
    bound = high if x > high else low
    return f": {x / bound:.2g} times as much" if bound * x > 0.0 else ""


def _check(name: str, value: object, count: int) -> None:
    values: Sequence[object] = value if count == 3 and isinstance(value, (tuple, list)) else [value]
    if len(values) != count or not all(_is_number(x) for x in values):
        wanted = "a finite number" if count == 1 else "three finite numbers: lift, tilt, telescope"
        raise TrajectoryError(f"{name} is {value!r}; it must be {wanted}.")


def _is_number(x: object) -> bool:
    return isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x) and abs(x) < 1e9
