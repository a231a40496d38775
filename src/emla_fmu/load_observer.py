"""The observer of a load that is not rigid, from a position sensor at the load."""

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
    clamp,
    where,
)

from .held_inputs import has_begun, interpolated


class LoadObserver(Block):
    """Observes position, speed and acceleration of a load, and measures the load force at the start.

    The load is a mass behind a spring and a damper, whose other end is the screw. So the deflection gives its
    acceleration, without differentiating a measured value. f_hat is what the model lacks: changes of the load
    force, and errors of stiffness and mass.

    At the start, which is that of the first step, the load is at rest. The deflection then is that of the
    load force, F_0 = k delta_0 without backlash: a load sensor makes knowledge of the load force superfluous.
    With backlash, the load keeps the contact of the start.

    The estimate's error has the characteristic polynomial
    s^3 + (l_1 + c / m) s^2 + (l_2 + (k + c l_1) / m) s + l_3. With l_1 = 3 w - c / m,
    l_2 = 3 w^2 - (k + c l_1) / m and l_3 = w^3, all three poles are at -w. That is 1000 1/s by default.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)
    has_model_exchange = False  # the values of the start are sampled

    y = Input(unit="m", nominal=0.1, description="Measured load position", terminal="sensor.load.x_measured")
    x_1 = Input(unit="m", nominal=0.1, description="Measured screw position", terminal="sensor.x_measured")
    v_1 = Input(unit="m/s", nominal=0.1, description="Estimated screw speed", terminal="estimate.v_hat")

    stiffness = Parameter(
        1e8,
        unit="N/m",
        minimum=1e-3,
        name="model.stiffness",
        symbol="k",
        description="Stiffness between screw and load",
    )
    damping = Parameter(
        0.0,
        unit="N.s/m",
        minimum=0.0,
        name="model.damping",
        symbol="c",
        description="Damping between screw and load",
    )
    m_load = Parameter(
        1000.0, unit="kg", minimum=1e-3, name="model.m_load", symbol="m", description="Mass of the load"
    )
    backlash = Parameter(
        0.0,
        unit="m",
        minimum=0.0,
        name="model.backlash",
        symbol="b",
        description="Play between screw and load, from one contact to the other",
    )
    l_1 = Parameter(3e3, unit="1/s", minimum=0.0, description="Gain on the position estimate")
    l_2 = Parameter(2.9e6, unit="1/s2", description="Gain on the speed estimate")
    l_3 = Parameter(1e9, unit="1/s3", minimum=0.0, description="Gain on the estimate of unknown forces")

    interpolate = Parameter(True, description="Interpolate y, x_1 and v_1 linearly during a step")

    travel = State(
        0.0, unit="m", nominal=0.1, symbol="s", description="Estimated way of the load since the start"
    )
    v_hat = State(
        0.0,
        unit="m/s",
        nominal=0.1,
        symbol=r"\hat{v}_m",
        description="Estimated speed of the load",
        terminal="load_estimate",
    )
    f_hat = State(
        0.0,
        unit="m/s2",
        symbol=r"\hat{f}",
        description="Estimated acceleration of the load by unknown forces",
    )

    y_start = DiscreteState(
        0.0, unit="m", name="start.y", symbol="y_0", description="First measured position"
    )
    deflection_start = DiscreteState(
        0.0, unit="m", name="start.deflection", symbol=r"\delta_0", description="First measured deflection"
    )
    y_before = DiscreteState(0.0, unit="m", name="before.y", description="Load position in the last step")
    x_1_before = DiscreteState(
        0.0, unit="m", name="before.x_1", description="Screw position in the last step"
    )
    v_1_before = DiscreteState(0.0, unit="m/s", name="before.v_1", description="Screw speed in the last step")
    t_before = StartTime(0.0, unit="s", name="before.time", symbol="t_-", description="The last step's end")
    h_before = DiscreteState(
        0.0, unit="s", name="before.step", symbol="h_-", description="The last step's length"
    )

    x_hat = Output(
        unit="m",
        nominal=0.1,
        symbol=r"\hat{x}_m",
        description="Estimated position of the load",
        terminal="load_estimate",
    )
    a_hat = Output(
        unit="m/s2",
        symbol=r"\hat{a}_m",
        description="Estimated acceleration of the load",
        terminal="load_estimate",
    )
    F_0 = Output(
        unit="N",
        nominal=1e4,
        description="Load force at the start, positive against extension",
        terminal="load_estimate",
    )
    y_bar = Output(unit="m", nominal=1e-3, description="Innovation y - x_hat")

    def conditions(self, v: Any) -> dict[str, Any]:
        """Refuse gains with which the estimate's error would grow, by Routh's criterion."""
        damping = v.l_1 + v.damping / v.m_load
        stiffness = v.l_2 + (v.stiffness + v.damping * v.l_1) / v.m_load
        return {
            "the observer is unstable: l_3 must be at most (l_1 + c / m) (l_2 + (k + c l_1) / m), with k, c "
            "and m of the model": v.l_3 <= damping * stiffness
        }

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the model of the load, corrected by the innovation; measured values move during a step."""
        x_1, v_1 = interpolated(v, v.x_1, v.x_1_before), interpolated(v, v.v_1, v.v_1_before)
        y_bar = interpolated(v, v.y, v.y_before) - self.position(v)
        return {
            "travel": v.v_hat + v.l_1 * y_bar,
            "v_hat": self.acceleration(v, x_1, v_1) + v.l_2 * y_bar,
            "f_hat": v.l_3 * y_bar,
        }

    def update(self, v: Any) -> dict[str, Any]:
        """Return what was measured at the start, and in the step that ends."""
        return {
            "y_start": self.first(v),
            "deflection_start": self.first_deflection(v),
            "y_before": v.y,
            "x_1_before": v.x_1,
            "v_1_before": v.v_1,
            "t_before": v.time,
            "h_before": v.time - v.t_before,
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the estimates that are no states, and the load force at the start."""
        x_hat, deflection = self.position(v), self.first_deflection(v)
        return {
            "x_hat": x_hat,
            "a_hat": self.acceleration(v, v.x_1, v.v_1),
            # none within the play
            "F_0": v.stiffness * (deflection - clamp(deflection, -0.5 * v.backlash, 0.5 * v.backlash)),
            "y_bar": v.y - x_hat,
        }

    def first(self, v: Any) -> Any:
        """Return the first measured position of the load in m."""
        return where(has_begun(v), v.y_start, v.y)

    def first_deflection(self, v: Any) -> Any:
        """Return the first measured deflection in m."""
        return where(has_begun(v), v.deflection_start, v.x_1 - v.y)

    def position(self, v: Any) -> Any:
        """Return the estimated position of the load in m."""
        return self.first(v) + v.travel

    def acceleration(self, v: Any, x_1: Any, v_1: Any) -> Any:
        """Return the estimated acceleration of the load in m/s2, for a screw at x_1 m with v_1 m/s."""
        change = x_1 - self.position(v) - self.first_deflection(v)
        return (v.stiffness * change + v.damping * (v_1 - v.v_hat)) / v.m_load + v.f_hat
