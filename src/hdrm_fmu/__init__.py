"""The paper's manipulator of lift, tilt and telescope, moved by three EMLAs.

Closed-chain kinematics, inverse and forward dynamics, and the motion along a B-spline are functions and
blocks. The paper is the one that `emla_fmu` names. Numbers in parentheses are those of its equations as
printed.
"""

from .manipulator import HdrmManipulator
from .parameters import HDRM, HdrmParameters
from .plant import HdrmPlant
from .trajectory import Trajectory

BLOCKS = (HdrmManipulator, HdrmPlant, Trajectory)

__all__ = [
    "BLOCKS",
    "HDRM",
    "HdrmManipulator",
    "HdrmParameters",
    "HdrmPlant",
    "Trajectory",
]
