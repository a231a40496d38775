"""Whether and how steps can be compiled on this host."""

from typing import TYPE_CHECKING

from ..algorithms.algorithm import Algorithm
from ..algorithms.explicit import Explicit

if TYPE_CHECKING:
    from .kernel import Kernel


def compile_kernel(algorithm: Algorithm) -> "Kernel | None":
    """The compiled loop for an algorithm; None where it or a slave cannot be compiled, or without numba.

    A host that has compiled the loop before needs no numba.
    """
    if not isinstance(algorithm, Explicit):
        return None
    points = [slave.entry_points() for slave in algorithm.network.slaves]
    known = [p for p in points if p is not None]
    if len(known) < len(points):
        return None
    try:
        from .kernel import Kernel

        return Kernel(algorithm, known)
    except (ImportError, OSError):  # the latter where LLVM does not fit into memory
        return None
