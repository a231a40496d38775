"""The PMSM-driven electromechanical linear actuator."""

from typing import Any

from fmublock import Block, DefaultExperiment, DiscreteState, Input, Output, Parameter, State

from . import electrics, end_stops, friction, inverter, motion_law


class EmlaPlant(Block):
    """PMSM-driven electromechanical linear actuator with inverter and sensors.

    Equations (3) to (9) of the paper, disturbances as in (26), uncertainties as in (84).
    Amplitude-invariant d-q quantities; x_L grows as the actuator extends.

    Further properties of drives are off by default, each with its own parameters: computing delay and
    dead time of the inverter, noise, resolution and eccentricity of the sensors, errors of the screw's
    lead, cogging, friction, end stops, and the temperature of the winding, which the resistance can follow.
    The efficiency can depend on the direction of power.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    u_q = Input(
        unit="V",
        nominal=100.0,
        description="q-axis stator voltage demanded from the inverter",
        terminal="drive",
    )
    u_d = Input(
        unit="V",
        nominal=100.0,
        description="d-axis stator voltage demanded from the inverter",
        terminal="drive",
    )
    i_q_ref = Input(
        unit="A",
        nominal=10.0,
        description="Commanded q-axis current i_q*, used with use_commanded_current",
        terminal="drive",
    )
    F_L = Input(unit="N", nominal=1e4, description="Load force, positive against extension", terminal="load")
    d_2 = Input(unit="m/s2", description="Disturbance of the screw's acceleration", terminal="load")
    d_3 = Input(unit="V", nominal=10.0, description="Disturbance of the q-axis voltage", terminal="load")
    d_4 = Input(unit="V", nominal=10.0, description="Disturbance of the d-axis voltage", terminal="load")
    sag = Input(
        name="supply.sag",
        symbol=r"\sigma_u",
        description="Missing fraction of the supply voltage",
        terminal="load",
    )

    R_s = Parameter(
        0.14, unit="Ohm", minimum=0.0, name="motor.R_s", description="Stator resistance per phase"
    )
    alpha_R = Parameter(
        0.0,
        unit="1/K",
        minimum=0.0,
        name="motor.alpha_R",
        symbol=r"\alpha_R",
        description="Relative growth of R_s with the temperature rise of the winding; copper has 0.00393",
    )
    L_d = Parameter(2.4e-3, unit="H", minimum=1e-9, name="motor.L_d", description="d-axis inductance")
    L_q = Parameter(2.4e-3, unit="H", minimum=1e-9, name="motor.L_q", description="q-axis inductance")
    Phi_PM = Parameter(
        0.15, unit="Wb", minimum=1e-9, name="motor.Phi_PM", description="Permanent magnet flux linkage (peak)"
    )
    N_p = Parameter(8, minimum=1, name="motor.N_p", description="Number of pole pairs")
    tau_cog = Parameter(
        0.0,
        unit="N.m",
        minimum=0.0,
        name="motor.cogging.amplitude",
        symbol=r"\tau_{cog}",
        description="Amplitude of the cogging torque; 0 is none",
    )
    n_cog = Parameter(
        48,
        minimum=1,
        name="motor.cogging.periods",
        symbol="n_{cog}",
        description="Periods of the cogging torque per motor turn",
    )
    J_m = Parameter(0.016, unit="kg.m2", minimum=0.0, name="motor.J_m", description="Rotor inertia")
    B_m = Parameter(
        1.67e-3, unit="N.m.s/rad", minimum=0.0, name="motor.B_m", description="Viscous friction of the rotor"
    )
    J_c = Parameter(0.0, unit="kg.m2", minimum=0.0, name="coupling.J_c", description="Coupling inertia")
    rho = Parameter(
        1.0 / 7.0,
        minimum=1e-9,
        name="gearbox.rho",
        description="Screw turns per motor turn (gear ratio 1/rho)",
    )
    J_GB = Parameter(
        0.0, unit="kg.m2", minimum=0.0, name="gearbox.J_GB", description="Gearbox inertia at the motor"
    )
    eta_GB = Parameter(
        0.9, minimum=1e-3, maximum=1.0, name="gearbox.eta_GB", description="Efficiency of gearbox and screw"
    )
    directional = Parameter(
        False,
        name="gearbox.directional",
        description="Whether losses of gearbox and screw always oppose the motion",
    )
    eta_back = Parameter(
        0.0,
        maximum=1.0,
        name="gearbox.eta_back",
        symbol=r"\eta_{back}",
        description="Efficiency where the load drives, used with directional; 0 is 2 - 1 / eta_GB",
    )
    lead = Parameter(
        0.02, unit="m", minimum=1e-9, name="screw.lead", symbol="l", description="Screw travel per turn"
    )
    lead_error = Parameter(
        0.0,
        name="screw.lead_error",
        symbol=r"\epsilon_l",
        description="Fraction by which the mean lead is longer than the motor's encoder assumes",
    )
    wobble = Parameter(
        0.0,
        unit="m",
        minimum=0.0,
        name="screw.wobble",
        symbol="w",
        description="Amplitude of the travel error that repeats with each turn of the screw",
    )
    M_BS = Parameter(156.5, unit="kg", minimum=0.0, name="screw.M_BS", description="Mass moved by the screw")
    B_BS = Parameter(
        0.0, unit="N.s/m", minimum=0.0, name="screw.B_BS", description="Viscous friction of the screw"
    )
    C_eq = Parameter(
        0.0,
        unit="N",
        minimum=0.0,
        name="screw.C_eq",
        description="Torque per travel as printed; 0 is a rigid screw",
    )
    q_LB = Parameter(0.0, unit="m", name="screw.q_LB", description="Lower end of the stroke")
    q_UB = Parameter(0.522, unit="m", name="screw.q_UB", description="Upper end of the stroke")
    v_max = Parameter(
        0.136, unit="m/s", minimum=0.0, name="screw.v_max", description="Largest speed of the screw"
    )
    i_range = Parameter(
        158.0,
        unit="A",
        minimum=0.0,
        name="motor.i_max",
        description="Largest d- and q-axis current; controllers keep to less",
    )
    i_N = Parameter(
        0.0,
        unit="A",
        minimum=0.0,
        name="motor.i_N",
        description="Rated continuous current (peak) of the winding; 0 is no heating",
    )
    permitted_rise = Parameter(
        100.0,
        unit="K",
        is_difference=True,
        minimum=1e-3,
        name="motor.permitted_rise",
        symbol=r"\vartheta_N",
        description="Steady temperature rise of the winding at the rated current",
    )
    tau_th = Parameter(
        100.0,
        unit="s",
        minimum=1e-3,
        name="motor.tau_th",
        symbol=r"\tau",
        description="Thermal time constant of the winding",
    )
    F_C = Parameter(
        0.0, unit="N", minimum=0.0, name="friction.F_C", description="Coulomb friction at the screw"
    )
    F_S = Parameter(
        0.0, unit="N", minimum=0.0, name="friction.F_S", description="Breakaway friction at the screw"
    )
    v_S = Parameter(
        5e-3,
        unit="m/s",
        minimum=1e-9,
        name="friction.v_S",
        description="Speed at which friction is halfway between F_S and F_C",
    )
    v_0 = Parameter(
        1e-4,
        unit="m/s",
        minimum=1e-9,
        name="friction.v_0",
        description="Speed below which friction acts like a damper",
    )
    stop_stiffness = Parameter(
        0.0,
        unit="N/m2",
        minimum=0.0,
        name="stop.stiffness",
        symbol="k",
        description="Force of an end stop per squared depth; 0 is no end stop",
    )
    stop_damping = Parameter(
        0.0,
        unit="s/m",
        minimum=0.0,
        name="stop.damping",
        symbol="c",
        description="Relative growth of an end stop's force with the speed of approach",
    )
    u_max = Parameter(
        445.0,
        unit="V",
        minimum=1e-3,
        name="inverter.u_max",
        description="Longest voltage vector of the inverter",
    )
    delay = Parameter(
        0.0,
        unit="s",
        minimum=0.0,
        name="inverter.delay",
        symbol="T",
        description="Time after which a voltage takes effect: 1 to 32 whole steps; 0 is none",
    )
    dead_time = Parameter(
        0.0,
        unit="s",
        minimum=0.0,
        name="inverter.dead_time",
        symbol="T_d",
        description="Uncompensated dead time of the inverter's legs",
    )
    f_PWM = Parameter(8e3, unit="Hz", minimum=0.0, name="inverter.f_PWM", description="Switching frequency")
    i_0 = Parameter(
        0.5,
        unit="A",
        minimum=1e-9,
        name="inverter.i_0",
        description="Phase current below which dead time takes less voltage",
    )
    use_commanded_current = Parameter(
        False, description="Compute the torque from the commanded (paper) instead of the actual current"
    )
    F_2 = Parameter(0.0, name="uncertainty.F_2", description="Modelling error of g_2 as a fraction (84)")
    F_3 = Parameter(0.0, name="uncertainty.F_3", description="Modelling error of g_3 as a fraction (84)")
    F_4 = Parameter(0.0, name="uncertainty.F_4", description="Modelling error of g_4 as a fraction (84)")
    sigma = Parameter(
        0.0,
        unit="m",
        minimum=0.0,
        name="sensor.sigma",
        description="Standard deviation of the position noise",
    )
    resolution = Parameter(
        0.0,
        unit="m",
        minimum=0.0,
        name="sensor.resolution",
        symbol="q",
        description="Position step of the sensor; 0 is none",
    )
    eccentricity = Parameter(
        0.0,
        unit="rad",
        minimum=0.0,
        name="sensor.eccentricity",
        symbol=r"\epsilon_e",
        description="Amplitude of the angle error that repeats with each turn of the encoder, at the motor",
    )
    seed = Parameter(
        20240901, minimum=1, maximum=2147483646, name="sensor.seed", description="Start of the noise sequence"
    )
    sigma_i = Parameter(
        0.0,
        unit="A",
        minimum=0.0,
        name="sensor.current.sigma",
        description="Standard deviation of the noise of i_q and i_d",
    )
    resolution_i = Parameter(
        0.0,
        unit="A",
        minimum=0.0,
        name="sensor.current.resolution",
        description="Current step of the sensors; 0 is none",
    )
    seed_i = Parameter(
        1043618065,
        minimum=1,
        maximum=2147483646,
        name="sensor.current.seed",
        description="Start of the currents' noise sequence",
    )
    x_L_start = Parameter(0.24, unit="m", name="start.x_L", description="Initial screw position")

    x_L = State(x_L_start, unit="m", nominal=0.1, limits=(q_LB, q_UB), description="Screw position")
    v_L = State(0.0, unit="m/s", nominal=0.1, limits=v_max, description="Screw speed", terminal="load")
    i_q = State(0.0, unit="A", nominal=10.0, limits=i_range, description="q-axis stator current")
    i_d = State(0.0, unit="A", nominal=10.0, limits=i_range, description="d-axis stator current")
    temperature_rise = State(
        0.0,
        unit="K",
        is_difference=True,
        nominal=10.0,
        limits=permitted_rise,
        name="motor.temperature_rise",
        symbol=r"\vartheta",
        description="Temperature rise of the winding",
    )

    random = DiscreteState(seed, name="sensor.random", symbol="r", description="State of the noise generator")
    noise = DiscreteState(0.0, name="sensor.noise", symbol="n", description="Present draw from N(0, 1)")
    u_measured = DiscreteState(
        u_max, unit="V", name="inverter.u_measured", description="Last voltage that the supply allowed"
    )
    random_i = DiscreteState(
        seed_i, name="sensor.current.random", description="State of the currents' noise generator"
    )
    noise_q = DiscreteState(0.0, name="sensor.current.noise_q", description="Present draw for i_q")
    noise_d = DiscreteState(0.0, name="sensor.current.noise_d", description="Present draw for i_d")
    delay_clock = DiscreteState(
        0.0, unit="s", name="inverter.delay_clock", description="End of the last communication step"
    )
    delay_steps = DiscreteState(
        0.0,
        name="inverter.delay_in_steps_of_at_most_32",
        description="Delay in communication steps; more than 32 ends the run",
    )
    u_q_late = DiscreteState(
        0.0, unit="V", name="inverter.u_q_late", description="Delayed q-axis voltage demanded"
    )
    u_d_late = DiscreteState(
        0.0, unit="V", name="inverter.u_d_late", description="Delayed d-axis voltage demanded"
    )
    u_q_line = DiscreteState(
        0.0,
        shape=inverter.LONGEST_DELAY - 1,
        unit="V",
        name="inverter.u_q_line",
        description="Earlier demanded q-axis voltages, the latest first",
    )
    u_d_line = DiscreteState(
        0.0,
        shape=inverter.LONGEST_DELAY - 1,
        unit="V",
        name="inverter.u_d_line",
        description="Earlier demanded d-axis voltages, the latest first",
    )

    x_measured = Output(unit="m", nominal=0.1, description="Measured position", terminal="sensor")
    i_q_measured = Output(unit="A", nominal=10.0, description="Measured q-axis current", terminal="drive.i_q")
    i_d_measured = Output(unit="A", nominal=10.0, description="Measured d-axis current", terminal="drive.i_d")
    u_available = Output(
        unit="V",
        nominal=100.0,
        name="inverter.u_available",
        description="Longest voltage vector that the supply allows, as measured by the drive",
        terminal="drive.u_available",
    )
    a_L = Output(unit="m/s2", description="Screw acceleration")
    tau_m = Output(unit="N.m", nominal=10.0, description="Motor torque that drives the screw")
    omega_m = Output(unit="rad/s", nominal=100.0, description="Motor speed")
    v_q = Output(
        unit="V",
        nominal=100.0,
        name="inverter.u_q",
        symbol="",
        description="q-axis voltage after the inverter",
    )
    v_d = Output(
        unit="V",
        nominal=100.0,
        name="inverter.u_d",
        symbol="",
        description="d-axis voltage after the inverter",
    )
    saturated = Output(
        name="inverter.saturated", description="1 while the demanded voltage exceeds the limit"
    )
    motor_load = Output(
        name="motor.load", description="Copper loss relative to that of the rated current; 0 without one"
    )
    P_el = Output(unit="W", nominal=1e3, description="Electrical power into the motor")
    P_L = Output(unit="W", nominal=1e3, description="Mechanical power into the load")
    i_a = Output(unit="A", name="phase.i_a", description="Current of phase a (magnet axis at x_L = 0)")
    i_b = Output(unit="A", name="phase.i_b", description="Current of phase b")
    i_c = Output(unit="A", name="phase.i_c", description="Current of phase c")

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return (9) with the disturbances of (26) and the uncertainties of (84)."""
        return {"x_L": v.v_L, "v_L": screw_acceleration(v, self.load_force(v)), **electrics.derivatives(v)}

    def update(self, v: Any) -> dict[str, Any]:
        """Return the sampled values."""
        return electrics.update(v)

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return sensors, torque, voltages after the inverter, powers, phase currents, and acceleration."""
        force = self.load_force(v)
        return {**electrics.outputs(v), "a_L": screw_acceleration(v, force), "P_L": force * v.v_L}

    def load_force(self, v: Any) -> Any:
        """Return the load force in N."""
        return v.F_L


def screw_acceleration(v: Any, force: Any) -> Any:
    """Return the second line of (9) in m/s2, with F_2, d_2, friction and end stops.

    The screw pushes the load with `force` in N.
    """
    A_eq = motion_law.A_eq(v)
    g_2 = (electrics.reluctance_torque(v) - motion_law.B_eq(v) * v.v_L - v.C_eq * v.x_L) / A_eq
    magnet = electrics.magnet_torque(v) / A_eq
    a_L = magnet + (1.0 + v.F_2) * g_2 + v.d_2 - friction.load_torque(v, force) / A_eq
    contact = end_stops.stop_force(v) - friction.friction_force(v)
    return a_L + contact / (motion_law.alpha_RL(v) * A_eq)
