"""Make the stepper in C for an algorithm."""

from typing import TYPE_CHECKING

from ..algorithms.algorithm import Algorithm

if TYPE_CHECKING:  # commands that only list options do not load fmpy
    from ..instances.fmu_instance import EntryPoints
    from .native_loop import NativeLoop


def make_loop(algorithm: Algorithm) -> "NativeLoop":
    """Return what does the steps of an algorithm after its `setup`.

    Raises:
        RunError: The C code cannot be built on this machine.
    """
    from ...stepper.library import require_stepper
    from .native_loop import NativeLoop

    library = require_stepper()
    return NativeLoop(algorithm, list_entry_points(algorithm), library)


def list_entry_points(algorithm: Algorithm) -> "list[EntryPoints]":
    """Return the functions that the stepper calls, by instance: those of its FMU, or functions of Python."""
    from ..instances.python_calls import PythonCalls

    split = set(algorithm.split_steps)
    return [
        instance.entry_points() or PythonCalls().entry_points(instance, i in split)
        for i, instance in enumerate(algorithm.network.instances)
    ]
