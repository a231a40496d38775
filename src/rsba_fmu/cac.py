"""Command-filtered adaptive backstepping of one EMLA, in the manner of "CAC"."""

from typing import Any

from fmublock import Output, Parameter, State, clamp, maximum, tanh, where

from . import drive_laws
from .drive_controller import DriveController


class CacController(DriveController):
    """CAC-type: command-filtered adaptive backstepping of a PMSM drive with tanh terms.

    Of the controller that the paper compares with (Liu et al. 2023, "CAC"), only the gains of Table V
    are available. This is not a copy, but the standard form in the literature with these gains.

    Standard (Farrell, Polycarpou, Sharma and Dong 2009, and its uses on PMSM drives):

    - Virtual controls pass second-order command filters, whose outputs and derivatives the next step
      uses. The current's filter is limited to i_max.
    - Compensation signals xi_i contain the effect of filters and limits. It is not in v_i = z_i - xi_i,
      from which adaptation learns, so that saturation causes no wind-up.
    - An adaptive approximator with sigma-modification models the unknown in speed and current equations.
    - tanh replaces a sign function against the remaining error.

    Our reading:

    - Table V counts k and varpi to 5, with equal values at 3 and 5 and others at 4. Those are the
      steps of a drive with position, speed, q-axis current, flux and d-axis current. The flux of a
      PMSM is that of its magnet: 1, 2, 3 and 5 are used here, 4 is not.
    - The last steps command voltages: k_3 and k_5 are in V/A, varpi_3 and varpi_5 in V. Read as rates
      in 1/s, 0.05 would leave a current undamped for 20 s, and the printed gains could not hold any
      joint.
    - m_1, m_2, m_3 are the rates of adaptation of speed, q- and d-axis current.
    - The approximator has one basis function, a constant, because the unknown is slow (load, friction,
      dead time). In linear terms this is integral action.
    - Only the feedback part of the virtual speed is filtered. The derivative of the reference's speed
      is known, and a filter would delay it. `approach` limits the virtual speed to what can be braked.
    - epsilon, omega_n, damping and leak are our choice, as they are not in the table.
    """

    k = Parameter(
        [230.0, 230.0, 0.05, 1.0, 0.05],
        shape=5,
        minimum=1e-9,
        description="Feedback gains k_1 to k_5: 1/s, 1/s, V/A, not used, V/A",
    )
    varpi = Parameter(
        [3.0, 3.0, 0.03, 3.0, 0.03],
        shape=5,
        minimum=0.0,
        description="Size of the tanh terms varpi_1 to varpi_5: m/s, m/s2, V, not used, V",
    )
    m = Parameter(
        [1.0, 12.0, 1.0],
        shape=3,
        minimum=0.0,
        unit="1/s2",
        description="Rates of adaptation of speed, q-axis and d-axis current",
    )
    leak = Parameter(
        0.01,
        unit="1/s",
        minimum=0.0,
        symbol=r"\gamma",
        description="Leak of the adaptation (sigma-modification)",
    )
    epsilon = Parameter(
        [0.1, 0.1, 1.0, 1.0],
        shape=4,
        minimum=1e-12,
        description="Errors at which tanh saturates: position m, speed m/s, q-axis and d-axis current A",
    )
    omega_n = Parameter(
        [5000.0, 10000.0],
        shape=2,
        unit="rad/s",
        minimum=1e-9,
        symbol=r"\omega_i",
        description="Natural frequency of the command filters of speed and current",
    )
    damping = Parameter(1.0, minimum=1e-3, symbol=r"\zeta", description="Damping of the command filters")

    w = State(
        0.0, unit="m/s", nominal=0.1, name="filter.w", symbol="w_c", description="Filtered approach speed"
    )
    w_rate = State(0.0, unit="m/s2", name="filter.w_rate", symbol=r"\dot{w}_c", description="Its derivative")
    i_c = State(0.0, unit="A", nominal=10.0, name="filter.i_q", description="Filtered virtual current")
    i_c_rate = State(
        0.0,
        unit="A/s",
        nominal=1e3,
        name="filter.i_q_rate",
        symbol=r"\dot{i}_c",
        description="Its derivative",
    )
    xi_1 = State(0.0, unit="m", name="xi[1]", nominal=1e-3, description="Compensation of the position")
    xi_2 = State(0.0, unit="m/s", name="xi[2]", nominal=1e-2, description="Compensation of the speed")
    xi_3 = State(0.0, unit="A", name="xi[3]", description="Compensation of the q-axis current")
    xi_4 = State(0.0, unit="A", name="xi[4]", description="Compensation of the d-axis current")
    D_2 = State(0.0, unit="m/s2", name="D[2]", description="Estimate of the unknown acceleration")
    D_3 = State(0.0, unit="A/s", nominal=1e3, name="D[3]", description="Estimate of the unknown rate of i_q")
    D_4 = State(0.0, unit="A/s", nominal=1e3, name="D[4]", description="Estimate of the unknown rate of i_d")

    v_1 = Output(unit="m", name="v[1]", description="Compensated error of the position")
    v_2 = Output(unit="m/s", name="v[2]", description="Compensated error of the speed")
    v_3 = Output(unit="A", name="v[3]", description="Compensated error of the q-axis current")
    v_4 = Output(unit="A", name="v[4]", description="Compensated error of the d-axis current")

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the derivatives of command filters, compensation signals and adaptation."""
        A_2 = drive_laws.acceleration_per_current(v)
        V = self.compensated_errors(v)
        w, i_q, _ = self.virtual_controls(v, V)
        limit = drive_laws.current_limit(v, drive_laws.steady_voltage(v))
        _, _, short_q, short_d, _ = self.currents(v, V)
        return {
            "w": v.w_rate,
            "w_rate": self.filtered(v, 0, v.w, v.w_rate, w),
            "i_c": v.i_c_rate,
            "i_c_rate": self.filtered(v, 1, v.i_c, v.i_c_rate, clamp(i_q, -limit, limit)),
            "xi_1": -v.k[0] * v.xi_1 + (v.w - w) + v.xi_2,
            "xi_2": -v.k[1] * v.xi_2 + A_2 * (v.i_c - i_q) + A_2 * v.xi_3 - v.xi_1,
            "xi_3": (-v.k[2] * v.xi_3 - A_2 * v.xi_2 + short_q) / v.L_q,
            "xi_4": (-v.k[4] * v.xi_4 + short_d) / v.L_d,
            "D_2": v.m[0] * V[1] - v.leak * v.D_2,
            "D_3": v.m[1] * V[2] - v.leak * v.D_3,
            "D_4": v.m[2] * V[3] - v.leak * v.D_4,
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return voltages, commanded current and compensated errors."""
        V = self.compensated_errors(v)
        _, _, current_limited = self.virtual_controls(v, V)
        u_q, u_d, _, _, voltage_limited = self.currents(v, V)
        return {
            "u_q": u_q,
            "u_d": u_d,
            "i_q_ref": clamp(v.i_c, -v.i_max, v.i_max),
            "saturated": maximum(current_limited, voltage_limited),
            **{f"v_{i + 1}": V[i] for i in range(4)},
        }

    def errors(self, v: Any) -> list[Any]:
        """Return the errors z_1 to z_4 of position, speed, q- and d-axis current."""
        return [
            v.x_hat - v.x_d,
            v.v_hat - v.v_d - v.w,
            v.i_q - v.i_c,
            v.i_d - self.weakening(v, v.i_c),
        ]

    def compensated_errors(self, v: Any) -> list[Any]:
        """Return v_1 to v_4."""
        xi = (v.xi_1, v.xi_2, v.xi_3, v.xi_4)
        return [z - x for z, x in zip(self.errors(v), xi, strict=True)]

    def virtual_controls(self, v: Any, V: list[Any]) -> tuple[Any, Any, Any]:
        """Return approach speed beside v_d, q-axis current before its limit, and 1 if that acts, else 0."""
        z_1, z_2 = self.errors(v)[:2]
        w, _ = drive_laws.approach(v, v.k[0], -z_1)
        w = clamp(w - self.robust(v, 0, V[0], 0), -v.v_max, v.v_max)
        unknown = v.compensate * v.d_hat + v.D_2 + self.robust(v, 1, V[1], 1)
        wanted = v.a_d + v.w_rate - v.k[1] * z_2 - z_1
        wanted = wanted - drive_laws.known_acceleration(v, v.i_d) - unknown
        i_q = wanted / drive_laws.acceleration_per_current(v)
        return w, i_q, where(abs(i_q) > drive_laws.current_limit(v, drive_laws.steady_voltage(v)), 1.0, 0.0)

    def currents(self, v: Any, V: list[Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Return the voltages of the last two steps; see `DriveController.voltage`."""
        _, z_2, z_3, z_4 = self.errors(v)
        A_2 = drive_laws.acceleration_per_current(v)
        feedback_q = v.k[2] * z_3 + A_2 * z_2 + self.robust(v, 2, V[2], 2)
        feedback_d = v.k[4] * z_4 + self.robust(v, 4, V[3], 3)
        return self.voltage(v, v.i_c_rate - feedback_q / v.L_q - v.D_3, -feedback_d / v.L_d - v.D_4)

    def robust(self, v: Any, gain: int, error: Any, i: int) -> Any:
        """Return the tanh term of one step: varpi tanh(v / epsilon)."""
        return v.varpi[gain] * tanh(error / v.epsilon[i])

    def filtered(self, v: Any, i: int, value: Any, rate: Any, wanted: Any) -> Any:
        """Return the second derivative of a command filter's output."""
        return -2.0 * v.damping * v.omega_n[i] * rate - v.omega_n[i] * v.omega_n[i] * (value - wanted)
