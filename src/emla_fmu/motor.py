"""The electrical half of the actuator, for a machine whose motion another FMU computes."""

from typing import Any

from fmublock import Block, DefaultExperiment, Input

from . import electrics
from .plant import EmlaPlant


class EmlaMotor(Block):
    """Motor, inverter and sensors of an `EmlaPlant`: the screw's position and speed in, motor torque out.

    For a joint whose mechanical half is part of a whole machine. Equations (1) to (3) and the currents of
    (9) of the paper, disturbances as in (26), uncertainties as in (84). Apart from the motion, all
    variables are those of the plant.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    u_q, u_d, i_q_ref = EmlaPlant.u_q, EmlaPlant.u_d, EmlaPlant.i_q_ref
    x_L = Input(unit="m", nominal=0.1, description="Screw position", terminal="motion")
    v_L = Input(unit="m/s", nominal=0.1, description="Screw speed", terminal="motion")
    d_3, d_4, sag = EmlaPlant.d_3, EmlaPlant.d_4, EmlaPlant.sag

    R_s, alpha_R = EmlaPlant.R_s, EmlaPlant.alpha_R
    L_d, L_q = EmlaPlant.L_d, EmlaPlant.L_q
    Phi_PM, N_p = EmlaPlant.Phi_PM, EmlaPlant.N_p
    tau_cog, n_cog = EmlaPlant.tau_cog, EmlaPlant.n_cog
    rho, lead = EmlaPlant.rho, EmlaPlant.lead
    lead_error, wobble = EmlaPlant.lead_error, EmlaPlant.wobble
    i_range, i_N = EmlaPlant.i_range, EmlaPlant.i_N
    permitted_rise, tau_th = EmlaPlant.permitted_rise, EmlaPlant.tau_th
    u_max, delay = EmlaPlant.u_max, EmlaPlant.delay
    dead_time, f_PWM, i_0 = EmlaPlant.dead_time, EmlaPlant.f_PWM, EmlaPlant.i_0
    use_commanded_current = EmlaPlant.use_commanded_current
    F_3, F_4 = EmlaPlant.F_3, EmlaPlant.F_4
    sigma, resolution, seed = EmlaPlant.sigma, EmlaPlant.resolution, EmlaPlant.seed
    eccentricity = EmlaPlant.eccentricity
    sigma_i, resolution_i, seed_i = EmlaPlant.sigma_i, EmlaPlant.resolution_i, EmlaPlant.seed_i

    i_q, i_d, temperature_rise = EmlaPlant.i_q, EmlaPlant.i_d, EmlaPlant.temperature_rise

    random, noise, u_measured = EmlaPlant.random, EmlaPlant.noise, EmlaPlant.u_measured
    random_i, noise_q, noise_d = EmlaPlant.random_i, EmlaPlant.noise_q, EmlaPlant.noise_d
    delay_clock, delay_steps = EmlaPlant.delay_clock, EmlaPlant.delay_steps
    u_q_late, u_d_late = EmlaPlant.u_q_late, EmlaPlant.u_d_late
    u_q_line, u_d_line = EmlaPlant.u_q_line, EmlaPlant.u_d_line

    x_measured = EmlaPlant.x_measured
    i_q_measured, i_d_measured = EmlaPlant.i_q_measured, EmlaPlant.i_d_measured
    u_available = EmlaPlant.u_available
    tau_m, omega_m = EmlaPlant.tau_m, EmlaPlant.omega_m
    v_q, v_d, saturated = EmlaPlant.v_q, EmlaPlant.v_d, EmlaPlant.saturated
    motor_load, P_el = EmlaPlant.motor_load, EmlaPlant.P_el
    i_a, i_b, i_c = EmlaPlant.i_a, EmlaPlant.i_b, EmlaPlant.i_c

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the derivatives of the currents and of the winding's temperature."""
        return electrics.derivatives(v)

    def update(self, v: Any) -> dict[str, Any]:
        """Return the sampled values."""
        return electrics.update(v)

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return sensors, torque, voltages after the inverter, electrical power, and phase currents."""
        return electrics.outputs(v)
