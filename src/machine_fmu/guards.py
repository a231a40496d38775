"""Signs that a machine leaves the poses that it can follow: conditions at the start, and outputs with limits.

Only machines that need them have them: those whose pose Newton's method finds, and those with Cardan angles.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fmublock import Output, Parameter, arctan2, exp, maximum, minimum, where
from fmublock.variables import Variable

from .assembly import assemble
from .closure import Closure
from .description import Machine
from .dynamics import Dynamics
from .exact import plain
from .linear import Factors

_CARDAN = ("spherical", "free")
"""Joints of three angles in turn, of which the middle one must not come near a right angle."""


_ROUNDING = 1e-12
"""Largest residual in m that is rounding; it is shown as this, so that the output has a derivative."""


@dataclass(frozen=True)
class Guards:
    """What to observe in a machine.

    Attributes:
        references: The smallest slope of each step of Newton's method in the assembly pose; negative if the
            determinant of its slopes is.
        middles: Coordinates of middle angles.
    """

    references: Sequence[float]
    middles: Sequence[int]

    @classmethod
    def of(cls, machine: Machine, closure: Closure) -> "Guards":
        """Return what to observe in a machine."""
        names = [name for body in machine.bodies for name in machine.coordinates(body)]
        kinds = {f"{name}.y" for name, body in machine.bodies.items() if body.joint.kind in _CARDAN}
        middles = [i for i, name in enumerate(names) if name in kinds] if machine.dimensions == 3 else []
        if not closure.iterated:
            return cls((), middles)
        mechanism = assemble(machine)
        strokes = [closure.lengths[bar.name] - plain(bar.length) for bar in mechanism.actuators]
        passive = [closure.assembly[i] for i in mechanism.passive]
        dynamics = Dynamics(mechanism, closure, strokes, passive)
        return cls([float(_signed_slope(factors)) for factors in dynamics.newton_factors], middles)

    def parameters(self) -> dict[str, Variable]:
        """Return the limits by attribute."""
        limits = dict[str, Variable]()
        if self.references:
            limits["residual_max"] = Parameter(
                1e-6,
                unit="m",
                minimum=0.0,
                name="closure.residual_max",
                description="Largest residual of a pose that is reported as none of the strokes",
            )
            limits["singularity_max"] = Parameter(
                0.99,
                minimum=0.0,
                name="closure.singularity_max",
                description="Closeness to a singular pose from which on it is reported",
            )
        if self.middles:
            limits["angle_max"] = Parameter(
                math.radians(80.0),
                unit="rad",
                minimum=0.0,
                maximum=math.radians(89.0),
                name="cardan.angle_max",
                description="Largest middle angle of a spherical or free joint",
            )
        return limits

    def outputs(self, limits: Mapping[str, Variable]) -> dict[str, Variable]:
        """Return the outputs by attribute, with these limits."""
        outputs = dict[str, Variable]()
        if self.references:
            outputs["residual"] = Output(
                unit="m",
                limits=_parameter(limits, "residual_max"),
                name="closure.residual",
                description="Largest distance of the pose from strokes and closed loops, from 1e-12 m on",
            )
            outputs["singularity"] = Output(
                limits=_parameter(limits, "singularity_max"),
                name="closure.singularity",
                description="0.37 in the assembly, 1 in a singular pose, more beyond it",
            )
        if self.middles:
            outputs["cardan_angle"] = Output(
                shape=len(self.middles),
                unit="rad",
                limits=_parameter(limits, "angle_max"),
                name="cardan.angle",
                description="Middle angle of a spherical or free joint, about y",
            )
        return outputs

    def values(self, dynamics: Dynamics) -> dict[str, Any]:
        """Return the values of the outputs in a pose."""
        values = dict[str, Any]()
        if self.references:
            values["residual"] = _largest([_ROUNDING, *(abs(x) for x in dynamics.residuals)])
            pairs = zip(dynamics.newton_factors, self.references, strict=True)
            values["singularity"] = _largest([exp(-_signed_slope(f) / reference) for f, reference in pairs])
        if self.middles:
            angles = [dynamics.pose.values[i] for i in self.middles]
            values["cardan_angle"] = [arctan2(plain(a.sine), plain(a.cosine)) for a in angles]
        return values

    def conditions(self, v: Any, dynamics: Dynamics) -> dict[str, Any]:
        """Return the conditions at the start."""
        values, conditions = self.values(dynamics), dict[str, Any]()
        if self.references:
            sentence = "the pose at the start is singular, or beyond a singular one, seen from the assembly"
            conditions[sentence] = values["singularity"] < v.singularity_max
        frames = dynamics.mechanism.frames
        for coordinate, angle in zip(self.middles, values.get("cardan_angle", ()), strict=True):
            name = frames[dynamics.mechanism.frame_of(coordinate)].name
            sentence = (
                f"the angle '{name}' must be below cardan.angle_max; write a rotation of the joint, so that "
                "the angle is near 0"
            )
            conditions[sentence] = abs(angle) < v.angle_max
        return conditions


def _parameter(limits: Mapping[str, Variable], attribute: str) -> Parameter:
    limit = limits[attribute]
    assert isinstance(limit, Parameter)
    return limit


def _largest(values: Sequence[Any]) -> Any:
    largest = values[0]
    for value in values[1:]:
        largest = maximum(largest, value)
    return largest


def _signed_slope(factors: Factors) -> Any:
    """Return the smallest element of a triangle's diagonal, with the sign of the determinant."""
    diagonal, sign = [plain(x) for x in factors.diagonal()], factors.orientation
    smallest = abs(diagonal[0])
    for x in diagonal:
        smallest, sign = minimum(smallest, abs(x)), where(x >= 0.0, sign, -sign)
    return sign * smallest
