"""The heavy-duty robotic manipulator of the paper: its motion."""

from .spline import Spline, TrajectoryError, trajectory_parameters
from .trajectory import Trajectory

BLOCKS = (Trajectory,)

__all__ = ["BLOCKS", "Spline", "Trajectory", "TrajectoryError", "trajectory_parameters"]
