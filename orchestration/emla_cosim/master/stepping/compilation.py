"""Compile the steps of an algorithm, if this host can."""

from typing import TYPE_CHECKING

from ..algorithms.algorithm import Algorithm
from ..algorithms.explicit import Explicit
from ..algorithms.strong import Strong

if TYPE_CHECKING:
    from .kernel import Kernel

COMPILED = (Explicit, Strong)
"""Base classes of algorithms whose steps can be compiled."""


def compile_kernel(algorithm: Algorithm) -> "Kernel | None":
    """Return the compiled loop for an algorithm.

    Returns None if the algorithm or an instance does not support it, or if numba is missing. A host that
    has compiled the loop before needs no numba.
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
    except (ImportError, OSError):  # OSError: LLVM cannot be loaded
        return None
