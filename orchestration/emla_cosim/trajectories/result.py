"""What came out of the optimisation of a motion."""

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
    """The motion that costs least.

    `spline` is the motion, `assessment` has its figures. `given` is the problem as it was given, `problem`
    with the end speeds of the reading `end_speed`; `contradictions` are sentences on the first. `solution`
    says how it was found, of `starts` starts.
    """

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the motion to a trajectory file; CommandError where that cannot be.

        A file of something else is only replaced with `overwrite`.
        """
        write_trajectory(self, Path(path), overwrite)

    def plot(self) -> "dict[str, Figure]":
        """Pictures of forces and speeds, and of positions and accelerations, by these names."""
        return draw_pictures(self)
