"""Fill fresh memory with junk: an FMU must not rely on zeros or on addresses."""

import contextlib
import ctypes
from collections.abc import Iterator
from typing import Any, NamedTuple

from .process_state import load_c_library


class Junk(NamedTuple):
    """The byte that fills fresh memory, and how much memory to allocate first.

    `blocks` is the number of blocks of each size, `bytes` the size of one more.
    """

    byte: int
    blocks: int
    bytes: int


FIRST, SECOND = Junk(0x3F, 0, 0), Junk(0x40, 5, 37 * 2**20 + 4096)
"""Their bytes make ordinary doubles, 4.8e-4 and 32.5, so that sums reveal them."""

_M_PERTURB = -6
_SIZES = range(16, 2049, 16)
_OF_EACH_SIZE = 16


@contextlib.contextmanager
def fill_memory(junk: Junk) -> Iterator[None]:
    """Fill the memory that the C library allocates next with junk, and shift its addresses, if possible."""
    kept = ctypes.create_string_buffer(junk.bytes)
    library = load_c_library()
    with contextlib.suppress(AttributeError):  # not all systems have these
        library.malloc.restype = ctypes.c_void_p
        _blocks(library, junk.blocks)  # never freed: the process ends soon
        _leave_behind(library, junk.byte)
        library.mallopt(_M_PERTURB, junk.byte ^ 0xFF)  # glibc inverts what it fills with
    yield
    del kept


def _leave_behind(library: Any, byte: int) -> None:
    """Allocate, fill and free blocks of many sizes: the C library reuses small ones unchanged."""
    blocks = _blocks(library, _OF_EACH_SIZE)
    _blocks(library, 1)  # never freed, so that no memory goes back to the system
    for place, size in blocks:
        ctypes.memset(place, byte, size)
        library.free(ctypes.c_void_p(place))


def _blocks(library: Any, count: int) -> list[tuple[int, int]]:
    """Allocate `count` blocks of each size. Return their addresses and sizes."""
    return [(library.malloc(ctypes.c_size_t(size)), size) for size in _SIZES for _ in range(count)]
