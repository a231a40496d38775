"""The electromechanical linear actuator with a load that is not rigid."""

from typing import Any

from fmublock import DefaultExperiment, DiscreteState, Output, Parameter, State, where

from . import electrics, sensors, transmission
from .plant import EmlaPlant, screw_acceleration


class EmlaCompliantPlant(EmlaPlant):
    """An `EmlaPlant` that moves a second mass, the load, through a spring, a damper and backlash.

    The first mass is all that the `EmlaPlant` has: motor, gearbox and `screw.M_BS`. The load force acts on
    the second mass, friction and end stops on the first. The encoder is at the motor, as in most drives. It
    can be at the load instead. A further position sensor is at the load. With a very stiff spring, this is an
    `EmlaPlant` with the sum of both masses.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    m_load = Parameter(
        1000.0, unit="kg", minimum=1e-3, name="load.m", symbol="m", description="Mass of the load"
    )
    stiffness = Parameter(
        1e8,
        unit="N/m",
        minimum=0.0,
        name="transmission.stiffness",
        symbol="k",
        description="Stiffness between screw and load",
    )
    damping = Parameter(
        0.0,
        unit="N.s/m",
        minimum=0.0,
        name="transmission.damping",
        symbol="c",
        description="Damping between screw and load",
    )
    backlash = Parameter(
        0.0,
        unit="m",
        minimum=0.0,
        name="transmission.backlash",
        symbol="b",
        description="Play between screw and load, from one contact to the other",
    )
    at_load = Parameter(
        False,
        name="sensor.at_load",
        description="Whether the position sensor is at the load, not at the motor",
    )
    sigma_load = Parameter(
        0.0,
        unit="m",
        minimum=0.0,
        name="load.sensor.sigma",
        symbol=r"\sigma_m",
        description="Standard deviation of the noise of a position sensor at the load",
    )
    resolution_load = Parameter(
        0.0,
        unit="m",
        minimum=0.0,
        name="load.sensor.resolution",
        symbol="q_m",
        description="Position step of a sensor at the load; 0 is none",
    )
    seed_load = Parameter(
        738219457,
        minimum=1,
        maximum=2147483646,
        name="load.sensor.seed",
        description="Start of the noise sequence of a sensor at the load",
    )
    deflection_start = Parameter(
        0.0, unit="m", name="start.deflection", description="Initial deflection of the transmission"
    )

    deflection = State(
        deflection_start,
        unit="m",
        nominal=1e-3,
        name="transmission.deflection",
        symbol=r"\delta",
        description="Position of the screw minus that of the load",
    )
    v_load = State(0.0, unit="m/s", nominal=0.1, name="load.v", symbol="v_m", description="Speed of the load")

    random_load = DiscreteState(
        seed_load, name="load.sensor.random", description="State of the load sensor's noise generator"
    )
    noise_load = DiscreteState(
        0.0, name="load.sensor.noise", description="Present draw from N(0, 1) for the load sensor"
    )

    x_load = Output(unit="m", nominal=0.1, name="load.x", symbol="x_m", description="Position of the load")
    a_load = Output(unit="m/s2", name="load.a", symbol="a_m", description="Acceleration of the load")
    F_T = Output(
        unit="N",
        nominal=1e4,
        name="transmission.force",
        description="Force of the screw on the load, positive if it pushes",
    )
    x_load_measured = Output(
        unit="m",
        nominal=0.1,
        name="load.x_measured",
        symbol="x_{m,measured}",
        description="Position of the load, as measured by a sensor there",
        terminal="sensor",
    )

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return (9) with the force of the transmission as load, and the motion of the load."""
        force = transmission.force(v)
        return {
            "x_L": v.v_L,
            "v_L": screw_acceleration(v, force),
            **electrics.derivatives(v),
            "deflection": v.v_L - v.v_load,
            "v_load": (force - self.load_force(v)) / v.m_load,
        }

    def update(self, v: Any) -> dict[str, Any]:
        """Return the sampled values of the `EmlaPlant`, and the noise of the load sensor."""
        random, noise = sensors.drawn_position(v.random_load, v.sigma_load)
        return {**electrics.update(v), "random_load": random, "noise_load": noise}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return those of the `EmlaPlant`, and position, acceleration and force of the load."""
        force, x_load, load = transmission.force(v), v.x_L - v.deflection, self.load_force(v)
        shown = electrics.outputs(v)
        at_load = sensors.with_noise(v, x_load)
        return {
            **shown,
            "x_measured": where(v.at_load, at_load, shown["x_measured"]),
            "a_L": screw_acceleration(v, force),
            "P_L": load * v.v_load,
            "x_load": x_load,
            "a_load": (force - load) / v.m_load,
            "x_load_measured": sensors.quantized(x_load + v.sigma_load * v.noise_load, v.resolution_load),
            "F_T": force,
        }
