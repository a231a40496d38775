"""Make the stepper in C for an algorithm."""

from ...stepper.library import require_stepper
from ..algorithms.algorithm import Algorithm
from .native_loop import NativeLoop
from .python_calls import list_entry_points


def make_loop(algorithm: Algorithm) -> NativeLoop:
    """Return what does the steps of an algorithm after its `setup`.

    Raises:
        RunError: The C code cannot be built on this machine.
    """
    library = require_stepper()
    return NativeLoop(algorithm, list_entry_points(algorithm), library)
