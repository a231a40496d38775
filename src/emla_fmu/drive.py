"""Realistic drives: parameters of the plant's options by one rule for all joints.

The paper has none of these numbers. "assumed" is our choice; the sources are

- Siemens, SIMOTICS S-1FT7 configuration manual (A5E45099423B): 100 K of winding temperature rise in S1;
- Siemens, 1FW6 configuration manual (6SN1197-0AD00-0BP7): t_max = t_TH ln(nu / (nu - 1)), t_TH = 180 s
  of a 1FW6190, a motor of this torque (water-cooled);
- Infineon, AN2007-04, "Calculate and minimize the dead time for IGBTs": some us for such modules;
- LEM, digital HO and HLSR transducers: 12 bits effective after the filter of the converter;
- K. H. Hunt and F. R. E. Crossley, J. Appl. Mech. 42 (1975): damping of a contact from its restitution.

Fields have the names of the plant's variables.
"""

import math
from dataclasses import dataclass

from .parameters import EmlaParameters

ENCODER_STEPS = 2**20
"""Steps per motor turn of the position sensor: a 20-bit encoder (assumed)."""


@dataclass(frozen=True)
class DriveParameters:
    """Properties of a drive that the paper's plant lacks. d-q quantities are amplitude-invariant (peak)."""

    delay: float
    """Time after which a demanded voltage takes effect, s."""
    dead_time: float
    """Uncompensated dead time of the inverter's legs, s."""
    f_PWM: float
    """Switching frequency, Hz."""
    i_0: float
    """Phase current below which dead time takes less voltage, A."""
    sigma: float
    """Standard deviation of the position noise, m."""
    resolution: float
    """Position step of the sensor, m."""
    sigma_i: float
    """Standard deviation of the noise of i_q and i_d, A."""
    resolution_i: float
    """Current step of the sensors, A."""
    F_C: float
    """Coulomb friction at the screw, N."""
    F_S: float
    """Breakaway friction at the screw, N."""
    v_S: float
    """Speed at which friction is halfway between F_S and F_C, m/s."""
    v_0: float
    """Speed below which friction acts like a damper, m/s."""
    directional: bool
    """Whether losses of gearbox and screw always oppose the motion."""
    eta_back: float
    """Efficiency when the load drives; 0 is 2 - 1 / eta_GB."""
    stop_stiffness: float
    """Force of an end stop per squared depth, N/m2."""
    stop_damping: float
    """Relative growth of an end stop's force with the speed of approach, s/m."""
    i_N: float
    """Rated current (peak), A."""
    permitted_rise: float
    """Steady temperature rise of the winding at the rated current, K."""
    tau_th: float
    """Thermal time constant of the winding, s."""


def drive(emla: EmlaParameters, i_N: float) -> DriveParameters:
    """Return the drive of an EMLA with the rated current i_N in A (peak)."""
    alpha = emla.alpha_RL
    step = emla.rho * emla.lead / ENCODER_STEPS
    no_load = 0.01 * emla.tau_max * alpha  # assumed: 1 % of the largest motor torque, at the screw
    inertia, depth, restitution = alpha * emla.A_eq, 0.01, 0.5  # stops, assumed: 10 mm, 0.5
    return DriveParameters(
        delay=1e-4,  # one sample of a current controller at 10 kHz
        dead_time=0.2 * 2e-6,  # 2 us, of which the drive compensates 80 % (assumed)
        f_PWM=10e3,  # one period per sample
        i_0=0.02 * emla.i_max,  # assumed
        sigma=step,  # assumed: one step, as for encoders with more bits than are used
        resolution=step,
        # 12 effective bits over plus and minus the range, sampled with 14: noise of 2^12 steps' rounding
        sigma_i=2.0 * emla.i_range / 2**12 / math.sqrt(12.0),
        resolution_i=2.0 * emla.i_range / 2**14,
        F_C=no_load,
        F_S=1.5 * no_load,  # assumed
        v_S=10.0 / alpha,  # assumed: 10 rad/s of the motor
        v_0=0.1 / alpha,  # assumed: 0.1 rad/s of the motor
        directional=True,
        eta_back=0.0,  # a screw with the same friction in both directions
        # a bumper that stops the whole inertia at the largest speed (assumed)
        stop_stiffness=1.5 * inertia * emla.v_max * emla.v_max / (depth * depth * depth),
        stop_damping=1.5 * (1.0 - restitution) / emla.v_max,
        i_N=i_N,
        permitted_rise=100.0,  # S1 of the 1FT7
        tau_th=180.0,  # the 1FW6190
    )
