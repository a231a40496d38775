"""The reference motion of the three joints as a B-spline."""

from itertools import pairwise
from typing import Any

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

JOINTS = ("lift", "tilt", "telescope")
"""The joints in the order of the outputs."""

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


class Trajectory(Block):
    """A B-spline of three strokes with exact derivatives, held before its first and after its last knot.

    The start values are one quintic move from rest to rest between the end points of Table II.
    """

    default_experiment = DefaultExperiment(stop_time=37.7, step_size=1e-3)

    degree = Parameter(DEGREE, minimum=1, maximum=DEGREE, symbol="p", description="Degree of the polynomials")
    knot = Parameter(
        [0.0] * (DEGREE + 1) + [37.7] * (KNOTS - DEGREE - 1),
        shape=KNOTS,
        unit="s",
        symbol="t_i",
        description="Knots in increasing order, first and last degree + 1 times; fill up with the last one",
    )
    c_lift = _coefficients("lift", 0.244, 0.270)
    c_tilt = _coefficients("tilt", 0.389, 0.442)
    c_telescope = _coefficients("telescope", 0.499, 0.348)

    x_d = Output(shape=3, unit="m", nominal=0.1, description="Reference position of lift, tilt and telescope")
    v_d = Output(shape=3, unit="m/s", nominal=0.1, description="Reference speed of lift, tilt and telescope")
    a_d = Output(shape=3, unit="m/s2", description="Reference acceleration of lift, tilt and telescope")

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
        knots, rows = window(t, v.knot, [v.c_lift, v.c_tilt, v.c_telescope])
        counts = basis(t, knots, v.degree)
        return {
            "x_d": [dot(counts.x, c) for c in rows],
            "v_d": [where(moves, dot(counts.v, c), 0.0) for c in rows],
            "a_d": [where(moves, dot(counts.a, c), 0.0) for c in rows],
        }
