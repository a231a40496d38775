"""Field-oriented cascade control of one EMLA, as in servo drives."""

from typing import Any

from fmublock import Output, Parameter, State, clamp, maximum, where

from . import drive_laws
from .drive_controller import DriveController


class FocController(DriveController):
    """Field-oriented control: P position, P speed, PI currents, with feed-forward and load compensation.

    This is the cascade of a servo drive. Position and speed controllers are proportional, with reference
    speed and acceleration fed forward. Instead of an integral term, the current compensates an estimate
    of the load. The estimate is the observer's d_hat (`compensate`), or with `omega_d` > 0 that of the
    controller's own disturbance observer, from speed and measured current. Use only one of the two: with
    both, the load counts twice.

    The current controllers are PI with decoupled axes and back-EMF fed forward. Back-calculation from
    the limited voltage keeps their integrals from winding up.
    """

    k_p = Parameter(150.0, unit="1/s", minimum=1e-9, description="Gain of the position controller")
    k_v = Parameter(600.0, unit="1/s", minimum=0.0, description="Gain of the speed controller")
    w_c = Parameter(2500.0, unit="1/s", minimum=1e-9, description="Bandwidth of the current controllers")
    w_i = Parameter(
        250.0, unit="1/s", minimum=0.0, description="Integral action of the current controllers, 1 / T_i"
    )
    omega_d = Parameter(
        0.0,
        unit="1/s",
        minimum=0.0,
        description="Bandwidth of the controller's own disturbance observer; 0 is none",
    )

    xi_q = State(0.0, unit="A/s", nominal=1e4, description="Integral of the q-axis current controller")
    xi_d = State(0.0, unit="A/s", nominal=1e4, description="Integral of the d-axis current controller")
    z = State(
        0.0,
        unit="m/s",
        nominal=0.1,
        name="load.z",
        description="Speed in the controller's own disturbance observer",
    )

    v_ref = Output(unit="m/s", nominal=0.1, description="Commanded speed")
    d_used = Output(
        unit="m/s2", name="load.d", symbol="d", description="Disturbance that the current compensates"
    )

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the derivatives of the current controllers' integrals and of the disturbance observer."""
        _, i_q_ref, _ = self.cascade(v)
        _, _, short_q, short_d, _ = self.currents(v, i_q_ref)
        observed = (
            drive_laws.acceleration_per_current(v) * v.i_q
            + drive_laws.known_acceleration(v, v.i_d)
            + self.observed(v)
        )
        return {
            "xi_q": v.w_i * (v.w_c * (i_q_ref - v.i_q) + short_q / v.L_q),
            "xi_d": v.w_i * (v.w_c * (self.weakening(v, i_q_ref) - v.i_d) + short_d / v.L_d),
            "z": where(v.omega_d > 0.0, observed, 0.0),
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return voltages, commanded current and speed, and the compensated disturbance."""
        v_ref, i_q_ref, current_limited = self.cascade(v)
        u_q, u_d, _, _, voltage_limited = self.currents(v, i_q_ref)
        return {
            "u_q": u_q,
            "u_d": u_d,
            "i_q_ref": i_q_ref,
            "saturated": maximum(current_limited, voltage_limited),
            "v_ref": v_ref,
            "d_used": self.disturbance(v),
        }

    def observed(self, v: Any) -> Any:
        """Return the estimate of the controller's own disturbance observer in m/s2."""
        return v.omega_d * (v.v_hat - v.z)

    def disturbance(self, v: Any) -> Any:
        """Return the disturbance that the current compensates, in m/s2."""
        return v.compensate * v.d_hat + self.observed(v)

    def cascade(self, v: Any) -> tuple[Any, Any, Any]:
        """Return commanded speed, commanded q-axis current, and 1 if that is at its limit, else 0."""
        w, _ = drive_laws.approach(v, v.k_p, v.x_d - v.x_hat)
        v_ref = v.v_d + w
        acceleration = v.a_d + v.k_v * (v_ref - v.v_hat)
        needed = acceleration - drive_laws.known_acceleration(v, v.i_d) - self.disturbance(v)
        wanted = needed / drive_laws.acceleration_per_current(v)
        limit = drive_laws.current_limit(v, drive_laws.steady_voltage(v))
        return v_ref, clamp(wanted, -limit, limit), where(abs(wanted) > limit, 1.0, 0.0)

    def currents(self, v: Any, i_q_ref: Any) -> tuple[Any, Any, Any, Any, Any]:
        """Control both currents by PI; see `DriveController.voltage`."""
        error_d = self.weakening(v, i_q_ref) - v.i_d
        return self.voltage(v, v.w_c * (i_q_ref - v.i_q) + v.xi_q, v.w_c * error_d + v.xi_d)
