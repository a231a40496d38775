"""Memory as a process may find it: nothing promises zeros, nor the same addresses."""

import contextlib
import ctypes
from collections.abc import Iterator
from typing import Any, NamedTuple


class Junk(NamedTuple):
    """The byte that fresh memory is full of, and how much of it is taken before anybody else takes some.

    `blocks` are those of each size, `bytes` are taken at once.
    """

    byte: int
    blocks: int
    bytes: int


FIRST, SECOND = Junk(0x3F, 0, 0), Junk(0x40, 5, 37 * 2**20 + 4096)
"""Two of them, whose bytes make ordinary numbers of 8 bytes, 4.8e-4 and 32.5, so that sums show them."""

_M_PERTURB = -6
_SIZES = range(16, 2049, 16)
_OF_EACH_SIZE = 16


@contextlib.contextmanager
def fill_memory(junk: Junk) -> Iterator[None]:
    """Fill what the C library hands out next with junk, and move it, as far as it can be asked to."""
    kept = ctypes.create_string_buffer(junk.bytes)
    library: Any = ctypes.CDLL(None)
    with contextlib.suppress(AttributeError):  # not all systems have these
        library.malloc.restype = ctypes.c_void_p
        _blocks(library, junk.blocks)  # for good: the process ends soon
        _leave_behind(library, junk.byte)
        library.mallopt(_M_PERTURB, junk.byte ^ 0xFF)  # glibc inverts what it fills with
    yield
    del kept


def _leave_behind(library: Any, byte: int) -> None:
    """Allocate blocks of many sizes, fill and free them: small ones are handed out again as they were."""
    blocks = _blocks(library, _OF_EACH_SIZE)
    _blocks(library, 1)  # stay, so that nothing is given back to the system
    for place, size in blocks:
        ctypes.memset(place, byte, size)
        library.free(ctypes.c_void_p(place))


def _blocks(library: Any, count: int) -> list[tuple[int, int]]:
    """Places and sizes of as many blocks of each size."""
    return [(library.malloc(ctypes.c_size_t(size)), size) for size in _SIZES for _ in range(count)]
