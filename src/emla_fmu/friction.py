"""Friction of the screw, and what gearbox and screw take of the load: functions of the plant's values `v`."""

from typing import Any

from fmublock import logical_or, sqrt, where

from . import motion_law


def direction(v: Any) -> Any:
    """A smooth sign of the speed: -1 to 1, and proportional to it well within v_0."""
    return v.v_L / sqrt(v.v_L * v.v_L + v.v_0 * v.v_0)


def friction_force(v: Any) -> Any:
    """Coulomb and Stribeck friction at the screw in N, against the speed.

    F_S breaks away, F_C remains well above v_S (the form of Hess and Soom, 1990); within v_0 the force
    falls to zero like that of a damper.
    """
    ratio = v.v_L / v.v_S
    force = (v.F_C + (v.F_S - v.F_C) / (1.0 + ratio * ratio)) * direction(v)
    return where(logical_or(v.F_C > 0.0, v.F_S > 0.0), force, 0.0)


def load_torque(v: Any) -> Any:
    """Motor torque in N m that the load takes, D_eq F_L, or one that depends on the direction of power."""
    return where(v.directional, directional_load(v) / motion_law.alpha_RL(v), motion_law.D_eq(v) * v.F_L)


def directional_load(v: Any) -> Any:
    """The load as the motor feels it, in N: F_L / eta_GB driving it, eta_back F_L driven by it, F_L at rest.

    What it differs by from F_L acts against the speed whatever that is, so that nothing is gained.
    """
    forward, backward = 1.0 / v.eta_GB - 1.0, 1.0 - back_driving_efficiency(v)
    s = direction(v)
    return v.F_L + 0.5 * (forward + backward) * abs(v.F_L) * s + 0.5 * (forward - backward) * v.F_L * s * s


def back_driving_efficiency(v: Any) -> Any:
    """eta_back, or where that is 0 the one of a screw with the same friction either way, 2 - 1 / eta_GB."""
    return where(v.eta_back == 0.0, 2.0 - 1.0 / v.eta_GB, v.eta_back)
