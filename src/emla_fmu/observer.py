"""The adaptive robust observer of screw position and speed."""

from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    DiscreteState,
    Input,
    Output,
    Parameter,
    StartTime,
    State,
    cos,
    exp,
    sin,
    where,
)

from .held_inputs import interpolated, is_moving


class EmlaObserver(Block):
    """Adaptive robust observer of screw position and speed, (17) to (25) of the paper.

    K in (17) contains all accelerations of the screw that are not modelled; f and eta_hat compensate
    it. p is the solution of the Lyapunov equation (18) for alpha and Q. Algorithm 1 draws Q at random,
    but only the size of p depends on it.

    With `use_model`, B u + g is the torque of i_q* and the viscous friction at the estimated speed.
    C_eq and the reluctance torque of g_2 are left out.

    Departures from the paper, each with its own parameter:

    - `use_measured_current`: the torque of (20) is that of the measured current, which may differ from
      the commanded one.
    - `omega_d`: an estimate d_hat of all unmodelled accelerations, with that of the load, is added to
      (20). It integrates the innovation, d_hat' = omega_d alpha_2 y_bar, so that a constant K causes no
      error of position or speed. With alpha_1 = 3 p, alpha_2 = 3 p^2 and omega_d = p / 3, all three
      poles are at -p. Needs `use_model`.
    - `omega_r`: d_hat follows ramps as well. r_hat, an estimate of its rate, is added to d_hat' and
      integrates the innovation: r_hat' = omega_r omega_d alpha_2 y_bar. With alpha_1 = 4 p,
      alpha_2 = 6 p^2, omega_d = 2 p / 3 and omega_r = p / 4, all four poles are at -p. Needs `omega_d`.
    - `ahead`: the disturbance that d_hat estimates is that of a later time. A controller that subtracts
      d_hat acts on the screw after the lag of its current loop; d_hat predicts by this lag. Needs `omega_r`.
    - `interpolate`: inputs are held during a step. If the master holds the values of the step's end,
      x_hat is half a step ahead. With this option, y and i_q move on a straight line from their last
      values, which takes as long as the last step. In the first step they are held.

    Norms: the paper calls ||.|| the squared norm (after (19)). Here ||y_bar|| is the absolute value in
    (21) and (23). Only then does |f| <= eta_hat H hold, which (25) and the stability proof need.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    y = Input(unit="m", nominal=0.1, description="Measured screw position", terminal="sensor.x_measured")
    i_q_ref = Input(
        unit="A",
        nominal=10.0,
        description="Commanded q-axis current i_q*, used with use_model",
        terminal="drive",
    )
    i_q = Input(
        unit="A",
        nominal=10.0,
        description="Measured q-axis current, used with use_measured_current",
        terminal="drive",
    )

    alpha_1 = Parameter(0.3192, unit="1/s", minimum=1e-9, description="Gain on the position estimate")
    alpha_2 = Parameter(0.3129, unit="1/s2", minimum=1e-9, description="Gain on the speed estimate")
    Q_11 = Parameter(0.7752, minimum=1e-9, description="Q of the Lyapunov equation (18), row 1")
    Q_12 = Parameter(-0.0775, description="Q of the Lyapunov equation (18), off the diagonal")
    Q_22 = Parameter(0.3949, minimum=1e-9, description="Q of the Lyapunov equation (18), row 2")
    H_0 = Parameter(20.0, minimum=0.0, description="H(y) = H_0 (cos(y)^4 + sin(y)^4), y in m (86)")
    m_0 = Parameter(200.0, minimum=1e-30, description="m(t) = m_0 exp(-m_decay t) of (21) and (23) at t = 0")
    m_decay = Parameter(
        1e-3, unit="1/s", minimum=1e-12, symbol=r"\lambda", description="Decay of m(t), so that (22) holds"
    )
    ell = Parameter(1.0, minimum=0.0, description="Adaptation gain of (23)")
    use_model = Parameter(
        True,
        symbol=r"\kappa",
        description="Include B u + g of (20): commanded torque and viscous friction",
    )
    use_measured_current = Parameter(
        False, description="Compute the torque of B u from the measured instead of the commanded current"
    )
    omega_d = Parameter(
        0.0, unit="1/s", minimum=0.0, description="Bandwidth of the estimated disturbance d_hat; 0 is none"
    )
    omega_r = Parameter(
        0.0, unit="1/s", minimum=0.0, description="Bandwidth of the estimated rate r_hat of d_hat; 0 is none"
    )
    ahead = Parameter(
        0.0, unit="s", minimum=0.0, symbol=r"\tau", description="Time by which d_hat predicts the disturbance"
    )
    interpolate = Parameter(False, description="Interpolate y and i_q linearly during a step")
    N_p = Parameter(
        8, minimum=1, name="model.N_p", description="Number of pole pairs in the observer's model"
    )
    Phi_PM = Parameter(
        0.15, unit="Wb", name="model.Phi_PM", description="Magnet flux in the observer's model"
    )
    A_eq = Parameter(
        35.26,
        unit="kg.m",
        minimum=1e-9,
        name="model.A_eq",
        description="Equivalent inertia in the observer's model",
    )
    B_eq = Parameter(
        3.67,
        unit="kg.m/s",
        minimum=0.0,
        name="model.B_eq",
        description="Equivalent friction in the observer's model",
    )
    x_hat_start = Parameter(
        0.24, unit="m", name="start.x_hat", description="Initial estimate of the position"
    )
    eta_hat_start = Parameter(
        1.0, minimum=0.0, name="start.eta_hat", description="Initial estimate of the bound"
    )

    x_hat = State(
        x_hat_start,
        unit="m",
        nominal=0.1,
        symbol=r"\hat{x}_1",
        description="Estimated screw position",
        terminal="estimate",
    )
    v_hat = State(
        0.0,
        unit="m/s",
        nominal=0.1,
        symbol=r"\hat{x}_2",
        description="Estimated screw speed",
        terminal="estimate",
    )
    d_hat = State(
        0.0, unit="m/s2", description="Estimated disturbance of the screw's acceleration", terminal="estimate"
    )
    eta_hat = State(eta_hat_start, minimum=0.0, description="Estimated bound of the uncertainty")
    r_hat = State(0.0, unit="m/s3", description="Estimated rate of the disturbance", terminal="estimate")

    y_before = DiscreteState(0.0, unit="m", name="before.y", description="Position at the last step's end")
    i_before = DiscreteState(0.0, unit="A", name="before.i_q", description="Current at the last step's end")
    t_before = StartTime(0.0, unit="s", name="before.time", description="The last step's end")
    h_before = DiscreteState(0.0, unit="s", name="before.step", description="The last step's length")

    y_bar = Output(unit="m", description="Innovation y - x_hat")
    f = Output(description="Robust term of (21)")

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return (20) with A = [0 1; 0 0] and C = [1 0], and (23)."""
        y = interpolated(v, v.y, v.y_before)
        y_bar = y - v.x_hat
        f = self.robust_term(v, y)
        p_11, p_12, p_22 = self.lyapunov_solution(v)
        determinant = p_11 * p_22 - p_12 * p_12
        measured = interpolated(v, v.i_q, v.i_before)
        current = where(v.use_measured_current, measured, v.i_q_ref)
        torque = 1.5 * v.N_p * v.Phi_PM * current
        model = v.use_model * (torque - v.B_eq * v.v_hat) / v.A_eq
        model = model + v.d_hat - v.ahead * v.r_hat
        d_hat_gain = v.omega_d * v.alpha_2
        r_hat_rate = v.omega_r * d_hat_gain * y_bar
        return {
            "x_hat": v.v_hat + v.alpha_1 * y_bar + p_22 / determinant * f,
            "v_hat": model + v.alpha_2 * y_bar - p_12 / determinant * f,
            "d_hat": d_hat_gain * y_bar + v.r_hat + v.ahead * r_hat_rate,
            "eta_hat": -self.m(v) * v.ell * v.eta_hat + v.ell * self.H(v, y) * abs(y_bar),
            "r_hat": r_hat_rate,
        }

    def update(self, v: Any) -> dict[str, Any]:
        """Return the values of the ending step that `interpolate` needs."""
        return {"y_before": v.y, "i_before": v.i_q, "t_before": v.time, "h_before": v.time - v.t_before}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return innovation and robust term, which show whether f acts."""
        return {"y_bar": v.y - v.x_hat, "f": self.robust_term(v, v.y)}

    def robust_term(self, v: Any, y: Any) -> Any:
        """Return the robust term f of (21): at most eta_hat H, linear in small innovations."""
        y_bar = y - v.x_hat
        bound = v.eta_hat * self.H(v, y)
        return bound * bound * y_bar / (bound * abs(y_bar) + self.m(v))

    def H(self, v: Any, y: Any) -> Any:
        """Return the bound of the uncertainty by (86); for a held position it is computed once per step."""
        return where(is_moving(v), self.bound(v, y), self.bound(v, v.y))

    def bound(self, v: Any, y: Any) -> Any:
        """Return H(y) of (86)."""
        c, s = cos(y), sin(y)
        return v.H_0 * (c * c * c * c + s * s * s * s)

    def m(self, v: Any) -> Any:
        """Return the decaying term of (21) and (23), whose integral is bounded (22)."""
        return v.m_0 * exp(-v.m_decay * v.time)

    def lyapunov_solution(self, v: Any) -> tuple[Any, Any, Any]:
        """Return p_11, p_12, p_22 of the solution p of (18) for A_bar = [-alpha_1 1; -alpha_2 0]."""
        p_12 = -0.5 * v.Q_22
        p_11 = (v.Q_11 + v.alpha_2 * v.Q_22) / (2.0 * v.alpha_1)
        p_22 = (p_11 - v.alpha_1 * p_12 + v.Q_12) / v.alpha_2
        return p_11, p_12, p_22
