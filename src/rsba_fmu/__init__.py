"""The robust subsystem-based adaptive (RSBA) controller and its gains."""

from .controller import RsbaController

BLOCKS = (RsbaController,)

__all__ = ["BLOCKS", "RsbaController"]
