"""Tracking metrics of a joint, from the plant's true states at every communication point."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..arrays import Vector
from ..recorders.metrics import Figures, Metrics, Shown
from ..recorders.recorder import Outline

SETTLED_AFTER = 0.3
"""Errors and torque count from this time on in s, or from convergence if that is later."""

CONVERGED_WITHIN = 0.05
"""Convergence is reached when the position error stays within this fraction of its initial value."""

STARTS_CONVERGED = 1e-6
"""An initial position error in m below this counts as none."""


@dataclass
class JointFigures:
    """One joint's part of metrics.json.

    `convergence_time_s` is the last time at which |x_L - x_d| exceeds 5 % of its initial value.
    Errors and `torque_effort_N_m` are the largest absolute values at or after that and 0.3 s;
    `torque_peak_N_m` is over the whole run. NaN where a run ended before.
    """

    position_error_m: float = 0.0
    velocity_error_m_s: float = 0.0
    torque_effort_N_m: float = 0.0
    torque_peak_N_m: float = 0.0
    convergence_time_s: float = 0.0
    observer_position_error_m: float = 0.0
    saturated_fraction: float = 0.0


_CHANNELS = {
    "x_L": "plant.x_L",
    "v_L": "plant.v_L",
    "tau_m": "plant.tau_m",
    "x_d": "reference.x_d",
    "v_d": "reference.v_d",
    "x_hat": "observer.x_hat",
    "limited_control": "controller.saturated",
    "limited_inverter": "plant.inverter.saturated",
}
_OPTIONAL = ("x_hat", "limited_control", "limited_inverter")


_SHOWN = (
    Shown("position_error_m", "position error", 1e6, "µm"),
    Shown("velocity_error_m_s", "speed error", 1e3, "mm/s"),
    Shown("torque_effort_N_m", "torque effort", 1.0, "N m"),
    Shown("torque_peak_N_m", "torque peak", 1.0, "N m"),
    Shown("convergence_time_s", "convergence time", 1e3, "ms"),
    Shown("observer_position_error_m", "observer position error", 1e6, "µm"),
    Shown("saturated_fraction", "time at a limit", 100.0, "%"),
)


def joint_metrics(outline: Outline) -> "JointMetrics | None":
    """The metrics of all joints of a run; None where it has none."""
    metrics = JointMetrics(outline.names)
    return metrics if metrics.joints else None


class JointMetrics(Metrics):
    """Tracking metrics by joint: what stands before the first dot of a signal's name.

    Joints without position, speed, torque and reference have no metrics.
    """

    shown = _SHOWN

    def __init__(self, names: Sequence[str]) -> None:
        column = {name: i + 1 for i, name in enumerate(names)}
        self._joints: dict[str, _JointAccumulator] = {}
        for joint in dict.fromkeys(name.partition(".")[0] for name in names):
            channels = {c: column.get(f"{joint}.{path}", -1) for c, path in _CHANNELS.items()}
            if all(i >= 0 for c, i in channels.items() if c not in _OPTIONAL):
                self._joints[joint] = _JointAccumulator(channels)

    @property
    def joints(self) -> list[str]:
        """The joints that have metrics."""
        return list(self._joints)

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        for accumulator in self._joints.values():
            accumulator.add(rows)

    def memory(self) -> Any:
        """All that was computed so far, as plain numbers by joint."""
        return {joint: accumulator.memory() for joint, accumulator in self._joints.items()}

    def remember(self, memory: Any) -> None:
        """Go on from what was computed before."""
        for joint, accumulator in self._joints.items():
            accumulator.remember(memory[joint])

    def remarks(self) -> Sequence[str]:
        """Which joints have not converged."""
        late = [joint for joint, accumulator in self._joints.items() if accumulator.is_outside]
        return [f"Not converged by the end: {', '.join(late)}."] if late else []

    def figures(self) -> Figures:
        """Metrics by joint, of what was recorded so far."""
        return {joint: asdict(accumulator.metrics()) for joint, accumulator in self._joints.items()}


class _JointAccumulator:
    """Largest values since convergence: an error beyond the 5 % band starts them anew."""

    def __init__(self, channels: Mapping[str, int]) -> None:
        self._channels = channels
        self._initial_error: float | None = None
        self._start = self._last_outside = 0.0
        self._last = np.inf
        self._largest = np.full(4, np.nan)
        self._peak = 0.0
        self._rows = self._limited = 0

    def add(self, rows: Vector) -> None:
        """Take the next rows (time first)."""
        t = rows[:, 0]
        self._last = float(t[-1])
        c = {name: rows[:, i] if i >= 0 else np.full(len(rows), np.nan) for name, i in self._channels.items()}
        error = np.abs(c["x_L"] - c["x_d"])
        if self._initial_error is None:
            self._initial_error = float(error[0])
            self._start = self._last_outside = float(t[0])
        torque = np.abs(c["tau_m"])
        counted = np.stack([error, np.abs(c["v_L"] - c["v_d"]), torque, np.abs(c["x_L"] - c["x_hat"])])
        settled = t >= self._start + SETTLED_AFTER
        if self._initial_error > STARTS_CONVERGED:
            outside = np.flatnonzero(error > CONVERGED_WITHIN * self._initial_error)
            if len(outside):
                self._last_outside = float(t[outside[-1]])
                settled[: outside[-1]] = False
                self._largest[:] = np.nan
        if settled.any():
            self._largest = np.fmax(self._largest, counted[:, settled].max(axis=1))
        self._peak = max(self._peak, float(torque.max()))
        self._rows += len(rows)
        self._limited += int(((c["limited_control"] > 0) | (c["limited_inverter"] > 0)).sum())

    @property
    def is_outside(self) -> bool:
        """Whether the error is beyond the band at the end of all rows so far."""
        return self._last_outside > self._start and self._last_outside >= self._last

    def memory(self) -> list[float]:
        """All that changes, as plain numbers."""
        initial = float("nan") if self._initial_error is None else self._initial_error
        largest = [float(x) for x in self._largest]
        return [
            initial,
            self._start,
            self._last_outside,
            self._peak,
            float(self._rows),
            float(self._limited),
            *largest,
        ]

    def remember(self, memory: Sequence[float]) -> None:
        """Go on from what `memory` gave."""
        initial, self._start, self._last_outside, self._peak, rows, limited, *largest = map(float, memory)
        self._initial_error = None if initial != initial else initial
        self._rows, self._limited = int(rows), int(limited)
        self._largest[:] = largest

    def metrics(self) -> JointFigures:
        """The metrics of all rows so far."""
        position, velocity, torque, observer = (float(x) for x in self._largest)
        return JointFigures(
            position_error_m=position,
            velocity_error_m_s=velocity,
            torque_effort_N_m=torque,
            torque_peak_N_m=self._peak,
            convergence_time_s=self._last_outside - self._start,
            observer_position_error_m=observer,
            saturated_fraction=self._limited / max(self._rows, 1),
        )
