"""The sequence of a holding brake: when it closes, when the drive is off, and what its controller gets."""

from itertools import pairwise
from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    DiscreteState,
    Input,
    Output,
    Parameter,
    logical_and,
    logical_or,
    where,
)

from .schedule import NEVER

PHASES = 8
"""Number of hold phases."""

_ROUNDING = 1e-9
"""Rounding in s of a communication point at the start or end of a phase."""

_RESTING = 1e-9
"""Speed in m/s up to which a reference rests: the ends of moves are rounded."""


class HoldingBrake(Block):
    """Closes a brake in hold phases, with the drive off, between reference and controller of a joint.

    At the start of a phase, the brake gets the command to close, and holds after `engage.delay`. Then the
    drive is off. The drive is on again `release.delay` before the end of the phase, with the command to
    release, so that its torque is there when the brake opens, at the end. The reference must rest during
    the phase.

    While the drive is off, the controller gets the estimated position as its reference, with no speed and
    no acceleration, and the current that it demanded as the measured one. So its errors are zero, and its
    integral parts do not wind up. When the drive is on again, the controller takes the load from the brake.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)
    has_model_exchange = False  # the demanded current is that of the last step

    x_d = Input(unit="m", nominal=0.1, description="Reference position", terminal="reference")
    v_d = Input(unit="m/s", nominal=0.1, description="Reference speed", terminal="reference")
    a_d = Input(unit="m/s2", description="Reference acceleration", terminal="reference")
    x_hat = Input(
        unit="m", nominal=0.1, symbol=r"\hat{x}_1", description="Estimated position", terminal="estimate"
    )
    i_q = Input(unit="A", nominal=10.0, description="Measured q-axis current", terminal="drive")
    i_d = Input(unit="A", nominal=10.0, description="Measured d-axis current", terminal="drive")
    i_q_ref = Input(unit="A", nominal=10.0, description="Demanded q-axis current i_q*", terminal="drive")

    start = Parameter(
        NEVER, shape=PHASES, unit="s", name="phase.start", symbol="t_i", description="Start of a hold phase"
    )
    end = Parameter(
        NEVER,
        shape=PHASES,
        unit="s",
        name="phase.end",
        symbol="t_{e,i}",
        description="End of the phase, when the brake is open",
    )
    engage_delay = Parameter(
        0.05,
        unit="s",
        minimum=0.0,
        name="engage.delay",
        symbol="T_E",
        description="Time from the command until the brake holds",
    )
    release_delay = Parameter(
        0.1,
        unit="s",
        minimum=0.0,
        name="release.delay",
        symbol="T_R",
        description="Time from the command until the brake is open",
    )

    demanded = DiscreteState(
        0.0, unit="A", name="before.i_q_ref", symbol="i_{q,-}^*", description="Demand of the last step"
    )

    x_r = Output(unit="m", nominal=0.1, description="Position for the controller", terminal="command.x_d")
    v_r = Output(unit="m/s", nominal=0.1, description="Speed for the controller", terminal="command.v_d")
    a_r = Output(unit="m/s2", description="Acceleration for the controller", terminal="command.a_d")
    i_q_c = Output(unit="A", nominal=10.0, description="q-axis current for controller and observer")
    i_d_c = Output(unit="A", nominal=10.0, description="d-axis current for the controller")
    holds = Output(description="1 during a hold phase")
    moves = Output(description="1 while the reference moves in a hold phase, which the joint misses")
    engaged = Output(description="1 while the brake is closed", terminal="hold.engaged")
    disabled = Output(description="1 while the drive is off", terminal="hold.disabled")

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require phases in order, each longer than both delays."""
        both = v.engage_delay + v.release_delay
        phases = list(zip(v.start, v.end, strict=True))
        return {
            **{
                f"phase.end[{i}] must be later than phase.start[{i}] by more than both delays": logical_or(
                    start >= NEVER, end - start > both
                )
                for i, (start, end) in enumerate(phases, 1)
            },
            **{
                f"phase.start[{i + 1}] must not be before phase.end[{i}]": b[0] >= a[1]
                for i, (a, b) in enumerate(pairwise(phases), 1)
            },
        }

    def update(self, v: Any) -> dict[str, Any]:
        """Store the demanded current."""
        return {"demanded": v.i_q_ref}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the state of brake and drive, and what the controller gets."""
        holds = self.lasts(v, 0.0, 0.0)
        is_off = self.lasts(v, v.engage_delay, v.release_delay)
        return {
            "x_r": where(is_off, v.x_hat, v.x_d),
            "v_r": where(is_off, 0.0, v.v_d),
            "a_r": where(is_off, 0.0, v.a_d),
            "i_q_c": where(is_off, v.demanded, v.i_q),
            "i_d_c": where(is_off, 0.0, v.i_d),
            "holds": where(holds, 1.0, 0.0),
            "moves": where(logical_and(holds, abs(v.v_d) > _RESTING), 1.0, 0.0),
            "engaged": where(self.lasts(v, v.engage_delay, 0.0), 1.0, 0.0),
            "disabled": where(is_off, 1.0, 0.0),
        }

    def lasts(self, v: Any, after: Any, before: Any) -> Any:
        """Return whether the time is in a phase: from s after its start to s before its end."""
        t = v.time + _ROUNDING
        within = False
        for start, end in zip(v.start, v.end, strict=True):
            within = logical_or(within, logical_and(t >= start + after, t < end - before))
        return within
