"""The motion that the three joints shall follow together, as a B-spline."""

import math
from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    DiscreteState,
    Output,
    Parameter,
    clamp,
    dot,
    logical_and,
    where,
)

from .spline_window import COEFFICIENTS, DEGREE, KNOTS, basis, in_order, window

_ROUNDING = 1e-9
"""Time in s beyond first and last knot that still belongs to the spline: tools round their times."""

JOINTS = ("lift", "tilt", "telescope")
"""The joints in the order of the outputs."""

_AT_REST = (DEGREE + 1) // 2
"""Coefficients at either end of one quintic move from rest to rest."""


def _coefficients(joint: str, start: float, end: float) -> Parameter:
    return Parameter(
        [start] * _AT_REST + [end] * (COEFFICIENTS - _AT_REST),
        shape=COEFFICIENTS,
        unit="m",
        name=f"coefficient.{joint}",
        description=f"Coefficient (control point) of the stroke of {joint}; the last one fills up",
    )


class Trajectory(Block):
    """A B-spline of three strokes with its exact derivatives, held before its first and after its last knot.

    The start values are one quintic move from rest to rest between the end points of Table II.
    """

    default_experiment = DefaultExperiment(stop_time=37.7, step_size=1e-3)

    degree = Parameter(DEGREE, minimum=1, maximum=DEGREE, description="Degree of the polynomials")
    knot = Parameter(
        [0.0] * (DEGREE + 1) + [37.7] * (KNOTS - DEGREE - 1),
        shape=KNOTS,
        unit="s",
        description="Knots in increasing order, first and last degree + 1 times; the last one fills up",
    )
    c_lift = _coefficients("lift", 0.244, 0.270)
    c_tilt = _coefficients("tilt", 0.389, 0.442)
    c_telescope = _coefficients("telescope", 0.499, 0.348)

    order = DiscreteState(
        1.0, name="knots_in_increasing_order", description="1; infinite, which ends the run, if they are not"
    )

    x_d = Output(shape=3, unit="m", nominal=0.1, description="Reference position of lift, tilt and telescope")
    v_d = Output(shape=3, unit="m/s", nominal=0.1, description="Reference speed of lift, tilt and telescope")
    a_d = Output(shape=3, unit="m/s2", description="Reference acceleration of lift, tilt and telescope")

    def update(self, v: Any) -> dict[str, Any]:
        """Knots out of order end the run: nothing else would say so."""
        return {"order": where(in_order(v.knot), 1.0, math.inf)}

    def outputs(self, v: Any) -> dict[str, Any]:
        """The spline and its derivatives; beyond its ends the position there and no motion."""
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
