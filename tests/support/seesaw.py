"""A block with a condition that concerns several of its values, and limits by element."""

from typing import Any

from fmublock import Block, Output, Parameter, State

DEMAND = 'the ends "touch": track.high[1] must be above track.low[1] by 100 % of track.gap'


class Seesaw(Block):
    """Two points on tracks of their own."""

    low = Parameter((-1.0, -2.0), shape=2, name="track.low", description="Lower ends")
    high = Parameter((1.0, 2.0), shape=2, name="track.high", description="Upper ends")
    gap = Parameter(0.5, name="track.gap", description="Least distance of the ends")
    x_start = Parameter((0.0, 0.0), shape=2, name="start.x", description="Start")
    x = State(x_start, shape=2, limits=(low, high), description="Positions")
    mass = State(1.0, minimum=0.0, description="Mass, which has a range")

    def conditions(self, v: Any) -> dict[str, Any]:
        return {
            DEMAND: v.high[0] - v.low[0] > v.gap,
            "start.x[1] must not be above start.x[2]": v.x[0] <= v.x[1],
        }

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": [0.0, 0.0], "mass": 0.0}


ODD = 'die Länge \U0001f600 of "k" ??= 1'


class Odd(Block):
    """Its condition has a text with all that C treats in a special way."""

    k = Parameter(1.0)
    y = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": v.k}

    def conditions(self, v: Any) -> dict[str, Any]:
        return {ODD: v.k > 0.0}
