"""Whether and how steps can be compiled on this host."""

from typing import TYPE_CHECKING

from ..algorithms.algorithm import Algorithm
from ..algorithms.explicit import Explicit
from ..algorithms.strong import Strong

if TYPE_CHECKING:
    from .kernel import Kernel

COMPILED = (Explicit, Strong)
"""Kinds of algorithms whose steps can be compiled."""


def compile_kernel(algorithm: Algorithm) -> "Kernel | None":
    """The compiled loop for an algorithm; None where it or an instance cannot be compiled, or without numba.

    A host that has compiled the loop before needs no numba.
    """
    if not isinstance(algorithm, COMPILED):
        return None
    points = [instance.entry_points() for instance in algorithm.network.instances]
    known = [p for p in points if p is not None]
    if len(known) < len(points):
        return None
    try:
        from .kernel import Kernel

        return Kernel(algorithm, known)
    except (ImportError, OSError):  # which is how LLVM says that it cannot be loaded
        return None
