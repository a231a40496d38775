"""Compile the steps of an algorithm, if this host can."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeVar

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

NUMBA, C, PYTHON = "numba", "c", "python"

BACKENDS = (NUMBA, C, PYTHON)
"""What does steps of one length. Default: C in one thread and numba in several, else Python."""

COMPILED = (Explicit, Strong)
"""Base classes of algorithms whose steps numba can compile."""


def make_loop(algorithm: Algorithm, backend: str = "") -> "Kernel | SwitchingLoop | None":
    """Return what does fixed steps; None for steps in Python. See `BACKENDS`."""
    known = _entry_points(algorithm) if backend != PYTHON else None
    if known is None or not isinstance(algorithm, OperationTableAlgorithm):
        return None
    from ...stepper.library import find_stepper

    library = find_stepper() if backend != NUMBA else None
    if library is None:
        return _make_kernel(algorithm, known) if backend != C else None
    from .native_loop import NativeLoop
    from .switching_loop import SwitchingLoop

    native = NativeLoop(algorithm, known, library)
    return SwitchingLoop(native, partial(_make_kernel, algorithm, known), _is_compilable(algorithm, known))


def compile_trials(algorithm: Algorithm) -> "TrialKernel | None":
    """Return the compiled trials of error control for an algorithm; None as for `_compile`."""
    known = _entry_points(algorithm)

    def make(points: Sequence[EntryPoints]) -> "TrialKernel":
        from .trial_kernel import TrialKernel

        return TrialKernel(algorithm, points)  # type: ignore[arg-type]

    return None if known is None else _compile(algorithm, known, make)


def _entry_points(algorithm: Algorithm) -> list[EntryPoints] | None:
    """Return the addresses of the FMI functions, by instance; None if code in C cannot do a step.

    Ask for them once only: those that a profiler gives later replace the earlier ones.
    """
    if not isinstance(algorithm, OperationTableAlgorithm) or algorithm.has_own_step:
        return None
    return list_entry_points(algorithm)


def _is_compilable(algorithm: Algorithm, known: Sequence[EntryPoints]) -> bool:
    """Return whether numba's loops can do what an algorithm does, with these FMUs."""
    if not isinstance(algorithm, COMPILED) or not algorithm.is_plain:
        return False
    if algorithm.network.opaque_links or any(p.calls is not None for p in known):
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
