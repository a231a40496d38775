"""The observer of a load that is not rigid, from a position sensor at the load."""

from typing import Any

from fmublock import Block, DefaultExperiment, DiscreteState, Input, Output, Parameter, State, sign, where


class LoadObserver(Block):
    """Observes position, speed and acceleration of a load, and measures the load force at the start.

    The load is a mass behind a spring and a damper, whose other end is the screw. So the deflection gives its
    acceleration, without differentiating a measured value. f_hat is what the model lacks: changes of the load
    force, and errors of stiffness and mass.

    At the start the load is at rest. The deflection then is that of the load force, F_0 = k delta_0: a load
    sensor makes knowledge of the load force superfluous.

    With l_1 = 3 w, l_2 = 3 w^2 and l_3 = w^3, all three poles are at -w.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    y = Input(unit="m", nominal=0.1, description="Measured load position")
    x_1 = Input(unit="m", nominal=0.1, description="Measured screw position")
    v_1 = Input(unit="m/s", nominal=0.1, description="Estimated screw speed")

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
    l_1 = Parameter(0.0, unit="1/s", minimum=0.0, description="Gain on the position estimate")
    l_2 = Parameter(0.0, unit="1/s2", minimum=0.0, description="Gain on the speed estimate")
    l_3 = Parameter(0.0, unit="1/s3", minimum=0.0, description="Gain on the estimate of unknown forces")

    travel = State(
        0.0, unit="m", nominal=0.1, symbol="s", description="Estimated way of the load since the start"
    )
    v_hat = State(
        0.0, unit="m/s", nominal=0.1, symbol=r"\hat{v}_m", description="Estimated speed of the load"
    )
    f_hat = State(
        0.0,
        unit="m/s2",
        symbol=r"\hat{f}",
        description="Estimated acceleration of the load by unknown forces",
    )

    has_begun = DiscreteState(0.0, name="start.has_begun", description="1 after the first step")
    y_start = DiscreteState(
        0.0, unit="m", name="start.y", symbol="y_0", description="First measured position"
    )
    deflection_start = DiscreteState(
        0.0, unit="m", name="start.deflection", symbol=r"\delta_0", description="First measured deflection"
    )

    x_hat = Output(unit="m", nominal=0.1, symbol=r"\hat{x}_m", description="Estimated position of the load")
    a_hat = Output(unit="m/s2", symbol=r"\hat{a}_m", description="Estimated acceleration of the load")
    F_0 = Output(unit="N", nominal=1e4, description="Load force at the start, positive against extension")
    y_bar = Output(unit="m", nominal=1e-3, description="Innovation y - x_hat")

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the model of the load, corrected by the innovation."""
        y_bar = v.y - self.position(v)
        return {
            "travel": v.v_hat + v.l_1 * y_bar,
            "v_hat": self.acceleration(v) + v.l_2 * y_bar,
            "f_hat": v.l_3 * y_bar,
        }

    def update(self, v: Any) -> dict[str, Any]:
        """Keep what was measured at the start."""
        return {"has_begun": 1.0, "y_start": self.first(v), "deflection_start": self.first_deflection(v)}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the estimates that are no states, and the load force at the start."""
        x_hat = self.position(v)
        return {
            "x_hat": x_hat,
            "a_hat": self.acceleration(v),
            "F_0": v.stiffness * self.spring(v, self.first_deflection(v)),
            "y_bar": v.y - x_hat,
        }

    def first(self, v: Any) -> Any:
        """Return the first measured position of the load in m."""
        return where(v.has_begun > 0.0, v.y_start, v.y)

    def first_deflection(self, v: Any) -> Any:
        """Return the first measured deflection in m."""
        return where(v.has_begun > 0.0, v.deflection_start, v.x_1 - v.y)

    def position(self, v: Any) -> Any:
        """Return the estimated position of the load in m."""
        return self.first(v) + v.travel

    def spring(self, v: Any, deflection: Any) -> Any:
        """Return the part of a deflection in m that is not play; the load keeps the contact of the start."""
        return deflection - 0.5 * v.backlash * sign(self.first_deflection(v))

    def acceleration(self, v: Any) -> Any:
        """Return the estimated acceleration of the load in m/s2."""
        change = v.x_1 - self.position(v) - self.first_deflection(v)
        return (v.stiffness * change + v.damping * (v.v_1 - v.v_hat)) / v.m_load + v.f_hat
