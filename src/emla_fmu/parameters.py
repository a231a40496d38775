"""Parameter sets of the three joints of the manipulator and of the experimental prototype.

Sources: "T" is the paper's Table IV, "T2" its Table II, "T7" its Table VII; "assumed" stands in
neither the paper nor a public data sheet of the part. Fields carry the names of the blocks'
variables, so that a block takes from a set what it declares.
"""

import math
from dataclasses import dataclass

from . import motion_law


@dataclass(frozen=True)
class EmlaParameters:
    """One EMLA: motor, gearbox, screw and inverter. d-q quantities are amplitude-invariant (peak)."""

    R_s: float
    """Stator resistance per phase, Ohm."""
    L_d: float
    """d-axis inductance, H."""
    L_q: float
    """q-axis inductance, H."""
    Phi_PM: float
    """Permanent magnet flux linkage, peak, Wb."""
    N_p: int
    """Number of pole pairs."""
    J_m: float
    """Rotor inertia, kg m2."""
    tau_max: float
    """Largest motor torque, N m."""
    rho: float
    """Screw turns per motor turn."""
    lead: float
    """Screw travel per turn, m."""
    M_BS: float
    """Mass moved by the screw, kg."""
    u_max: float
    """Longest voltage vector of the inverter, V."""
    q_LB: float
    """Lower end of the stroke, m."""
    q_UB: float
    """Upper end of the stroke, m."""
    v_max: float
    """Largest screw speed, m/s."""
    eta_GB: float = 0.9  # assumed
    """Efficiency of gearbox and screw."""
    B_m: float = 1.67e-3  # data sheet of a Siemens 1FT6084, a motor of this size
    """Viscous friction of the rotor, N m s/rad."""
    J_c: float = 0.0  # assumed
    """Coupling inertia, kg m2."""
    J_GB: float = 0.0  # assumed
    """Gearbox inertia at the motor, kg m2."""
    B_BS: float = 0.0  # assumed
    """Viscous friction of the screw, N s/m."""
    C_eq: float = 0.0  # rigid screw, see motion_law.C_eq
    """Motor torque per screw travel, N."""

    alpha_RL = property(motion_law.alpha_RL)
    A_eq = property(motion_law.A_eq)
    B_eq = property(motion_law.B_eq)
    D_eq = property(motion_law.D_eq)

    @property
    def i_max(self) -> float:
        """q-axis current that gives tau_max, A."""
        return self.tau_max / (1.5 * self.N_p * self.Phi_PM)

    @property
    def i_range(self) -> float:
        """Range of the motor's d-q currents, A.

        Assumed, and generous: a controller that keeps i_q* within i_max overshoots it by some
        per cent, and drives trip well above it.
        """
        return 1.5 * self.i_max


LIFT = EmlaParameters(
    R_s=0.14,  # T
    L_d=2.4e-3,  # T, L_N for both axes
    L_q=2.4e-3,  # T, L_N for both axes
    Phi_PM=0.15,  # T; with i_N = 29.5 A gives 53.1 N m against tau_N = 53
    N_p=8,  # T
    J_m=0.016,  # T
    tau_max=190.0,  # T
    rho=1.0 / 7.0,  # T, 1/rho = 7
    lead=0.02,  # T
    M_BS=156.5,  # T
    u_max=math.sqrt(2.0) * 315.0,  # T, u_N = 315 V read as rms
    q_LB=0.0,  # T2
    q_UB=0.522,  # T2
    v_max=0.136,  # T
)

TILT = EmlaParameters(
    R_s=0.16,  # T
    L_d=3.2e-3,  # T, L_N for both axes
    L_q=3.2e-3,  # T, L_N for both axes
    Phi_PM=0.13,  # T; with i_N = 18.5 A gives 28.9 N m against tau_N = 29
    N_p=8,  # T
    J_m=0.0105,  # T
    tau_max=129.0,  # T
    rho=1.0 / 5.0,  # T, 1/rho = 5
    lead=0.01,  # T
    M_BS=83.6,  # T
    u_max=math.sqrt(2.0) * 300.0,  # T, u_N = 300 V read as rms
    q_LB=0.0,  # T2
    q_UB=0.611,  # T2
    v_max=0.100,  # T
)

TELESCOPE = EmlaParameters(
    R_s=0.35,  # T
    L_d=12e-3,  # T, L_N for both axes
    L_q=12e-3,  # T, L_N for both axes
    Phi_PM=0.12,  # T; with i_N = 7.6 A gives 8.2 N m against tau_N = 8
    N_p=6,  # T
    J_m=0.00085,  # T
    tau_max=32.0,  # T
    rho=1.0,  # T, 1/rho = 1
    lead=0.01,  # T
    M_BS=30.4,  # T
    u_max=math.sqrt(2.0) * 600.0,  # T, u_N = 600 V read as rms
    q_LB=0.0,  # T2
    q_UB=1.0,  # T2
    v_max=0.210,  # T
)

PROTOTYPE = EmlaParameters(
    R_s=0.08,  # T7
    L_d=2.42e-3,  # T7, phase inductance for both axes
    L_q=2.42e-3,  # T7, phase inductance for both axes
    Phi_PM=math.sqrt(2.0) * 0.134,  # T7, read as rms: only then 23.1 A (rms) give the rated 37 N m
    N_p=4,  # T7
    J_m=0.0063,  # assumed, motors of 11.6 kW at 3000 rpm
    tau_max=77.0,  # T7
    rho=1.0 / 7.7,  # T7, gear ratio
    lead=0.016,  # T7
    M_BS=100.0,  # assumed, between tilt and lift
    u_max=400.0 * math.sqrt(2.0 / 3.0),  # assumed: phase peak of a 400 V supply (T7: 380/480 V)
    q_LB=0.0,  # assumed
    q_UB=0.5,  # assumed, generous: the experiments use 0.05 to 0.30 m
    v_max=3877.0 / 60.0 * 0.016 / 7.7,  # T7, maximum speed of the motor
    eta_GB=0.70,  # assumed: makes the measured 35 N m meet the 75 kN load
)

EMLAS = {"lift": LIFT, "tilt": TILT, "telescope": TELESCOPE, "prototype": PROTOTYPE}
"""Parameter sets by name."""
