"""Make the stepper in C for an algorithm."""

from ...base.errors import RunError
from ...stepper.library import StepperBuildError, load_stepper
from ..algorithms.operation_table import OperationTableAlgorithm
from .native_loop import NativeLoop
from .python_calls import list_entry_points


def make_loop(algorithm: OperationTableAlgorithm) -> NativeLoop:
    """Return what does the steps of an algorithm after its `setup`.

    Raises:
        RunError: The C code cannot be built on this machine.
    """
    try:
        library = load_stepper()
    except StepperBuildError as error:
        raise RunError(f"the C code that steps FMUs cannot be built on this machine: {error}") from error
    return NativeLoop(algorithm, list_entry_points(algorithm), library)
