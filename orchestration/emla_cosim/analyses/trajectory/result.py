"""The result of the optimisation of a motion."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .file_writer import write_trajectory
from .motion import OptimisedMotion
from .pictures import draw_pictures

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class TrajectoryResult(OptimisedMotion):
    """The motion that costs least, and how it was found.

    Attributes:
        spline: the motion.
        assessment: its metrics.
        given: the problem as you passed it.
        problem: the problem after the reading of end speeds.
        end_speed: that reading.
        contradictions: contradictions in the problem as you passed it.
        discretisation: degree, knots, points and weight of the optimization.
        solution: how the motion was found.
        starts: number of initial guesses.
    """

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the motion to a trajectory file.

        Args:
            path: path of the file (.json).
            overwrite: replace a file that emla did not write.

        Raises:
            CommandError: the file cannot be written.
        """
        write_trajectory(self, Path(path), overwrite)

    def plot(self) -> "dict[str, Figure]":
        """Return figures of forces and speeds, positions and their derivatives, and the path, by name."""
        return draw_pictures(self)
