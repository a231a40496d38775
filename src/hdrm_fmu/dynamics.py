"""Motion and forces of the manipulator: inverse and forward dynamics, and energy.

`p` is any object with the attributes of HdrmParameters. `q`, `v`, `a` are stroke, speed and acceleration of
lift, tilt and telescope in m, m/s and m/s2. The payload is in kg. Forces are those of the screws in N,
positive against extension: M(q) a + bias(q, v) = f.

The inertia of the tubes is shared. The paper's A_eq contains the inertia of the whole M_BS along the screw,
so it must not count again here. In the manipulator the tubes have weight, inertia across the screw, and
inertia through the motion of their carriers. Their acceleration relative to their housings needs no force.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from fmublock import dot

from .bodies import Bodies, Moments, Slider, bodies
from .kinematics import Posture, Triangle, posture
from .plane import Vector, added, cross, normal, scaled

Matrix = list[list[Any]]


class _Motion(NamedTuple):
    """How an axis moves: acceleration of its origin (m/s2), angular speed and acceleration."""

    a: Vector
    omega: Any
    alpha: Any


class _Wrench(NamedTuple):
    """Force in N, and moment about an axis' origin in N m, that the motion of bodies requires."""

    force: Vector
    moment: Any


_NONE = (0.0, 0.0, 0.0)
_AT_REST = _Motion((0.0, 0.0), 0.0, 0.0)


def inverse_dynamics(p: Any, q: Sequence[Any], v: Sequence[Any], a: Sequence[Any], payload: Any) -> list[Any]:
    """Return the forces f_L of the three screws in N for a motion.

    This is (v_L, f_L) = RNEA(q, q', q'') of the paper. As q are strokes, v_L is `v`. The recursive
    Newton-Euler algorithm computes accelerations outwards from O1, then forces and moments inwards from the
    tip. Gravity is an upward acceleration of the base. A triangle's actuator turns its boom with its lever
    arm. Part of its own weight and inertia acts at the boom pin.

    Args:
        p: Parameters.
        q: Strokes, m.
        v: Speeds, m/s.
        a: Accelerations, m/s2.
        payload: Payload, kg.
    """
    at = posture(p, q)
    return _newton_euler(at, bodies(p, at, q, payload), p.gravity, v, a)


def _newton_euler(at: Posture, masses: Bodies, gravity: Any, v: Sequence[Any], a: Sequence[Any]) -> list[Any]:
    """Run the recursion of `inverse_dynamics`."""
    ground = _Motion((0.0, gravity), 0.0, 0.0)

    # outwards
    lift_boom = _boom_motion(ground, at.lift, v[0], a[0])
    lift_actuator = _actuator_motion(ground, at.lift, v[0], a[0])
    carried_O_2 = _carried(lift_boom, at.O_2)
    boom = _boom_motion(carried_O_2, at.tilt, v[1], a[1])
    carried_A_2 = _carried(lift_boom, at.A_2)
    tilt_actuator = _actuator_motion(carried_A_2, at.tilt, v[1], a[1])

    # inwards
    w_boom, f_telescope = _slider_wrench(masses.boom, at.boom_axis, boom, v[2], a[2])
    w_tilt, axial_tilt = _slider_wrench(masses.tilt_actuator, at.tilt_actuator, tilt_actuator, v[1], a[1])
    w_lift, axial_lift = _slider_wrench(masses.lift_actuator, at.lift_actuator, lift_actuator, v[0], a[0])
    f_tilt = _screw_force(at.tilt, w_boom.moment, w_tilt.moment, axial_tilt)
    moment = (
        _moment(masses.lift_boom, at.lift_axis, lift_boom)
        + _moment_at_base(w_boom, at.O_2)
        + _moment_at_base(w_tilt, at.A_2)
    )
    return [_screw_force(at.lift, moment, w_lift.moment, axial_lift), f_tilt, f_telescope]


def bias(p: Any, q: Sequence[Any], v: Sequence[Any], payload: Any) -> list[Any]:
    """Return the forces in N for weight and speed, without acceleration."""
    return inverse_dynamics(p, q, v, _NONE, payload)


def mass_matrix(p: Any, q: Sequence[Any], payload: Any) -> Matrix:
    """Return M(q) in kg as a list of rows; the kinetic energy is v^T M v / 2.

    It follows from the kinetic energy of the four axes, whose speeds are proportional to the strokes' speeds.
    """
    at = posture(p, q)
    return _mass_matrix(at, bodies(p, at, q, payload))


def forward_dynamics(
    p: Any,
    q: Sequence[Any],
    v: Sequence[Any],
    force: Sequence[Any],
    payload: Any,
    reflected: Sequence[Any] = _NONE,
) -> list[Any]:
    """Return the accelerations in m/s2 under the forces of the screws in N.

    `reflected` is a further inertia in kg of each stroke, such as A_eq/D_eq of its motor:
    (M + diag(reflected)) a = force - bias.
    """
    at = posture(p, q)
    masses = bodies(p, at, q, payload)
    M = _mass_matrix(at, masses)
    inertia = [[M[i][j] + reflected[i] if i == j else M[i][j] for j in range(3)] for i in range(3)]
    h = _newton_euler(at, masses, p.gravity, v, _NONE)
    return solve(inertia, [force[i] - h[i] for i in range(3)])


def energy(
    p: Any,
    q: Sequence[Any],
    v: Sequence[Any],
    payload: Any,
    reflected: Sequence[Any] = _NONE,
) -> Any:
    """Return the kinetic and potential energy in J; the latter is 0 with all masses at the height of O1.

    `reflected` as in `forward_dynamics`.
    """
    at = posture(p, q)
    masses = bodies(p, at, q, payload)
    M = _mass_matrix(at, masses)
    momentum = [dot(M[i], v) + reflected[i] * v[i] for i in range(3)]
    return 0.5 * dot(v, momentum) + p.gravity * _moment_of_height(at, masses)


def solve(M: Matrix, b: Sequence[Any]) -> list[Any]:
    """Solve M x = b for a symmetric, positive definite 3 x 3 matrix by M = L D L^T."""
    d_1 = M[0][0]
    l_21, l_31 = M[1][0] / d_1, M[2][0] / d_1
    d_2 = M[1][1] - l_21 * M[1][0]
    m_32 = M[2][1] - l_31 * M[1][0]
    l_32 = m_32 / d_2
    d_3 = M[2][2] - l_31 * M[2][0] - l_32 * m_32
    y_2 = b[1] - l_21 * b[0]
    x_3 = (b[2] - l_31 * b[0] - l_32 * y_2) / d_3
    x_2 = y_2 / d_2 - l_32 * x_3
    return [b[0] / d_1 - l_21 * x_2 - l_31 * x_3, x_2, x_3]


# ---- outwards ---------------------------------------------------------------------------


def _boom_motion(carrier: _Motion, chain: Triangle, v: Any, a: Any) -> _Motion:
    """Return the motion of a boom that an actuator turns: v = r gamma', with dr/dgamma = -d (1 - d/L)."""
    rate = v / chain.r
    growth = (a + chain.d * (1.0 - chain.d / chain.L) * rate * rate) / chain.r
    return _Motion(carrier.a, carrier.omega + rate, carrier.alpha + growth)


def _actuator_motion(carrier: _Motion, chain: Triangle, v: Any, a: Any) -> _Motion:
    """Return the motion of the actuator itself, which turns about its fixed pin: L psi' = d gamma'."""
    boom = _boom_motion(_AT_REST, chain, v, a)
    rate = boom.omega * chain.d / chain.L
    growth = (boom.alpha * chain.d + v * (boom.omega - 2.0 * rate)) / chain.L
    return _Motion(carrier.a, carrier.omega + rate, carrier.alpha + growth)


def _carried(carrier: _Motion, place: Vector) -> _Motion:
    """Return the motion of a point on a boom, given in m from the boom's origin."""
    across = scaled(carrier.alpha, normal(place))
    inward = scaled(-carrier.omega * carrier.omega, place)
    return _Motion(added(carrier.a, added(across, inward)), carrier.omega, carrier.alpha)


# ---- inwards ----------------------------------------------------------------------------


def _moment(masses: Moments, axis: Vector, motion: _Motion) -> Any:
    """Return the moment about the origin for the motion of bodies that do not slide on their axis."""
    return masses.S * cross(axis, motion.a) + masses.J * motion.alpha


def _slider_wrench(slider: Slider, axis: Vector, motion: _Motion, v: Any, a: Any) -> tuple[_Wrench, Any]:
    """Return force and moment for the motion of a slider, and the force along it on the sliding bodies."""
    coriolis = 2.0 * motion.omega * v
    squared = motion.omega * motion.omega
    along = slider.m * a - slider.all.S * squared
    across = slider.all.S * motion.alpha + slider.m * coriolis
    force = added(scaled(slider.all.m, motion.a), added(scaled(along, axis), scaled(across, normal(axis))))
    moment = _moment(slider.all, axis, motion) + slider.S * coriolis
    return _Wrench(force, moment), slider.m * dot(axis, motion.a) - slider.S * squared + slider.m_own * a


def _moment_at_base(wrench: _Wrench, place: Vector) -> Any:
    """Return the moment about O1 of a wrench whose origin is at this place."""
    return wrench.moment + cross(place, wrench.force)


def _screw_force(chain: Triangle, boom: Any, actuator: Any, axial: Any) -> Any:
    """Return the force of a screw that turns a boom, in N.

    `boom` is the moment about the boom's turning point for the boom and all that it carries, `actuator` the
    moment about the fixed pin for the actuator. `axial` is the tube's force along it.
    """
    return (boom + chain.d / chain.L * actuator) / chain.r + axial


# ---- energy -----------------------------------------------------------------------------


def _mass_matrix(at: Posture, masses: Bodies) -> Matrix:
    """Return M of `mass_matrix`: the axes' inertias over the angles, times angle per stroke."""
    g_1, g_2 = 1.0 / at.lift.r, 1.0 / at.tilt.r  # booms' angles per stroke, rad/m
    k_1, k_2 = at.lift.d / at.lift.L * g_1, at.tilt.d / at.tilt.L * g_2  # actuators'
    boom, actuator = masses.boom, masses.tilt_actuator
    boom_lever, actuator_lever = dot(at.boom_axis, at.O_2), dot(at.tilt_actuator, at.A_2)
    own = masses.lift_boom.J
    for slider, place, lever in ((boom, at.O_2, boom_lever), (actuator, at.A_2, actuator_lever)):
        own = own + slider.all.m * dot(place, place) + 2.0 * slider.all.S * lever + slider.all.J
    M_11 = g_1 * g_1 * own + k_1 * k_1 * masses.lift_actuator.all.J
    M_21 = g_1 * (
        g_2 * (boom.all.S * boom_lever + boom.all.J)
        + k_2 * (actuator.all.S * actuator_lever + actuator.all.J)
        + actuator.m * cross(at.A_2, at.tilt_actuator)
    )
    M_22 = g_2 * g_2 * boom.all.J + k_2 * k_2 * actuator.all.J
    M_31 = g_1 * boom.m * cross(at.O_2, at.boom_axis)
    return [[M_11, M_21, M_31], [M_21, M_22, 0.0], [M_31, 0.0, boom.m_own]]


def _moment_of_height(at: Posture, masses: Bodies) -> Any:
    """Return the sum of mass times height above O1, in kg m."""
    boom, lift, tilt = masses.boom.all, masses.lift_actuator.all, masses.tilt_actuator.all
    heights = masses.lift_boom.S * at.lift_axis[1]
    for part, place, axis in (
        (boom, at.O_2, at.boom_axis),
        (lift, at.A_1, at.lift_actuator),
        (tilt, at.A_2, at.tilt_actuator),
    ):
        heights = heights + part.m * place[1] + part.S * axis[1]
    return heights
