"""Compile the steps of an algorithm, if this host can."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from ..algorithms.algorithm import Algorithm
from ..algorithms.explicit import Explicit
from ..algorithms.strong import Strong
from ..instances.fmu_instance import EntryPoints
from .forwarding import forward_typed

if TYPE_CHECKING:
    from .kernel import Kernel
    from .trial_kernel import TrialKernel

_K = TypeVar("_K")

COMPILED = (Explicit, Strong)
"""Base classes of algorithms whose steps can be compiled."""


def compile_kernel(algorithm: Algorithm) -> "Kernel | None":
    """Return the compiled loop for an algorithm; None as for `_compile`."""

    def make(known: Sequence[EntryPoints]) -> "Kernel":
        from .kernel import Kernel

        return Kernel(algorithm, known)  # type: ignore[arg-type]

    return _compile(algorithm, make)


def compile_trials(algorithm: Algorithm) -> "TrialKernel | None":
    """Return the compiled trials of error control for an algorithm; None as for `_compile`."""

    def make(known: Sequence[EntryPoints]) -> "TrialKernel":
        from .trial_kernel import TrialKernel

        return TrialKernel(algorithm, known)  # type: ignore[arg-type]

    return _compile(algorithm, make)


def _compile(algorithm: Algorithm, make: Callable[[Sequence[EntryPoints]], _K]) -> _K | None:
    """Return what compiled code needs for an algorithm.

    Returns None if the algorithm or an instance does not support it, or if numba is missing. A host that
    has compiled the loop before needs no numba.
    """
    if not isinstance(algorithm, COMPILED) or algorithm.network.opaque_links:
        return None
    points = [instance.entry_points() for instance in algorithm.network.instances]
    known = [p for p in points if p is not None]
    if len(known) < len(points):
        return None
    try:
        return make([forward_typed(p) for p in known])
    except (ImportError, OSError):  # OSError: LLVM cannot be loaded
        return None
