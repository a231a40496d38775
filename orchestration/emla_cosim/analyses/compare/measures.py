"""What is kept of each compared run: the figures of its joints, and their errors over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars

from ...base.patterns import matches_pattern
from ...run.result import Result
from ...study.registration import JOINTS
from ...study.roles import find_tracked_joints, list_role_patterns
from ..variants.measures import Measures

LARGEST_SPEED, FASTEST_AT = "largest_speed_m_s", "fastest_at_s"
"""Names of figures of the reference of a joint."""


@dataclass(frozen=True)
class JointMeasures(Measures):
    """The figures of joints as in metrics.json, by joint instead of by name."""

    def reading(self, names: Sequence[str]) -> Sequence[str]:
        """Return the signals to read: the patterns that the system has signals for."""
        return [name for name in names if any(matches_pattern(name, pattern) for pattern in self.read)]

    def of(self, result: Result) -> dict[str, Any]:
        """Return the figures by joint."""
        return {joint: dict(figures) for joint, figures in result.metrics.get(JOINTS, {}).items()}

    def series(self, result: Result) -> polars.DataFrame:
        """Return the position error in m over time in s, with a column for each joint."""
        ends = find_tracked_joints(result.names, result.roles)
        table = polars.DataFrame(result.read(["time", *(name for pair in ends.values() for name in pair)]))
        errors = [
            (polars.col(position) - polars.col(reference)).alias(joint)
            for joint, (position, reference) in ends.items()
        ]
        return table.select("time", *errors)


@dataclass(frozen=True)
class MotionMeasures(JointMeasures):
    """Also the largest speed of the reference in m/s, and its time in s."""

    def of(self, result: Result) -> dict[str, Any]:
        """Return the figures by joint."""
        figures = super().of(result)
        for joint, (_, reference) in find_tracked_joints(result.names, result.roles).items():
            signals = result.read(["time", reference])
            if len(signals["time"]) > 1:
                speed = np.abs(np.gradient(signals[reference], signals["time"]))
                k = int(np.argmax(speed))
                motion = {LARGEST_SPEED: float(speed[k]), FASTEST_AT: float(signals["time"][k])}
                figures[joint] = figures.get(joint, {}) | motion
        return figures


FIGURES_ALONE = JointMeasures()
"""Figures only."""

WITH_ERRORS = JointMeasures(signals=["errors"], read=list_role_patterns("x_L", "x_d"))
"""Figures, and errors over time."""

WITH_MOTION = MotionMeasures(signals=WITH_ERRORS.signals, read=WITH_ERRORS.read)
"""Figures, errors over time, and when the reference moves fastest."""
