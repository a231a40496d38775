"""Fill fresh memory with junk: an FMU must not rely on zeros or on addresses."""

import contextlib
import ctypes
from collections.abc import Iterator
from typing import Any

from .process_state import load_c_library

BYTE = 0x40
"""The byte that fills fresh memory: it makes ordinary doubles, 32.5, so that sums reveal them."""

# how many blocks of each size are allocated first, and the size of one more: addresses shift
_BLOCKS, _BYTES = 5, 37 * 2**20 + 4096

_M_PERTURB = -6
_SIZES = range(16, 2049, 16)
_OF_EACH_SIZE = 16


@contextlib.contextmanager
def fill_memory() -> Iterator[None]:
    """Fill the memory that the C library allocates next with junk, and shift its addresses, if possible."""
    # other addresses, on which results must not depend
    shifting_block = ctypes.create_string_buffer(_BYTES)
    library = load_c_library()
    with contextlib.suppress(AttributeError):  # not all systems have these
        library.malloc.restype = ctypes.c_void_p
        _allocate_blocks(library, _BLOCKS)  # never freed: the process ends soon
        _leave_behind(library)
        library.mallopt(_M_PERTURB, BYTE ^ 0xFF)  # glibc inverts what it fills with
    yield
    del shifting_block


def _leave_behind(library: Any) -> None:
    """Allocate, fill and free blocks of many sizes: the C library reuses small ones unchanged."""
    blocks = _allocate_blocks(library, _OF_EACH_SIZE)
    _allocate_blocks(library, 1)  # never freed, so that no memory goes back to the system
    for address, size in blocks:
        ctypes.memset(address, BYTE, size)
        library.free(ctypes.c_void_p(address))


def _allocate_blocks(library: Any, count: int) -> list[tuple[int, int]]:
    """Allocate `count` blocks of each size. Return their addresses and sizes."""
    return [(library.malloc(ctypes.c_size_t(size)), size) for size in _SIZES for _ in range(count)]
