"""An optimised motion, with its problem and the settings of the solver."""

from collections.abc import Sequence
from dataclasses import dataclass

from hdrm_fmu.optimisation.assessment import Assessment, Course, course
from hdrm_fmu.optimisation.problem import EndSpeed, MotionProblem
from hdrm_fmu.optimisation.solving import Solution
from hdrm_fmu.optimisation.transcription import Discretisation
from hdrm_fmu.spline import Spline

from ...base.arrays import Vector


@dataclass(frozen=True)
class OptimisedMotion:
    """The motion of least cost; `TrajectoryResult` explains the fields."""

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
        """Return strokes, speeds, accelerations and forces at times in s."""
        return course(self.spline, self.problem, times)
