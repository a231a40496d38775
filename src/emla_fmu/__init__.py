"""The electromechanical linear actuator: plant with its sensor, observer, reference and disturbance.

The paper is Mehdi Heydari Shahna, Mohammad Bahari and Jouni Mattila, "Robustness-Guaranteed Observer-Based
Control Strategy with Modularity for Cleantech EMLA-Driven Heavy-Duty Robotic Manipulator". Numbers in
parentheses are those of its equations as printed, Roman numbers those of its tables and sections.

Examples:
    >>> from fmublock import Instance
    >>> from emla_fmu import EmlaPlant
    >>> block = Instance(EmlaPlant())
    >>> block["motor.R_s"]
    0.14
"""

from .axis import EmlaAxis, EmlaCompliantAxis
from .compliant_plant import EmlaCompliantPlant
from .disturbance import Disturbance
from .holding_brake import HoldingBrake
from .load_observer import LoadObserver
from .motor import EmlaMotor
from .observer import EmlaObserver
from .plant import EmlaPlant
from .reference import Reference
from .screw_command import ScrewCommand
from .shared_supply import SharedSupply
from .signal_fault import SignalFault

BLOCKS = (
    EmlaPlant,
    EmlaCompliantPlant,
    EmlaAxis,
    EmlaCompliantAxis,
    EmlaMotor,
    EmlaObserver,
    LoadObserver,
    Reference,
    ScrewCommand,
    HoldingBrake,
    Disturbance,
    SharedSupply,
    SignalFault,
)

__all__ = [
    "BLOCKS",
    "Disturbance",
    "EmlaAxis",
    "EmlaCompliantAxis",
    "EmlaCompliantPlant",
    "EmlaMotor",
    "EmlaObserver",
    "EmlaPlant",
    "HoldingBrake",
    "LoadObserver",
    "Reference",
    "ScrewCommand",
    "SharedSupply",
    "SignalFault",
]
