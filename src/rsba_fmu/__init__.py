"""The robust subsystem-based adaptive (RSBA) controller and its gains.

The paper is Mehdi Heydari Shahna, Mohammad Bahari and Jouni Mattila, "Robustness-Guaranteed Observer-Based
Control Strategy with Modularity for Cleantech EMLA-Driven Heavy-Duty Robotic Manipulator". Numbers in
parentheses are those of its equations as printed, Roman numbers those of its tables and sections.
"""

from .controller import RsbaController

BLOCKS = (RsbaController,)

__all__ = ["BLOCKS", "RsbaController"]
