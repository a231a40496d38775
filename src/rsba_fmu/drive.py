"""What the controllers of an EMLA have in common: their ports, limits and model."""

from typing import Any

from fmublock import Block, DefaultExperiment, Input, Output, Parameter

from . import drive_laws


class DriveController(Block):
    """Base of controllers that fit into a joint in the place of `RsbaController`.

    Subclasses add gains, states and equations; limits and model are here.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    x_hat = Input(unit="m", nominal=0.1, description="Estimated screw position", terminal="estimate")
    v_hat = Input(unit="m/s", nominal=0.1, description="Estimated screw speed", terminal="estimate")
    d_hat = Input(
        unit="m/s2", description="Estimated disturbance of the screw's acceleration", terminal="estimate"
    )
    i_q = Input(unit="A", nominal=10.0, description="Measured q-axis current", terminal="drive")
    i_d = Input(unit="A", nominal=10.0, description="Measured d-axis current", terminal="drive")
    u_available = Input(
        1e4,
        unit="V",
        nominal=100.0,
        description="Longest voltage vector that the supply allows; more than any where nothing tells it",
        terminal="drive.inverter.u_available",
    )
    x_d = Input(unit="m", nominal=0.1, description="Reference position", terminal="reference")
    v_d = Input(unit="m/s", nominal=0.1, description="Reference speed", terminal="reference")
    a_d = Input(unit="m/s2", description="Reference acceleration", terminal="reference")

    compensate = Parameter(
        True, description="Let the current take up d_hat, the disturbance as the observer sees it"
    )
    weaken_field = Parameter(
        True, description="Let i_d weaken the field where back-EMF leaves i_q too little voltage"
    )
    a_max = Parameter(1.2, unit="m/s2", minimum=1e-6, name="limit.a_max", description="Braking acceleration")
    v_max = Parameter(0.136, unit="m/s", minimum=1e-6, name="limit.v_max", description="Largest screw speed")
    i_max = Parameter(105.0, unit="A", minimum=1e-6, name="limit.i_max", description="Largest q-axis current")
    u_max = Parameter(445.0, unit="V", minimum=1e-6, name="limit.u_max", description="Longest voltage vector")

    R_s = Parameter(
        0.14, unit="Ohm", minimum=0.0, name="model.R_s", description="Stator resistance, as known"
    )
    L_d = Parameter(
        2.4e-3, unit="H", minimum=1e-9, name="model.L_d", description="d-axis inductance, as known"
    )
    L_q = Parameter(
        2.4e-3, unit="H", minimum=1e-9, name="model.L_q", description="q-axis inductance, as known"
    )
    Phi_PM = Parameter(
        0.15, unit="Wb", minimum=1e-9, name="model.Phi_PM", description="Magnet flux, as known"
    )
    N_p = Parameter(8, minimum=1, name="model.N_p", description="Number of pole pairs, as known")
    alpha_RL = Parameter(
        2199.0,
        unit="rad/m",
        minimum=1e-9,
        name="model.alpha_RL",
        description="Motor angle per travel, as known",
    )
    A_eq = Parameter(
        35.26, unit="kg.m", minimum=1e-9, name="model.A_eq", description="Equivalent inertia, as known"
    )
    B_eq = Parameter(
        3.67, unit="kg.m/s", minimum=0.0, name="model.B_eq", description="Equivalent friction, as known"
    )
    C_eq = Parameter(0.0, unit="N", minimum=0.0, name="model.C_eq", description="Torque per travel, as known")

    u_q = Output(unit="V", nominal=100.0, description="q-axis voltage", terminal="drive")
    u_d = Output(unit="V", nominal=100.0, description="d-axis voltage", terminal="drive")
    i_q_ref = Output(unit="A", nominal=10.0, description="Commanded q-axis current i_q*", terminal="drive")
    saturated = Output(description="1 while current or voltage is at its limit")

    def weakening(self, v: Any, i_q_ref: Any) -> Any:
        """i_d* in A that lets the supply's voltage hold i_q*."""
        return drive_laws.weakening_current(v, i_q_ref, drive_laws.steady_voltage(v))

    def voltage(self, v: Any, rate_q: Any, rate_d: Any) -> tuple[Any, Any, Any, Any, Any]:
        """u_q and u_d for wanted rates of i_q and i_d in A/s, within the limit; and what that does.

        The third and fourth value are by how much the limit changed u_q and u_d, in V; the fifth is
        1 where it acts, else 0.
        """
        holding_q, holding_d = drive_laws.holding_voltage(v)
        wanted_q = v.L_q * rate_q + holding_q
        wanted_d = v.L_d * rate_d + holding_d
        u_q, u_d, limited = drive_laws.within_voltage(v, wanted_q, wanted_d)
        return u_q, u_d, u_q - wanted_q, u_d - wanted_d, limited
