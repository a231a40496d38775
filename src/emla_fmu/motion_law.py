"""From rotary to linear motion: the paper's equivalent coefficients (6).

The functions take any object with the parameters as attributes: a block's values or a parameter set.
With tau_m = A_eq a_L + B_eq v_L + C_eq x_L + D_eq F_L (5), A_eq is in kg m (the paper prints kg), B_eq
in kg m/s, D_eq in m, and C_eq would be in N.
"""

import math
from typing import Any


def alpha_RL(p: Any) -> Any:
    """Return the motor angle per screw travel, 2 pi / (rho l), in rad/m (4)."""
    return 2.0 * math.pi / (p.rho * p.lead)


def A_eq(p: Any) -> Any:
    """Return the motor torque per screw acceleration, in kg m: all inertia seen by the motor."""
    alpha = alpha_RL(p)
    return alpha * (p.J_m + p.J_c + p.J_GB + p.M_BS / (alpha * alpha))


def B_eq(p: Any) -> Any:
    """Return the motor torque per screw speed, in kg m/s: all viscous friction seen by the motor."""
    alpha = alpha_RL(p)
    return alpha * (p.B_m + p.B_BS / (alpha * alpha))


def D_eq(p: Any) -> Any:
    """Return the motor torque per load force, in m."""
    return 1.0 / (alpha_RL(p) * p.eta_GB)


def C_eq(alpha: float, rho: float, k_tau: tuple[float, float, float], k_L: float) -> float:
    """Return the stiffness of the drive train as printed in the paper.

    The printed formula gives N/m, but (5) needs a torque per travel in N: a factor alpha_RL. Both tie the
    load to the ground, and with realistic stiffnesses no motor could move it. The plant's default is
    therefore a rigid screw, C_eq = 0.

    Args:
        alpha: Motor angle per screw travel, rad/m.
        rho: Screw turns per motor turn.
        k_tau: Torsional stiffnesses k_tau1 to k_tau3, N m/rad.
        k_L: Linear stiffness, N/m.
    """
    k_tau1, k_tau2, k_tau3 = k_tau
    compliance = 1.0 / k_tau1 + 1.0 / k_tau2 + 1.0 / (rho * rho * k_tau3) + alpha * alpha / k_L
    return alpha * alpha / compliance


def k_L(bearing: float, screw: float, nut: float, tube: float) -> float:
    """Return the linear stiffness of thrust bearing, screw, nut and tube in series, all in N/m (7)."""
    return 1.0 / (1.0 / bearing + 1.0 / screw + 1.0 / nut + 1.0 / tube)
