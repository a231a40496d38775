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

if TYPE_CHECKING:
    from .kernel import Kernel
    from .native_loop import NativeLoop
    from .switching_loop import SwitchingLoop
    from .trial_kernel import TrialKernel

_K = TypeVar("_K")

NUMBA, C, PYTHON = "numba", "c", "python"

BACKENDS = (NUMBA, C, PYTHON)
"""What does steps of one length. Default: C in one thread and numba in several, else Python."""

COMPILED = (Explicit, Strong)
"""Base classes of algorithms whose steps can be compiled."""


def compile_kernel(algorithm: Algorithm) -> "Kernel | None":
    """Return the compiled loop for an algorithm; None as for `_compile`."""

    def make(known: Sequence[EntryPoints]) -> "Kernel":
        from .kernel import Kernel

        return Kernel(algorithm, known)  # type: ignore[arg-type]

    return _compile(algorithm, make)


def make_native_loop(algorithm: Algorithm) -> "NativeLoop | None":
    """Return the stepper in C for an algorithm; None if it cannot step it, or cannot be built here."""
    if not isinstance(algorithm, OperationTableAlgorithm) or algorithm.has_own_step:
        return None
    known = known_entry_points(algorithm)
    if known is None:
        return None
    from ...stepper.library import find_stepper
    from .native_loop import NativeLoop

    library = find_stepper()
    return None if library is None else NativeLoop(algorithm, known, library)


def make_loop(algorithm: Algorithm, backend: str = "") -> "Kernel | SwitchingLoop | None":
    """Return what does fixed steps; None for steps in Python. See `BACKENDS`."""
    native = make_native_loop(algorithm) if backend in ("", C) else None
    if native is None:
        return compile_kernel(algorithm) if backend in ("", NUMBA) else None
    from .switching_loop import SwitchingLoop

    return SwitchingLoop(native, partial(compile_kernel, algorithm))


def compile_trials(algorithm: Algorithm) -> "TrialKernel | None":
    """Return the compiled trials of error control for an algorithm; None as for `_compile`."""

    def make(known: Sequence[EntryPoints]) -> "TrialKernel":
        from .trial_kernel import TrialKernel

        return TrialKernel(algorithm, known)  # type: ignore[arg-type]

    return _compile(algorithm, make)


def known_entry_points(algorithm: Algorithm) -> list[EntryPoints] | None:
    """Return the addresses of the FMI functions, by instance; None if code in C cannot do a step."""
    if algorithm.network.opaque_links:
        return None
    points = [instance.entry_points() for instance in algorithm.network.instances]
    known = [p for p in points if p is not None]
    return known if len(known) == len(points) else None


def compilable_entry_points(algorithm: Algorithm) -> list[EntryPoints] | None:
    """Return the addresses that numba's loops call; None if these cannot do what the algorithm does."""
    if not isinstance(algorithm, COMPILED) or algorithm.has_own_step or not algorithm.is_plain:
        return None
    known = known_entry_points(algorithm)
    if known is None or any(p.setters is not None and p.step_end is None for p in known):
        return None
    return known


def _compile(algorithm: Algorithm, make: Callable[[Sequence[EntryPoints]], _K]) -> _K | None:
    """Return what compiled code needs for an algorithm.

    Returns None if the algorithm or an instance does not support it, or if numba is missing. A host that
    has compiled the loop before needs no numba.
    """
    known = compilable_entry_points(algorithm)
    if known is None:
        return None
    try:
        return make([forward_typed(p) for p in known])
    except (ImportError, OSError):  # OSError: LLVM cannot be loaded
        return None
