"""Masses and moments of the manipulator's bodies along their four axes.

`p` is any object with the attributes of HdrmParameters.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from .kinematics import Posture


class Moments(NamedTuple):
    """Bodies on one axis: their mass and its moments about the axis' origin."""

    m: Any
    """Mass, kg."""
    S: Any
    """Sum of mass times place, kg m."""
    J: Any
    """Inertia about the origin, kg m2."""


def body(m: Any, s: Any, J: Any) -> Moments:
    """Return the moments of a body of mass m with the centre of mass s and the inertia J about it."""
    return Moments(m, m * s, J + m * s * s)


def together(a: Moments, b: Moments) -> Moments:
    """Add the moments of bodies on the same axis."""
    return Moments(a.m + b.m, a.S + b.S, a.J + b.J)


class Slider(NamedTuple):
    """An axis with bodies that turn with it; some slide along it with an actuator's stroke."""

    all: Moments
    """All bodies, with sliding ones at their present places."""
    m: Any
    """Mass of the sliding bodies, kg."""
    S: Any
    """Sum of mass times place of the sliding bodies, kg m."""
    m_own: Any
    """Sliding mass whose inertia along the axis counts in the manipulator: without an actuator's tube, kg."""


class Bodies(NamedTuple):
    """All bodies of the manipulator in one posture."""

    lift_boom: Moments
    """Axis of the lift boom, from O1."""
    boom: Slider
    """Axis of outer and inner boom, from O2, with telescope actuator and payload."""
    lift_actuator: Slider
    """Axis of the lift actuator, from its fixed pin."""
    tilt_actuator: Slider
    """Axis of the tilt actuator, from its fixed pin."""


def bodies(p: Any, at: Posture, q: Sequence[Any], payload: Any) -> Bodies:
    """Return the bodies in the posture `at` of the strokes q in m, with a payload in kg."""
    return Bodies(
        body(p.lift_m, p.lift_c, p.lift_J),
        _boom(p, p.reach + q[2], payload),
        _actuator(p, 0, at.lift.L),
        _actuator(p, 1, at.tilt.L),
    )


def _boom(p: Any, tip: Any, payload: Any) -> Slider:
    """Return outer and inner boom with the telescope actuator and the tip at `tip` m from O2."""
    outer = body(p.outer_m, p.outer_c, p.outer_J)
    inner = body(p.inner_m, tip - p.inner_c, p.inner_J)
    carried = together(inner, body(payload, tip, payload * p.payload_J))
    tube = _tube(p, 2, tip)
    sliding = together(carried, tube)
    everything = together(together(outer, _housing(p, 2)), sliding)
    return Slider(everything, sliding.m, sliding.S, carried.m)


def _actuator(p: Any, i: int, L: Any) -> Slider:
    """Return an actuator between pins that are L m apart."""
    tube = _tube(p, i, L)
    return Slider(together(_housing(p, i), tube), tube.m, tube.S, 0.0)


def _housing(p: Any, i: int) -> Moments:
    return body((1.0 - p.tube_share) * p.M_BS[i] + p.motor_m[i], p.housing_c[i], p.housing_J[i])


def _tube(p: Any, i: int, end: Any) -> Moments:
    return body(p.tube_share * p.M_BS[i], end - p.tube_c[i], p.tube_J[i])
