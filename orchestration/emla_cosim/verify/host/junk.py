"""Memory as a process may find it: nothing promises zeros, nor the same addresses."""

import contextlib
import ctypes
from collections.abc import Iterator
from typing import Any, NamedTuple


class Junk(NamedTuple):
    """The byte that fresh memory is full of, and how many bytes are taken before anybody else takes some."""

    byte: int
    taken: int


FIRST, SECOND = Junk(0x3F, 0), Junk(0x40, 37 * 2**20 + 4096)
"""Two of them, whose bytes make ordinary numbers of 8 bytes, 4.8e-4 and 32.5, so that sums show them."""

_M_PERTURB = -6
_SIZES = range(16, 2049, 16)
_OF_EACH_SIZE = 16


@contextlib.contextmanager
def littered(junk: Junk) -> Iterator[None]:
    """Fill what the C library hands out next with junk, as far as it can be asked to."""
    kept = [ctypes.create_string_buffer(size) for size in (junk.taken, junk.taken // 1000)]
    library: Any = ctypes.CDLL(None)
    with contextlib.suppress(AttributeError):  # not all systems have these
        _leave_behind(library, junk.byte)
        library.mallopt(_M_PERTURB, junk.byte ^ 0xFF)  # glibc inverts what it fills with
    yield
    kept.clear()


def _leave_behind(library: Any, byte: int) -> None:
    """Allocate blocks of many sizes, fill and free them: small ones are handed out again as they were."""
    library.malloc.restype = ctypes.c_void_p
    blocks = [(library.malloc(ctypes.c_size_t(size)), size) for size in _SIZES for _ in range(_OF_EACH_SIZE)]
    library.malloc(ctypes.c_size_t(64))  # stays, so that nothing is given back to the system
    for place, size in blocks:
        ctypes.memset(place, byte, size)
        library.free(ctypes.c_void_p(place))
