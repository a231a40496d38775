"""Torque of a motor over its speed: what it makes for a short time, and for ever."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...study.actuator.derived import torque_per_current


def peak_torque(emla: Any, speed: Vector) -> Vector:
    """Return the largest torque in N m at each motor speed, from tau_max and the voltage, with i_d = 0.

    Args:
        emla: Parameters of the actuator.
        speed: Motor speed in rad/s, shape (n,).
    """
    omega = emla.N_p * np.abs(speed)
    a = emla.R_s**2 + (omega * emla.L_q) ** 2
    b, c = emla.R_s * omega * emla.Phi_PM, (omega * emla.Phi_PM) ** 2 - emla.u_max**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    current = np.maximum((root - b) / np.maximum(a, 1e-300), 0.0)
    return np.minimum(1.5 * emla.N_p * emla.Phi_PM * current, emla.tau_max)


def continuous_torque(values: Mapping[str, float], speed: Vector) -> Vector | None:
    """Return the continuous torque in N m at each motor speed; None if the data sheet does not have it.

    The curve is a straight line from tau_N, or the torque of i_N, through tau_R at n_R. Without these it is
    constant.

    Args:
        values: Entries of the data sheet in SI units.
        speed: Motor speed in rad/s, shape (n,).
    """
    stall = values.get("motor.tau_N")
    if stall is None and "motor.i_N" in values:
        stall = torque_per_current(values) * values["motor.i_N"]
    if stall is None:
        return None
    slope = (values["motor.tau_R"] - stall) / values["motor.n_R"] if "motor.tau_R" in values else 0.0
    return np.maximum(stall + min(slope, 0.0) * np.abs(speed), 0.0)
