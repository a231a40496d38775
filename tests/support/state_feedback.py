"""A cart under state feedback, whose linearization is known in closed form."""

from fmublock import Block, DefaultExperiment, Input, Output, Parameter, State

STEP = 1e-2
WIRES = ("cart.position -> gain.position", "cart.speed -> gain.speed", "gain.force -> cart.force")


class MatrixCart(Block):
    """A mass with a spring and a damper."""

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=STEP)
    stiffness = Parameter(0.0, unit="N/m")
    damping = Parameter(0.0, unit="N.s/m")
    gravity = Parameter(0.0, unit="N")
    force = Input(0.0, unit="N")
    x = State(0.1, unit="m")
    v = State(0.0, unit="m/s")
    position = Output(unit="m")
    speed = Output(unit="m/s")

    def derivatives(self, v):
        return {"x": v.v, "v": v.force - v.gravity - v.stiffness * v.x - v.damping * v.v}

    def outputs(self, v):
        return {"position": v.x, "speed": v.v}


class MatrixGain(Block):
    """State feedback, with an input that is added to its output."""

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=STEP)
    position = Input(0.0, unit="m")
    speed = Input(0.0, unit="m/s")
    feed = Input(0.0, unit="N")
    force = Output(unit="N")

    def outputs(self, v):
        return {"force": 2.0 * v.feed - 4.0 * v.position - 4.0 * v.speed}
