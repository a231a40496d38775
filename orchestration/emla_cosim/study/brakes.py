"""Figures of holding brakes: losses in hold phases, slip, and the error with which a brake opens."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..base.arrays import Vector, read_stored_array
from ..recorders.metrics import Figures, MetricDisplay, Metrics
from ..recorders.recorder import RunLayout
from .criteria import format_length

BRAKES = "brakes"
"""Key of the figures in metrics.json."""

_SIGNALS = (
    *("brake.holds", "brake.moves", "brake.x_r"),
    *("plant.x_L", "plant.i_q", "plant.i_d", "plant.brake.slip"),
)
_MIN_SLIP = 1e-6
"""Slip in m from which on there is a message."""


@dataclass
class BrakeFigures:
    """One brake's part of metrics.json; docs/metrics.md defines each figure."""

    hold_time_s: float
    hold_copper_loss_J: float
    brake_slip_m: float
    release_error_m: float


def create_brake_metrics(layout: RunLayout) -> "BrakeMetrics | None":
    """Return the metrics of all holding brakes of a run; None without any."""
    column = {name: i + 1 for i, name in enumerate(layout.names)}
    names = [name.removesuffix(_SIGNALS[0]) for name in column if name.endswith(f".{_SIGNALS[0]}")]
    signals = {name: [f"{name}{signal}" for signal in _SIGNALS] for name in names}
    joints = {
        name.rstrip("."): [column[signal] for signal in joint_signals]
        for name, joint_signals in signals.items()
        if column.keys() >= set(joint_signals)
    }
    if not joints:
        return None
    torques, resistances = (
        [layout.parameters.get(f"{joint}.plant.{name}", np.nan) for joint in joints]
        for name in ("brake.torque", "motor.R_s")
    )
    return BrakeMetrics(list(joints), list(joints.values()), torques, resistances)


class BrakeMetrics(Metrics):
    """Figures by joint, from every communication point."""

    displays = (
        MetricDisplay("brake_slip_m", "slip of the brake", 1e6, "µm", "m"),
        MetricDisplay("release_error_m", "position error as the brake opens", 1e6, "µm", "m"),
        MetricDisplay("hold_copper_loss_J", "copper loss in hold phases", 1.0, "J"),
    )

    def __init__(
        self,
        joints: Sequence[str],
        columns: Sequence[Sequence[int]],
        torques: Sequence[float],
        resistances: Sequence[float],
    ) -> None:
        """Take joints, columns of their signals, torques of the brakes in N m, and resistances in Ohm."""
        self._joints, self._columns = joints, np.array(columns).T
        self._torques, self._resistances = torques, np.array(resistances)
        size = len(joints)
        self._last_time = np.nan
        self._held = np.zeros(size)
        self._hold_time, self._loss, self._slip, self._error = np.zeros((4, size))
        self._error[:] = np.nan
        self._moved_at = np.full(size, np.nan)

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        time = rows[:, 0]
        steps = np.diff(time, prepend=time[0] if np.isnan(self._last_time) else self._last_time)
        holds, moves, x_r, x_L, i_q, i_d, slip = (rows[:, columns] for columns in self._columns)
        was_holding = np.vstack([self._held, holds[:-1]])  # whether the phase lasted during the step to a row
        power = 1.5 * self._resistances * (i_q**2 + i_d**2)
        self._hold_time = self._hold_time + steps @ was_holding
        self._loss = self._loss + steps @ (was_holding * power)
        opens = (was_holding > 0.0) & (holds == 0.0)
        errors = np.where(opens, np.abs(x_r - x_L), np.nan)
        self._error = np.fmax(self._error, np.fmax.reduce(errors))
        times_of_motion = np.where(moves > 0.0, time[:, np.newaxis], np.nan)
        self._moved_at = np.fmin(self._moved_at, np.fmin.reduce(times_of_motion))
        self._slip, self._held, self._last_time = slip[-1], holds[-1], float(time[-1])

    def remarks(self) -> Sequence[str]:
        """Return which brakes slipped, and which held although the reference moved."""
        messages = list[str]()
        for i, joint in enumerate(self._joints):
            if self._slip[i] > _MIN_SLIP:
                messages.append(
                    f"{joint}: its brake slipped by {format_length(float(self._slip[i]))}; its torque of "
                    f"{self._torques[i]:.4g} N m is too small for what acts on it. Choose a larger brake."
                )
            if not np.isnan(self._moved_at[i]):
                messages.append(
                    f"{joint}: its reference moves while the brake holds, first at t = "
                    f"{self._moved_at[i]:.6g} s; the joint misses that motion. Hold only while it rests."
                )
        return messages

    def figures(self) -> Figures:
        """Return the figures by joint."""
        columns = (self._hold_time, self._loss, self._slip, self._error)
        values = zip(*(column.tolist() for column in columns), strict=True)
        return {joint: asdict(BrakeFigures(*row)) for joint, row in zip(self._joints, values, strict=True)}

    def state_dict(self) -> Any:
        """Return the state as plain data."""
        return {name: np.asarray(getattr(self, name)).tolist() for name in _STATE}

    def load_state_dict(self, state: Any) -> None:
        """Continue from `state`; raise KeyError or ValueError if it belongs to another run."""
        for name in _STATE:
            value = read_stored_array(state[name], np.shape(getattr(self, name)))
            setattr(self, name, value if value.ndim else float(value))


_STATE = ("_last_time", "_held", "_hold_time", "_loss", "_slip", "_error", "_moved_at")
