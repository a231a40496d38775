"""The C library that this process and its FMUs use."""

import ctypes
import sys
from typing import Any


def load_c_library() -> Any:
    """Return the functions of the C library; those that a system lacks raise AttributeError."""
    # only systems with dlopen can look a name up in all loaded libraries
    return ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)
