"""Imports that take less time than usual."""

import contextlib
import gc
import os
from collections.abc import Iterator

_BLAS_THREADS = "OPENBLAS_NUM_THREADS"


@contextlib.contextmanager
def quick_imports() -> Iterator[None]:
    """Import without searching for garbage, and without threads for the linear algebra of NumPy.

    Modules stay, so there is no garbage. Such a thread takes up to 0.1 s of CPU time when it starts, and the
    matrices here are too small for it. The environment is restored: FMUs may have their own linear algebra.
    """
    before = os.environ.get(_BLAS_THREADS)
    os.environ.setdefault(_BLAS_THREADS, "1")
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
        if before is None:
            os.environ.pop(_BLAS_THREADS, None)
