"""The motion that leads the joints of the manipulator."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hdrm_fmu.spline import Spline, trajectory_parameters

from ..system.model import Value
from .roles import JOINTS
from .systems import STUDY


@dataclass(frozen=True)
class Motion:
    """Parameters of the block Trajectory; and how much farther out than q_S each joint begins, in m."""

    parameters: Mapping[str, Value]
    ahead: Mapping[str, float]


def motion(file: Path | None) -> Motion:
    """The motion of a trajectory file, by default that of the optimised trajectory."""
    spline = Spline(5, [0.0] * 6 + [37.7] * 6, {j: [STUDY[j].q_S] * 3 + [STUDY[j].q_E] * 3 for j in JOINTS})
    ahead = {joint: spline.coefficients[joint][0] - STUDY[joint].q_S for joint in JOINTS}
    return Motion(trajectory_parameters(spline), ahead)
