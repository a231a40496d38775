"""Compile the steps of an algorithm, if this host can."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from ...stepper.library import require_stepper
from ..algorithms.algorithm import Algorithm
from ..algorithms.explicit import Explicit
from ..algorithms.operation_table import OperationTableAlgorithm
from ..algorithms.strong import Strong
from ..instances.fmu_instance import EntryPoints
from .forwarding import forward_typed
from .python_calls import list_entry_points

if TYPE_CHECKING:
    from .kernel import Kernel
    from .switching_loop import SwitchingLoop
    from .trial_kernel import TrialKernel

_K = TypeVar("_K")

COMPILED = (Explicit, Strong)
"""Base classes of algorithms whose steps numba can compile."""


def make_loop(algorithm: OperationTableAlgorithm) -> "SwitchingLoop":
    """Return what does fixed steps.

    Raises:
        RunError: The C code cannot be built on this machine.
    """
    from .native_loop import NativeLoop
    from .switching_loop import SwitchingLoop

    library = require_stepper()
    known = list_entry_points(algorithm)
    native = NativeLoop(algorithm, known, library)
    return SwitchingLoop(native, partial(_make_kernel, algorithm, known), _is_compilable(algorithm, known))


def compile_trials(algorithm: Algorithm) -> "TrialKernel | None":
    """Return the compiled trials of error control for an algorithm; None as for `_compile`."""
    if not isinstance(algorithm, OperationTableAlgorithm):
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
    if algorithm.network.opaque_links or any(p.calls is not None or p.events for p in known):
        return False
    return not any(p.setters is not None and p.step_end is None for p in known)


def _make_kernel(algorithm: Algorithm, known: Sequence[EntryPoints]) -> "Kernel | None":
    """Return numba's loop for an algorithm; None as for `_compile`."""

    def make(points: Sequence[EntryPoints]) -> "Kernel":
        from .kernel import Kernel

        return Kernel(algorithm, points)  # type: ignore[arg-type]

    return _compile(algorithm, known, make)


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
