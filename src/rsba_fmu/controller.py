"""Robust subsystem-based adaptive (RSBA) control of one EMLA."""

from dataclasses import dataclass
from typing import Any

from fmublock import (
    DefaultExperiment,
    DiscreteState,
    Input,
    Output,
    Parameter,
    State,
    clamp,
    limit_magnitude,
    logical_and,
    maximum,
    minimum,
    where,
)

from . import drive_laws
from .known_drive import KnownDrive


@dataclass(frozen=True)
class Laws:
    """Results of the control laws: current in A, voltages in V, tracking forms P_1 to P_4, and limits."""

    i_q_ref: Any
    u_q: Any
    u_d: Any
    P: list[Any]
    current_limited: Any
    voltage_limited: Any


class RsbaController(KnownDrive):
    """Robust subsystem-based adaptive control of one EMLA, (26) to (41) of the paper.

    Four subsystems: 1 position, 2 speed, 3 q-axis current, 4 d-axis current; arrays are indexed
    by them. The defaults are the laws as printed. Each departure has its own parameter:

    - `x_2d_in_a_1` (true as printed): (31) contains -x_2d, and P_2 = x_e2 - a_1 cancels the
      reference speed. The position then lags a moving reference by 2 |v_d| / beta_1. Without it x_2d
      cancels the derivative of x_1d instead (Omega_1 = 0 in (35)), and the lag disappears.
    - `feed_acceleration`: if P_2 contains the reference speed, (39) leaves its derivative to the
      robust gains. Adding a_d / A_2 to u_2 supplies it (Omega_2 = 0).
    - `limit_acceleration`: the published start is millimetres from the reference and commands 1e5 A.
      With limits a linear a_1 overshoots. The approach speed is therefore limited to what can be
      braked with `a_max`: min(k e, sqrt(2 a_max (e - a_max / (2 k^2)))).
    - `limit_current`, `limit_voltage`: keep i_q* and the voltage vector within the limits of motor and
      inverter, so that the controller detects its saturation.
    - `freeze_adaptation`: (32) integrates errors that a saturated actuator cannot remove
      (theta_hat reached 1e14). Adaptation stops while its subsystem saturates, and at theta_max.
    - `compensate`, `omega_u`: (39) leaves d_2, d_3 and d_4 to the feedback, with a remaining position
      error of 4 d_2 / (beta_1 beta_2). These options subtract the estimates of the observer (d_hat)
      and of the current model. The proof then holds for the remainder of d_i.
    - `limit_speed`: a start some millimetres off commands speeds at which the back-EMF takes the voltage
      that braking needs. This option limits the approach to v_max and to the base speed.
    - `weaken_field`: above the base speed a negative i_d* allows i_q*, and P_4 = i_d - i_d*.
    - `measure_supply`: the voltage limit is u_available if that is less than u_max.

    |P_i|^2 in (32) is the plain square.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    x_hat = Input(
        unit="m", nominal=0.1, symbol="x_1", description="Estimated screw position x_1", terminal="estimate"
    )
    v_hat = Input(
        unit="m/s", nominal=0.1, symbol="x_2", description="Estimated screw speed x_2", terminal="estimate"
    )
    i_q = Input(unit="A", nominal=10.0, description="Measured q-axis current x_3", terminal="drive")
    i_d = Input(unit="A", nominal=10.0, description="Measured d-axis current x_4", terminal="drive")
    x_d = Input(
        unit="m", nominal=0.1, symbol="x_{1d}", description="Reference position x_1d", terminal="reference"
    )
    v_d = Input(unit="m/s", nominal=0.1, description="Reference speed x_2d", terminal="reference")
    a_d = Input(
        unit="m/s2", description="Reference acceleration, used with feed_acceleration", terminal="reference"
    )
    d_hat = Input(
        unit="m/s2",
        description="Estimated disturbance of the screw's acceleration, used with compensate",
        terminal="estimate",
    )
    u_available = Input(
        1e4,
        unit="V",
        nominal=100.0,
        description="Longest voltage vector that the supply allows, used with measure_supply",
        terminal="drive",
    )

    beta = Parameter(
        [3000.0, 3000.0, 1000.0, 1000.0], shape=4, unit="1/s", minimum=1e-9, description="Feedback gain"
    )
    zeta = Parameter(
        100.0, shape=4, minimum=0.0, description="Gain of the adaptation in feedback and in (32)"
    )
    delta = Parameter(
        [100.0, 100.0, 110.0, 110.0], shape=4, minimum=0.0, description="Adaptation rate of (32)"
    )
    sigma = Parameter([0.001, 0.001, 0.01, 0.01], shape=4, minimum=0.0, description="Adaptation leak of (32)")

    x_2d_in_a_1 = Parameter(
        True, symbol=r"\kappa_1", description="Keep -x_2d in (31), as printed; the position then lags"
    )
    feed_acceleration = Parameter(False, symbol=r"\kappa_2", description="Add a_d / A_2 to (39)")
    limit_acceleration = Parameter(False, description="Keep the approach speed to what a_max can brake")
    limit_current = Parameter(False, description="Keep i_q* within i_max")
    limit_voltage = Parameter(False, description="Keep the voltage vector within u_max")
    freeze_adaptation = Parameter(False, description="Stop adapting while saturated and at theta_max")
    limit_speed = Parameter(False, description="Keep the approach within v_max and the base speed")
    compensate = Parameter(False, symbol=r"\kappa_3", description="Subtract d_hat / A_2 from u_2")
    weaken_field = Parameter(False, description="Use i_d < 0 when the back-EMF requires it")
    measure_supply = Parameter(False, description="Use u_available as the voltage limit")
    omega_u = Parameter(
        0.0,
        unit="1/s",
        minimum=0.0,
        description="Bandwidth of the estimated voltage disturbances d_3 and d_4; 0 is none",
    )
    v_max = Parameter(0.136, unit="m/s", minimum=1e-9, name="limit.v_max", description="Largest screw speed")
    u_reserve = Parameter(
        0.1,
        minimum=0.0,
        maximum=0.9,
        name="limit.u_reserve",
        symbol="r",
        description="Fraction of the voltage that weaken_field reserves for changes of current",
    )
    i_reserve = Parameter(
        0.0,
        minimum=0.0,
        maximum=0.9,
        name="limit.i_reserve",
        symbol="r_i",
        description="Fraction of i_max reserved for noise and delay",
    )
    theta_max = Parameter(
        1e6, minimum=0.0, name="limit.theta_max", description="Largest adaptation parameter"
    )

    theta = State(
        0.0, shape=4, minimum=0.0, symbol=r"\hat{\theta}_i", description="Adaptation parameter theta_hat"
    )

    z_q = State(0.0, unit="A", description="q-axis current that the known voltages would make")
    z_d = State(0.0, unit="A", description="d-axis current that the known voltages would make")

    u_q_before = DiscreteState(0.0, unit="V", name="before.u_q", description="u_q of the step that ends")
    u_d_before = DiscreteState(0.0, unit="V", name="before.u_d", description="u_d of the step that ends")

    u_q = Output(unit="V", nominal=100.0, description="q-axis voltage u_3", terminal="drive")
    u_d = Output(unit="V", nominal=100.0, description="d-axis voltage u_4", terminal="drive")
    i_q_ref = Output(
        unit="A", nominal=10.0, description="Commanded q-axis current i_q* = u_2", terminal="drive"
    )
    saturated = Output(description="1 while current or voltage is at its limit")
    P_1 = Output(unit="m", name="P[1]", description="Tracking form of the position (30)")
    P_2 = Output(unit="m/s", name="P[2]", description="Tracking form of the speed (30)")
    P_3 = Output(unit="A", name="P[3]", description="Tracking form of the q-axis current (30)")
    P_4 = Output(unit="A", name="P[4]", description="Tracking form of the d-axis current (30)")

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the adaptation laws (32), and the derivatives of the modelled currents."""
        laws = self.laws(v)
        outer = maximum(laws.current_limited, laws.voltage_limited)
        frozen = [outer, outer, laws.voltage_limited, laws.voltage_limited]
        _, g_3, g_4 = self.model(v)
        d_3, d_4 = self.voltage_disturbances(v)
        return {
            "theta": [self.adaptation(v, i, laws.P[i], frozen[i]) for i in range(4)],
            "z_q": where(v.omega_u > 0.0, v.u_q_before / v.L_q + g_3 + d_3, 0.0),
            "z_d": where(v.omega_u > 0.0, v.u_d_before / v.L_d + g_4 + d_4, 0.0),
        }

    def update(self, v: Any) -> dict[str, Any]:
        """Return the voltages that the plant will have during the next step."""
        laws = self.laws(v)
        return {"u_q_before": laws.u_q, "u_d_before": laws.u_d}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the control signals (39) within their limits, and the tracking forms (30)."""
        laws = self.laws(v)
        return {
            "u_q": laws.u_q,
            "u_d": laws.u_d,
            "i_q_ref": laws.i_q_ref,
            "saturated": maximum(laws.current_limited, laws.voltage_limited),
            **{f"P_{i + 1}": laws.P[i] for i in range(4)},
        }

    def laws(self, v: Any) -> "Laws":
        """Evaluate the laws (30), (31) and (39) within the limits."""
        A_2 = drive_laws.acceleration_per_current(v)
        A_3, A_4 = 1.0 / v.L_q, 1.0 / v.L_d
        g_2, g_3, g_4 = self.model(v)
        u_max = self.known_voltage(v)
        u_steady = (1.0 - v.u_reserve) * u_max

        P_1 = v.x_hat - v.x_d
        a_1 = self.speed_beyond_reference(v, P_1, u_max) - v.x_2d_in_a_1 * v.v_d
        P_2 = (v.v_hat - v.v_d) - a_1
        u_2 = -(v.beta[1] + v.zeta[1] * v.theta[1]) / (2.0 * A_2) * P_2 - P_1 / A_2 - g_2 / A_2
        u_2 = u_2 + v.feed_acceleration * v.a_d / A_2
        u_2 = u_2 - where(v.compensate, v.d_hat, 0.0) / A_2
        motor = (1.0 - v.i_reserve) * v.i_max
        i_max = where(v.weaken_field, minimum(motor, drive_laws.current_limit(v, u_steady)), motor)
        i_q_ref = where(v.limit_current, clamp(u_2, -i_max, i_max), u_2)
        current_limited = where(logical_and(v.limit_current, abs(u_2) > i_max), 1.0, 0.0)

        P_3 = v.i_q - i_q_ref
        P_4 = v.i_d - where(v.weaken_field, drive_laws.weakening_current(v, i_q_ref, u_steady), 0.0)
        d_3, d_4 = self.voltage_disturbances(v)
        u_3 = -(v.beta[2] + v.zeta[2] * v.theta[2]) / (2.0 * A_3) * P_3 - (g_3 + d_3) / A_3
        u_4 = -(v.beta[3] + v.zeta[3] * v.theta[3]) / (2.0 * A_4) * P_4 - (g_4 + d_4) / A_4
        within_q, within_d, too_long = limit_magnitude(u_3, u_4, u_max)
        return Laws(
            i_q_ref=i_q_ref,
            u_q=where(v.limit_voltage, within_q, u_3),
            u_d=where(v.limit_voltage, within_d, u_4),
            P=[P_1, P_2, P_3, P_4],
            current_limited=current_limited,
            voltage_limited=where(logical_and(v.limit_voltage, too_long > 0.0), 1.0, 0.0),
        )

    def known_voltage(self, v: Any) -> Any:
        """Return the longest voltage vector in V: that of the model, or less if the supply is low."""
        return where(v.measure_supply, maximum(minimum(v.u_max, v.u_available), 1e-3), v.u_max)

    def voltage_disturbances(self, v: Any) -> tuple[Any, Any]:
        """Return the estimates of d_3 and d_4 in A/s from the differences of currents and model."""
        return v.omega_u * (v.i_q - v.z_q), v.omega_u * (v.i_d - v.z_d)

    def speed_beyond_reference(self, v: Any, P_1: Any, u_max: Any) -> Any:
        """Return the first term of a_1 in m/s; with limit_speed at most what the limits allow beside v_d."""
        wanted = -self.approach_speed(v, P_1)
        most = drive_laws.fastest(v, u_max)
        return where(v.limit_speed, clamp(v.v_d + wanted, -most, most) - v.v_d, wanted)

    def model(self, v: Any) -> tuple[Any, Any, Any]:
        """Return g_2, g_3, g_4 of Table I (g_1 = 0)."""
        omega_e = v.N_p * v.alpha_RL * v.v_hat
        g_2 = drive_laws.known_acceleration(v, v.i_d)
        g_3 = (-v.R_s * v.i_q - omega_e * (v.i_d * v.L_d + v.Phi_PM)) / v.L_q
        g_4 = (-v.R_s * v.i_d + omega_e * v.i_q * v.L_q) / v.L_d
        return g_2, g_3, g_4

    def approach_speed(self, v: Any, P_1: Any) -> Any:
        """Return the first term of -a_1 in m/s: k P_1, or what a_max can brake if that is less."""
        k = (v.beta[0] + v.zeta[0] * v.theta[0]) / 2.0
        limited, _ = drive_laws.braked(v.a_max, k, P_1)
        return where(v.limit_acceleration, limited, k * P_1)

    def adaptation(self, v: Any, i: int, P_i: Any, frozen: Any) -> Any:
        """Return the derivative of theta_hat_i (32), 0 while freeze_adaptation stops it."""
        growth = -v.delta[i] * v.sigma[i] * v.theta[i] + 0.5 * v.zeta[i] * v.delta[i] * P_i * P_i
        # slow enough that no internal step goes past the bound
        allowed = minimum(growth, (v.theta_max - v.theta[i]) / v.internal_step)
        return where(v.freeze_adaptation, (1.0 - frozen) * allowed, growth)
