"""What came out of the optimisation of a motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hdrm_fmu.optimisation.assessment import Assessment, Course, course
from hdrm_fmu.optimisation.problem import EndSpeed, MotionProblem
from hdrm_fmu.optimisation.solving import Solution
from hdrm_fmu.optimisation.transcription import Discretisation
from hdrm_fmu.spline import Spline

from ..base.arrays import Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class TrajectoryResult:
    """The motion that costs least.

    `spline` is the motion, `assessment` has its figures. `given` is the problem as it was given, `problem`
    with the end speeds of the reading `end_speed`; `contradictions` are sentences on the first. `solution`
    says how it was found, of `starts` starts.
    """

    spline: Spline
    assessment: Assessment
    given: MotionProblem
    problem: MotionProblem
    end_speed: EndSpeed
    contradictions: Sequence[str]
    discretisation: Discretisation
    solution: Solution
    starts: int = 1

    def course(self, times: Vector) -> Course:
        """Strokes, speeds, accelerations and forces at times in s."""
        return course(self.spline, self.problem, times)

    def save(self, path: str | Path) -> None:
        """Write the motion to a trajectory file; CommandError where that cannot be."""
        from .file import write_trajectory

        write_trajectory(self, Path(path))

    def plot(self) -> "dict[str, Figure]":
        """Pictures of forces and speeds, and of positions and accelerations, by these names."""
        from .pictures import drawn

        return drawn(self)
