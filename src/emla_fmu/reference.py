"""The reference motion of a joint."""

from typing import Any

from fmublock import Block, DefaultExperiment, Output, Parameter, clamp, floor, where

from .schedule import NEVER

MOVES = 8
"""Number of moves of a reference."""


class Reference(Block):
    """Quintic rest-to-rest moves between way-points with dwells, and their exact derivatives.

    Move i goes from x[i] to x[i+1], from start[i] for duration[i]; s(r) = 10 r^3 - 15 r^4 + 6 r^5.
    """

    default_experiment = DefaultExperiment(stop_time=10.0, step_size=1e-3)

    x = Parameter(0.0, shape=MOVES + 1, unit="m", name="waypoint", description="Way-point")
    start = Parameter(
        [0.0] + [NEVER] * (MOVES - 1),
        shape=MOVES,
        unit="s",
        name="move.start",
        symbol="t_i",
        description="Time at which a move begins",
    )
    duration = Parameter(
        1.0,
        shape=MOVES,
        unit="s",
        minimum=1e-6,
        name="move.duration",
        symbol="T_i",
        description="Duration of a move",
    )
    period = Parameter(
        0.0, unit="s", minimum=0.0, symbol="T_p", description="Period of repetition; 0 is none"
    )

    x_d = Output(unit="m", nominal=0.1, description="Reference position", terminal="reference")
    v_d = Output(unit="m/s", nominal=0.1, description="Reference speed", terminal="reference")
    a_d = Output(unit="m/s2", description="Reference acceleration", terminal="reference")

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the sum of all moves, each at its own progress r between 0 and 1."""
        period = where(v.period > 0.0, v.period, 1.0)
        t = where(v.period > 0.0, v.time - period * floor(v.time / period), v.time)
        x_d, v_d, a_d = v.x[0], 0.0, 0.0
        for i in range(MOVES):
            d, T, begun = v.x[i + 1] - v.x[i], v.duration[i], t > v.start[i]
            r = clamp((t - v.start[i]) / T, 0.0, 1.0)
            x_d += where(begun, d * r * r * r * (10.0 - 15.0 * r + 6.0 * r * r), 0.0)
            v_d += where(begun, d / T * 30.0 * r * r * (1.0 - r) * (1.0 - r), 0.0)
            a_d += where(begun, d / (T * T) * 60.0 * r * (1.0 - r) * (1.0 - 2.0 * r), 0.0)
        return {"x_d": x_d, "v_d": v_d, "a_d": a_d}


def rest_to_rest(x_i: float, x_f: float, v_peak: float) -> dict[str, Any]:
    """Return the parameters of one move from x_i to x_f (m) with this peak speed (m/s), then hold."""
    return {
        "x": [x_i] + [x_f] * MOVES,
        "start": [0.0] + [NEVER] * (MOVES - 1),
        "duration": [quintic_duration(x_f - x_i, v_peak)] + [1.0] * (MOVES - 1),
    }


def quintic_duration(distance: float, v_peak: float) -> float:
    """Return the duration in s of a quintic move of `distance` m with peak `v_peak` m/s: 15 d / (8 v)."""
    return 15.0 * abs(distance) / (8.0 * v_peak)
