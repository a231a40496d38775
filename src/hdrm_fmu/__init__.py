"""The paper's manipulator of lift, tilt and telescope, moved by three EMLAs.

Closed-chain kinematics, inverse and forward dynamics are functions and blocks. The paper is the one that
`emla_fmu` names. Numbers in parentheses are those of its equations as printed.

Examples:
    >>> from fmublock import Instance
    >>> from hdrm_fmu import HdrmManipulator
    >>> block = Instance(HdrmManipulator())
    >>> block["x_L"]
    [0.244, 0.389, 0.499]
"""

from .manipulator import HdrmManipulator
from .parameters import HDRM, HdrmParameters
from .plant import HdrmPlant

BLOCKS = (HdrmManipulator, HdrmPlant)

__all__ = [
    "BLOCKS",
    "HDRM",
    "HdrmManipulator",
    "HdrmParameters",
    "HdrmPlant",
]
