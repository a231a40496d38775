"""The result of the optimisation of a motion."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from machine_fmu.optimisation.assessment import Assessment, Course, Swing, course, find_swings
from machine_fmu.optimisation.problem import EndSpeed, MotionProblem
from machine_fmu.optimisation.solving import Solution
from machine_fmu.optimisation.transcription import Discretisation
from machine_fmu.spline import Spline

from ...base.arrays import Vector
from ...study.machines.motion import check_trajectory
from ..frame.report import ReportedResult
from .problem import describe_problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_TOOLS = ("casadi", "emla-cosim", "numpy", "scipy")
"""Packages that the motion depends on."""


@dataclass(frozen=True, repr=False)
class TrajectoryResult(ReportedResult):
    """The motion that costs least, and how it was found.

    Attributes:
        spline: the motion.
        assessment: its metrics.
        original_problem: the problem as you passed it.
        problem: the problem after the reading of end speeds.
        end_speed: that reading.
        contradictions: contradictions in the problem as you passed it.
        discretisation: degree, knots, points and weight of the optimization.
        solution: how the motion was found.
        starts: number of initial guesses.
    """

    spline: Spline
    assessment: Assessment
    original_problem: MotionProblem
    problem: MotionProblem
    end_speed: EndSpeed
    contradictions: Sequence[str]
    discretisation: Discretisation
    solution: Solution
    starts: int = 1

    def course(self, times: Vector) -> Course:
        """Return strokes, speeds, accelerations and forces at times in s."""
        return course(self.spline, self.problem, times)

    @cached_property
    def swings(self) -> Sequence[Swing]:
        """Return the neglected deflections of what swings freely."""
        return find_swings(self.spline, self.problem)

    @property
    def record(self) -> dict[str, Any]:
        """Content of a trajectory file, in SI units."""
        swings = {"swings": [asdict(swing) for swing in self.swings]} if self.swings else {}
        return {
            "format": "emla-cosim trajectory 1",
            "degree": self.spline.degree,
            "knots": list(self.spline.knots),
            "coefficients": {joint: list(values) for joint, values in self.spline.coefficients.items()},
            "units": {"knots": "s", "coefficients": "m"},
            "problem": describe_problem(self.original_problem),
            "end_speed": self.end_speed.value,
            "discretisation": asdict(self.discretisation),
            "contradictions": list(self.contradictions),
            "figures": {**asdict(self.assessment), "iterations": self.solution.iterations, **swings},
            "versions": {tool: version(tool) for tool in _TOOLS},
        }

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the motion to a trajectory file.

        Args:
            path: path of the file (.json).
            overwrite: replace a file that emla did not write.

        Raises:
            CommandError: the file cannot be written.
        """
        content = json.dumps(self.record, indent=1, allow_nan=False) + "\n"
        check_trajectory(Path(path), overwrite).write(content.encode())

    def plot(self) -> "dict[str, Figure]":
        """Return figures of forces and speeds, positions and their derivatives, and the path, by name."""
        from .report import draw_pictures

        return draw_pictures(self)
