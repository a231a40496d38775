"""Compile the steps of an algorithm, if this host can."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from ...base.errors import RunError
from ...stepper.library import StepperBuildError, load_stepper
from ..algorithms.algorithm import Algorithm
from ..algorithms.explicit import Explicit
from ..algorithms.operation_table import OperationTableAlgorithm
from ..algorithms.strong import Strong
from ..instances.fmu_instance import EntryPoints
from .forwarding import forward_typed
from .python_calls import list_entry_points

if TYPE_CHECKING:
    from .native_loop import NativeLoop
    from .trial_kernel import TrialKernel

_K = TypeVar("_K")

COMPILED = (Explicit, Strong)
"""Base classes of algorithms whose steps numba can compile."""


def make_loop(algorithm: OperationTableAlgorithm) -> "NativeLoop":
    """Return what does fixed steps.

    Raises:
        RunError: The C code cannot be built on this machine.
    """
    from .native_loop import NativeLoop

    try:
        library = load_stepper()
    except StepperBuildError as error:
        raise RunError(f"the C code that steps FMUs cannot be built on this machine: {error}") from error
    return NativeLoop(algorithm, list_entry_points(algorithm), library)


def compile_trials(algorithm: Algorithm) -> "TrialKernel | None":
    """Return the compiled trials of error control for an algorithm; None as for `_compile`.

    They are None as well if a profiler measures the methods of the instances.
    """
    if not isinstance(algorithm, OperationTableAlgorithm):
        return None
    if any("do_step" in vars(x) or "begin_step" in vars(x) for x in algorithm.network.instances):
        return None
    known = list_entry_points(algorithm)

    def make(points: Sequence[EntryPoints]) -> "TrialKernel":
        from .trial_kernel import TrialKernel

        return TrialKernel(algorithm, points)  # type: ignore[arg-type]

    return _compile(algorithm, known, make)


def _is_compilable(algorithm: Algorithm, known: Sequence[EntryPoints]) -> bool:
    """Return whether numba's loops can do what an algorithm does, with these FMUs."""
    if not isinstance(algorithm, COMPILED) or not algorithm.is_plain:
        return False
    if algorithm.network.opaque_links or any(p.calls is not None for p in known):
        return False
    return not any(p.setters is not None and p.step_end is None for p in known)


def _compile(
    algorithm: Algorithm, known: Sequence[EntryPoints], make: Callable[[Sequence[EntryPoints]], _K]
) -> _K | None:
    """Return what compiled code needs for an algorithm.

    Returns None if the algorithm or an instance does not support it, or if numba is missing. A host that
    has compiled the loop before needs no numba.
    """
    if not _is_compilable(algorithm, known):
        return None
    try:
        return make([forward_typed(p) for p in known])
    except (ImportError, OSError):  # OSError: LLVM cannot be loaded
        return None
