"""A block with limits, for FMUs of both flavours."""

from typing import Any

from fmublock import Block, Input, Output, Parameter, State


class Cart(Block):
    """A cart on a track that has ends, and is not stopped by them."""

    a = Input(unit="m/s2", description="Acceleration")
    low = Parameter(-1.0, unit="m", name="track.low", description="Lower end")
    high = Parameter(2.0, unit="m", name="track.high", description="Upper end")
    v_max = Parameter(3.5, unit="m/s", description="Largest speed")
    x_start = Parameter(0.0, unit="m", name="start.x", description="Start")
    x = State(x_start, unit="m", limits=(low, high), description="Position")
    v = State(0.0, unit="m/s", description="Speed")
    v_seen = Output(unit="m/s", limits=v_max, description="Speed, as an output")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.v, "v": v.a}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"v_seen": v.v}
