"""Common base of the controllers for comparison: ports, limits and model."""

from typing import Any

from fmublock import DefaultExperiment, Input, Output, Parameter

from . import drive_laws
from .known_drive import KnownDrive


class DriveController(KnownDrive):
    """Base of controllers that can replace `RsbaController` in a joint.

    Subclasses add gains, states and equations; ports and limits are here.
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
        description="Longest voltage vector that the supply allows; the default means no limit",
        terminal="drive.inverter.u_available",
    )
    x_d = Input(unit="m", nominal=0.1, description="Reference position", terminal="reference")
    v_d = Input(unit="m/s", nominal=0.1, description="Reference speed", terminal="reference")
    a_d = Input(unit="m/s2", description="Reference acceleration", terminal="reference")

    compensate = Parameter(
        True,
        symbol=r"\kappa",
        description="Compensate the observer's estimate d_hat by the current",
    )
    weaken_field = Parameter(
        True, description="Weaken the field by i_d when the back-EMF leaves i_q too little voltage"
    )
    v_max = Parameter(0.136, unit="m/s", minimum=1e-6, name="limit.v_max", description="Largest screw speed")
    u_reserve = Parameter(
        0.05,
        minimum=0.0,
        maximum=0.9,
        name="limit.u_reserve",
        symbol="r",
        description="Fraction of the voltage reserved for changes of current",
    )
    i_reserve = Parameter(
        0.0,
        minimum=0.0,
        maximum=0.9,
        name="limit.i_reserve",
        symbol="r_i",
        description="Fraction of i_max reserved for noise and delay",
    )

    u_q = Output(unit="V", nominal=100.0, description="q-axis voltage", terminal="drive")
    u_d = Output(unit="V", nominal=100.0, description="d-axis voltage", terminal="drive")
    i_q_ref = Output(unit="A", nominal=10.0, description="Commanded q-axis current i_q*", terminal="drive")
    saturated = Output(description="1 while current or voltage is at its limit")

    def weakening(self, v: Any, i_q_ref: Any) -> Any:
        """Return the i_d* in A with which the supply voltage can hold i_q*."""
        return drive_laws.weakening_current(v, i_q_ref, drive_laws.steady_voltage(v))

    def voltage(self, v: Any, rate_q: Any, rate_d: Any) -> tuple[Any, Any, Any, Any, Any]:
        """Return the voltages within the limit for the desired rates of i_q and i_d in A/s.

        Returns:
            u_q and u_d in V, the changes of both by the limit in V, and 1 if the limit acts, else 0.
        """
        holding_q, holding_d = drive_laws.holding_voltage(v)
        wanted_q = v.L_q * rate_q + holding_q
        wanted_d = v.L_d * rate_d + holding_d
        u_q, u_d, limited = drive_laws.within_voltage(v, wanted_q, wanted_d)
        return u_q, u_d, u_q - wanted_q, u_d - wanted_d, limited
