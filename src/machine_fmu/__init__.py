"""Machines of bodies and actuators: kinematics and dynamics from a description.

Numbers can be floats, arrays of poses or symbols of CasADi, so that one text gives the functions here and the
blocks' FMUs.
"""

from .assembly import assemble
from .blocks import MachineLoad, MachinePlant
from .closure import Closure, find_closure, reach_pose, start_strokes
from .declarations import load_block, plant_block
from .definition import read_definition, write_definition, write_module
from .description import (
    GROUND,
    Actuator,
    Body,
    Joint,
    Link,
    Machine,
    MachineError,
    Parameter,
    Payload,
    Point,
    Strut,
)
from .dynamics import Dynamics
from .mechanism import Mechanism
from .trajectory import Trajectory, trajectory_block

BLOCKS = (Trajectory,)

__all__ = [
    "BLOCKS",
    "GROUND",
    "Actuator",
    "Body",
    "Closure",
    "Dynamics",
    "Joint",
    "Link",
    "Machine",
    "MachineError",
    "MachineLoad",
    "MachinePlant",
    "Mechanism",
    "Parameter",
    "Payload",
    "Point",
    "Strut",
    "Trajectory",
    "assemble",
    "find_closure",
    "load_block",
    "plant_block",
    "reach_pose",
    "read_definition",
    "start_strokes",
    "trajectory_block",
    "write_definition",
    "write_module",
]
