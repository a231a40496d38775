"""The adaptive robust observer of screw position and speed."""

from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    DiscreteState,
    Input,
    Output,
    Parameter,
    State,
    clamp,
    cos,
    exp,
    logical_and,
    maximum,
    sin,
    where,
)


class EmlaObserver(Block):
    """Adaptive robust observer of screw position and speed, (17) to (25) of the paper.

    Everything that acts on the screw's acceleration and is not modelled counts as K in (17); f
    and eta_hat work against it. p is the solution of the Lyapunov equation (18) for the given
    alpha and Q: Algorithm 1 draws Q at random, which only p's size would notice.

    With `use_model` B u + g is the torque of i_q*, and the viscous friction of the estimated speed;
    C_eq and the reluctance torque of g_2 are left out.

    Departures, each a switch of its own:

    - `use_measured_current`: the torque of (20) is that of the measured current, which the motor
      has whatever was asked of it.
    - `omega_d`: an estimate d_hat of everything that the model does not know, load included, is
      added to (20). It integrates the innovation, d_hat' = omega_d alpha_2 y_bar, so that a
      constant K leaves no error of position or speed; with alpha_1 = 3 p, alpha_2 = 3 p^2 and
      omega_d = p / 3 all three poles are at -p. Needs `use_model`.
    - `interpolate`: y and i_q are held by who steps this block, and held at the end of the step
      they put x_hat half a step ahead. They move on a straight line from their last values
      instead. The first step, and one of another length than the last, see what is held.

    Norms: the paper calls ||.|| the squared norm (after (19)). Here ||y_bar|| is the absolute
    value in (21) and (23): only then is |f| <= eta_hat H, as (25) and the stability proof need.
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
        False, description="Take the torque of B u from the measured current, not from the commanded one"
    )
    omega_d = Parameter(
        0.0, unit="1/s", minimum=0.0, description="Bandwidth of the estimated disturbance d_hat; 0 is none"
    )
    interpolate = Parameter(False, description="Let y and i_q move on a line during a step")
    N_p = Parameter(
        8, minimum=1, name="model.N_p", description="Number of pole pairs, as the observer knows it"
    )
    Phi_PM = Parameter(
        0.15, unit="Wb", name="model.Phi_PM", description="Magnet flux, as the observer knows it"
    )
    A_eq = Parameter(
        35.26,
        unit="kg.m",
        minimum=1e-9,
        name="model.A_eq",
        description="Equivalent inertia, as the observer knows it",
    )
    B_eq = Parameter(
        3.67,
        unit="kg.m/s",
        minimum=0.0,
        name="model.B_eq",
        description="Equivalent friction, as the observer knows it",
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

    y_before = DiscreteState(0.0, unit="m", name="before.y", description="Position at the last step's end")
    i_before = DiscreteState(0.0, unit="A", name="before.i_q", description="Current at the last step's end")
    t_before = DiscreteState(0.0, unit="s", name="before.time", description="The last step's end")
    h_before = DiscreteState(0.0, unit="s", name="before.step", description="The last step's length")

    y_bar = Output(unit="m", description="Innovation y - x_hat")
    f = Output(description="Robust term of (21)")

    def derivatives(self, v: Any) -> dict[str, Any]:
        """(20) with A = [0 1; 0 0], C = [1 0], and (23)."""
        y = self.moving(v, v.y, v.y_before)
        y_bar = y - v.x_hat
        f = self.robust_term(v, y)
        p_11, p_12, p_22 = self.lyapunov_solution(v)
        determinant = p_11 * p_22 - p_12 * p_12
        measured = self.moving(v, v.i_q, v.i_before)
        current = where(v.use_measured_current, measured, v.i_q_ref)
        torque = 1.5 * v.N_p * v.Phi_PM * current
        model = v.use_model * (torque - v.B_eq * v.v_hat) / v.A_eq + v.d_hat
        return {
            "x_hat": v.v_hat + v.alpha_1 * y_bar + p_22 / determinant * f,
            "v_hat": model + v.alpha_2 * y_bar - p_12 / determinant * f,
            "d_hat": v.omega_d * v.alpha_2 * y_bar,
            "eta_hat": -self.m(v) * v.ell * v.eta_hat + v.ell * self.H(v, y) * abs(y_bar),
        }

    def update(self, v: Any) -> dict[str, Any]:
        """What `interpolate` needs of the step that ends."""
        return {"y_before": v.y, "i_before": v.i_q, "t_before": v.time, "h_before": v.time - v.t_before}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Innovation and robust term, to see whether f acts."""
        return {"y_bar": v.y - v.x_hat, "f": self.robust_term(v, v.y)}

    def moving(self, v: Any, held: Any, before: Any) -> Any:
        """A held input on its way from the value that it had when the step began."""
        part = clamp((v.time - v.t_before) / maximum(v.h_before, 1e-12), 0.0, 1.0)
        return where(self.moves(v), before + part * (held - before), held)

    def moves(self, v: Any) -> Any:
        """Whether held inputs are on their way."""
        return logical_and(v.interpolate, v.h_before > 0.0)

    def robust_term(self, v: Any, y: Any) -> Any:
        """Robust term f of (21): bounded by eta_hat H, linear in the innovation where that is small."""
        y_bar = y - v.x_hat
        bound = v.eta_hat * self.H(v, y)
        return bound * bound * y_bar / (bound * abs(y_bar) + self.m(v))

    def H(self, v: Any, y: Any) -> Any:
        """Bound of the uncertainty by (86); that of the held position once per step."""
        return where(self.moves(v), self.bound(v, y), self.bound(v, v.y))

    def bound(self, v: Any, y: Any) -> Any:
        """H(y) of (86)."""
        c, s = cos(y), sin(y)
        return v.H_0 * (c * c * c * c + s * s * s * s)

    def m(self, v: Any) -> Any:
        """Decaying term of (21) and (23), whose integral is bounded (22)."""
        return v.m_0 * exp(-v.m_decay * v.time)

    def lyapunov_solution(self, v: Any) -> tuple[Any, Any, Any]:
        """p_11, p_12, p_22 of the solution p of (18) for A_bar = [-alpha_1 1; -alpha_2 0]."""
        p_12 = -0.5 * v.Q_22
        p_11 = (v.Q_11 + v.alpha_2 * v.Q_22) / (2.0 * v.alpha_1)
        p_22 = (p_11 - v.alpha_1 * p_12 + v.Q_12) / v.alpha_2
        return p_11, p_12, p_22
