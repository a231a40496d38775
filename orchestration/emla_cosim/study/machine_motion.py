"""The motion of the manipulator's joints."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hdrm_fmu.spline import Spline, TrajectoryError, default_spline, trajectory_parameters

from ..base.errors import CommandError
from ..system.model import Value
from ..trajectories.file import read_trajectory
from .roles import JOINTS
from .systems import STUDY


@dataclass(frozen=True)
class Motion:
    """Parameters of the block Trajectory, and each joint's start relative to q_S in m."""

    parameters: Mapping[str, Value]
    ahead: Mapping[str, float]
    spline: Spline

    def travel(self, joint: str, start: float, stop: float) -> tuple[float, float, float]:
        """Return lowest and highest position of a joint in m, and its largest speed in m/s.

        They are sampled at 5,000 moments from `start` to `stop` in s. Before and after the motion the joint
        rests
        at its ends.
        """
        import numpy as np

        first, last = np.clip([start, stop], self.spline.start, self.spline.end)
        times, place = np.linspace(first, last, 5000), JOINTS.index(joint)
        x, v = (self.spline.evaluated(times, order)[:, place] for order in (0, 1))
        return float(x.min()), float(x.max()), float(abs(v).max())


def load_motion(file: Path | None) -> Motion:
    """Return the motion of a trajectory file, or the optimised one. Raises CommandError."""
    if file is None:
        return _motion(default_spline())
    try:
        return _motion(read_trajectory(file))
    except TrajectoryError as error:
        raise CommandError(f"the trajectory '{file}' cannot be used: {error}") from error


def _motion(spline: Spline) -> Motion:
    parameters = trajectory_parameters(spline)
    first = spline.evaluated([min(max(0.0, spline.start), spline.end)])[0]
    ahead = {joint: float(x) - STUDY[joint].reference.q_S for joint, x in zip(JOINTS, first, strict=True)}
    return Motion(parameters, ahead, spline)
