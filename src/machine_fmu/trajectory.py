"""The reference motion of joints as a B-spline."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, ClassVar

from fmublock import (
    Block,
    DefaultExperiment,
    Output,
    Parameter,
    clamp,
    dot,
    logical_and,
    logical_or,
    where,
)

from .spline_window import COEFFICIENTS, DEGREE, KNOTS, basis, window

_ROUNDING = 1e-9
"""Time in s before the first and after the last knot that counts as rounding by tools."""

_AT_REST = (DEGREE + 1) // 2
"""Equal coefficients at each end of a quintic move from rest to rest."""


def _coefficients(joint: str, start: float, end: float) -> Parameter:
    return Parameter(
        [start] * _AT_REST + [end] * (COEFFICIENTS - _AT_REST),
        shape=COEFFICIENTS,
        unit="m",
        name=f"coefficient.{joint}",
        symbol="c_i",
        description=f"Coefficient (control point) of the stroke of {joint}; fill up with the last one",
    )


class Motion(Block):
    """A B-spline of strokes with exact derivatives, held before its first and after its last knot.

    Attributes:
        joints: The joints in the order of the outputs.
    """

    joints: ClassVar[Sequence[str]]
    default_experiment = DefaultExperiment(stop_time=37.7, step_size=1e-3)

    degree = Parameter(DEGREE, minimum=1, maximum=DEGREE, symbol="p", description="Degree of the polynomials")
    knot = Parameter(
        [0.0] * (DEGREE + 1) + [37.7] * (KNOTS - DEGREE - 1),
        shape=KNOTS,
        unit="s",
        symbol="t_i",
        description="Knots in increasing order, first and last degree + 1 times; fill up with the last one",
    )

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require knots in increasing order, the first one degree + 1 times."""
        last = {f"knot[{KNOTS}] must come after knot[1]": v.knot[-1] > v.knot[0]}
        clamped = {
            f"knot[{i + 1}] must be knot[1] with a degree of {i} or more": logical_or(
                v.degree < i, v.knot[i] == v.knot[0]
            )
            for i in range(1, DEGREE + 1)
        }
        ordered = {
            f"knot[{i + 1}] must not come before knot[{i}]": b >= a
            for i, (a, b) in enumerate(pairwise(v.knot), 1)
        }
        return last | clamped | ordered

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the spline and its derivatives; beyond its ends, the position there and no motion."""
        first, last = v.knot[0], v.knot[-1]
        t = clamp(v.time, first, last)
        moves = logical_and(v.time >= first - _ROUNDING, v.time <= last + _ROUNDING)
        knots, rows = window(t, v.knot, [getattr(v, f"c_{joint}") for joint in self.joints])
        counts = basis(t, knots, v.degree)
        return {
            "x_d": [dot(counts.x, c) for c in rows],
            "v_d": [where(moves, dot(counts.v, c), 0.0) for c in rows],
            "a_d": [where(moves, dot(counts.a, c), 0.0) for c in rows],
        }


def trajectory_block(
    joints: Sequence[str], moves: Mapping[str, tuple[float, float]] | None = None
) -> type[Motion]:
    """Return the base of a block with the motion of these joints.

    Args:
        joints: The joints in the order of the outputs.
        moves: First and last stroke of each joint in m: its start values are one quintic move from rest to
            rest. Without, all strokes are 0.
    """
    names = join_joints(joints)
    variables: dict[str, Parameter | Output] = {
        f"c_{joint}": _coefficients(joint, *(moves or {}).get(joint, (0.0, 0.0))) for joint in joints
    }
    for attribute, unit, nominal, about in _OUTPUTS:
        variables[attribute] = Output(
            shape=len(joints), unit=unit, nominal=nominal, description=f"Reference {about} of {names}"
        )
    texts = {"__doc__": Motion.__doc__, "__module__": __name__, "__qualname__": Motion.__qualname__}
    return type(Motion.__name__, (Motion,), {**texts, "joints": tuple(joints), **variables})


def join_joints(joints: Sequence[str]) -> str:
    """Return the joints as text: lift, tilt and telescope."""
    return " and ".join([", ".join(joints[:-1]), joints[-1]] if len(joints) > 1 else joints)


_OUTPUTS = (
    ("x_d", "m", 0.1, "position"),
    ("v_d", "m/s", 0.1, "speed"),
    ("a_d", "m/s2", None, "acceleration"),
)
"""Attribute, unit, nominal value and meaning of the outputs."""

JOINTS = ("lift", "tilt", "telescope")
"""The joints of `Trajectory`."""


class Trajectory(
    trajectory_block(JOINTS, {"lift": (0.244, 0.270), "tilt": (0.389, 0.442), "telescope": (0.499, 0.348)})
):
    """A B-spline of three strokes with exact derivatives, held before its first and after its last knot.

    The start values are one quintic move from rest to rest between the end points of Table II.
    """
