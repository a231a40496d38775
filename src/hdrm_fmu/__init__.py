"""The paper's manipulator of lift, tilt and telescope, moved by three EMLAs.

Closed-chain kinematics, inverse and forward dynamics are functions. The paper is the one that
`emla_fmu` names. Numbers in parentheses are those of its equations as printed.
"""

from .parameters import HDRM, HdrmParameters

__all__ = [
    "HDRM",
    "HdrmParameters",
]
