"""The parameter set that plant, observer and controllers share.

"assumed" marks values that are in neither the paper nor a public data sheet of the part. Fields have the
names of the blocks' variables, so that a block can take its parameters from a set.
"""

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

        Assumed, with a margin: a controller that keeps i_q* within i_max exceeds it by some per cent, and
        drives trip well above it.
        """
        return 1.5 * self.i_max
