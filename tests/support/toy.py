"""A block with one of everything, for tests of the block machinery."""

from enum import IntEnum
from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    DiscreteState,
    Input,
    Output,
    Parameter,
    State,
    cos,
    where,
)
from fmublock.noise import lehmer, uniform


class Shape(IntEnum):
    LINEAR = 1
    CUBIC = 2


class Toy(Block):
    """An oscillator with a spring of two shapes, and noise."""

    default_experiment = DefaultExperiment(stop_time=2.0, step_size=1e-2)

    force = Input(0.5, unit="N", description="Force on the mass")
    mass = Parameter(2.0, unit="kg", minimum=0.1, maximum=10.0, name="body.mass")
    gains = Parameter([3.0, 0.25], shape=2, unit="N/m", minimum=0.0, name="spring.k")
    shape = Parameter(Shape.LINEAR)
    damped = Parameter(True)
    count = Parameter(3, minimum=1, maximum=9)
    seed = Parameter(7, minimum=1, maximum=2147483646)
    x_0 = Parameter(0.125, unit="m")

    x = State(x_0, unit="m")
    v = State([0.5, -0.5], shape=2, unit="m/s")
    random = DiscreteState(seed)
    step_count = DiscreteState(0.0)

    power = Output(unit="W")
    inverse = Output(unit="1/m", description="1 / (1 m - x), infinite where x reaches 1 m")

    def derivatives(self, v: Any) -> dict[str, Any]:
        spring = where(v.shape == Shape.CUBIC, v.gains[1] * v.x * v.x * v.x, v.gains[0] * v.x)
        damping = v.damped * 0.1 * v.v[0]
        return {
            "x": v.v[0],
            "v": [(v.force - spring - damping) / v.mass, cos(v.time) - v.v[1] / 3.0],
        }

    def update(self, v: Any) -> dict[str, Any]:
        return {"random": lehmer(v.random), "step_count": v.step_count + 1.0}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"power": v.force * v.v[0] + uniform(v.random) * v.count, "inverse": 1.0 / (1.0 - v.x)}
