"""What is kept of each run that is compared: all figures of its joints, and how their errors go over time."""

from dataclasses import dataclass
from typing import Any

import polars

from ..results.result import Result
from ..study.registration import JOINTS
from ..sweep.measures import Measures

POSITION, REFERENCE = "plant.x_L", "reference.x_d"


@dataclass(frozen=True)
class JointMeasures(Measures):
    """The figures of joints as metrics.json has them, by joint, instead of numbers by name."""

    def of(self, result: Result) -> dict[str, Any]:
        """Figures by joint."""
        return {joint: dict(figures) for joint, figures in result.metrics.get(JOINTS, {}).items()}

    def series(self, result: Result) -> polars.DataFrame:
        """The position error of each joint in m over time in s, in columns of their names."""
        joints = list(result.metrics.get(JOINTS, {}))
        table = polars.DataFrame(
            result.read(["time", *(f"{joint}.{end}" for joint in joints for end in (POSITION, REFERENCE))])
        )
        errors = [
            (polars.col(f"{joint}.{POSITION}") - polars.col(f"{joint}.{REFERENCE}")).alias(joint)
            for joint in joints
        ]
        return table.select("time", *errors)


FIGURES_ALONE = JointMeasures()
"""Without anything over time."""

WITH_ERRORS = JointMeasures(signals=["errors"], read=[f"*.{POSITION}", f"*.{REFERENCE}"])
"""With the errors over time."""
