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
    """The motion of least cost.

    Attributes:
        spline: The motion.
        assessment: Its figures.
        given: The problem of the user.
        problem: The problem that was solved, with the end speeds after the reading `end_speed`.
        contradictions: Messages on contradictions in `given`.
        solution: How the solver found it, as the best of `starts` starts.
    """

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the motion to a trajectory file.

        Args:
            path: The file.
            overwrite: Whether to replace a file that emla did not write.

        Raises:
            CommandError: The file cannot be written.
        """
        write_trajectory(self, Path(path), overwrite)

    def plot(self) -> "dict[str, Figure]":
        """Draw forces and speeds, and positions and accelerations; return the figures by name."""
        return draw_pictures(self)
