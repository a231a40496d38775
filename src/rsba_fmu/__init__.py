"""The robust subsystem-based adaptive (RSBA) controller, the controllers for comparison, and their gains.

The paper is Mehdi Heydari Shahna, Mohammad Bahari and Jouni Mattila, "Robustness-Guaranteed Observer-Based
Control Strategy with Modularity for Cleantech EMLA-Driven Heavy-Duty Robotic Manipulator". Numbers in
parentheses are those of its equations as printed, Roman numbers those of its tables and sections.

Examples:
    >>> from fmublock import Instance
    >>> from rsba_fmu import FocController
    >>> block = Instance(FocController())
    >>> block["k_p"]
    150.0
"""

from .anatc import AnatcController
from .cac import CacController
from .controller import RsbaController
from .foc import FocController

BLOCKS = (RsbaController, FocController, CacController, AnatcController)

__all__ = ["BLOCKS", "AnatcController", "CacController", "FocController", "RsbaController"]
