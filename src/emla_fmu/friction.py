"""Friction of the screw, and losses of gearbox and screw: functions of the plant's values `v`."""

from typing import Any

from fmublock import logical_or, sqrt, where

from . import motion_law


def direction(v: Any) -> Any:
    """Return a smooth sign of the speed: -1 to 1, and proportional to it well below v_0."""
    return v.v_L / sqrt(v.v_L * v.v_L + v.v_0 * v.v_0)


def friction_force(v: Any) -> Any:
    """Return the Coulomb and Stribeck friction at the screw in N, against the speed.

    It falls from the breakaway friction F_S to F_C well above v_S (Hess and Soom, 1990). Below v_0 the
    force falls to zero like that of a damper.
    """
    ratio = v.v_L / v.v_S
    force = (v.F_C + (v.F_S - v.F_C) / (1.0 + ratio * ratio)) * direction(v)
    return where(logical_or(v.F_C > 0.0, v.F_S > 0.0), force, 0.0)


def load_torque(v: Any, force: Any) -> Any:
    """Return the torque at the motor in N m for a force on the screw in N.

    It is D_eq times the force, or depends on the direction of power.
    """
    return where(
        v.directional, directional_load(v, force) / motion_law.alpha_RL(v), motion_law.D_eq(v) * force
    )


def directional_load(v: Any, force: Any) -> Any:
    """Return the load at the motor in N for a force F on the screw.

    It is F / eta_GB if the motor drives the load, eta_back F if the load drives the motor, and F at
    rest. The difference from F always acts against the speed, so that no energy is gained.
    """
    forward, backward = 1.0 / v.eta_GB - 1.0, 1.0 - back_driving_efficiency(v)
    s = direction(v)
    return force + 0.5 * (forward + backward) * abs(force) * s + 0.5 * (forward - backward) * force * s * s


def back_driving_efficiency(v: Any) -> Any:
    """Return eta_back; if it is 0, 2 - 1 / eta_GB of a screw with the same friction in both directions."""
    return where(v.eta_back == 0.0, 2.0 - 1.0 / v.eta_GB, v.eta_back)
