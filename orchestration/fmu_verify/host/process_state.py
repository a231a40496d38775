"""What a process has and how it is set up, and junk in the memory of a new one."""

import contextlib
import ctypes
import gc
import locale
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil

_PROC = Path("/proc/self")
_LONGEST_WAIT = 1.0
"""Longest time in s for threads and children to end after their instance is freed."""

_MASKS = {"SigBlk": "blocked signals", "SigIgn": "ignored signals", "SigCgt": "handled signals"}
_SET_CHILD_SUBREAPER = 36
_MXCSR = {"linux": 28, "darwin": 4}
"""Offset of the register for floating-point numbers in the `fenv_t` of x86-64, by platform."""


def load_c_library() -> Any:
    """Return the functions of the C library; those that a system lacks raise AttributeError."""
    # only systems with dlopen can look a name up in all loaded libraries
    return ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)


def can_list_resources() -> bool:
    """Return whether this system lists the resources of a process."""
    return (_PROC / "fd").is_dir() and (_PROC / "task").is_dir()


def count_resources() -> dict[str, int]:
    """Return the numbers of open files, threads, child processes and temporary files."""
    return {
        "open files": sum(1 for _ in (_PROC / "fd").iterdir()),
        "threads": sum(1 for _ in (_PROC / "task").iterdir()),
        "processes": len(psutil.Process().children()),
        "temporary files": sum(1 for _ in Path(tempfile.gettempdir()).iterdir()),
    }


def adopt_orphans() -> None:
    """Become the parent of processes that an FMU leaves behind, if the system supports it."""
    with contextlib.suppress(AttributeError, OSError):
        load_c_library().prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def end_children() -> None:
    """End all processes that this one and an FMU started, and wait for their end, at most for 1 s."""
    until = time.monotonic() + _LONGEST_WAIT
    # one that is killed leaves its own children to this process
    while (children := psutil.Process().children(recursive=True)) and time.monotonic() < until:
        for child in children:
            with contextlib.suppress(psutil.Error):
                child.kill()
        psutil.wait_procs(children, timeout=0.1)


def wait_until_settled(has_settled: Callable[[], bool]) -> None:
    """Wait until a condition holds, at most for 1 s."""
    until = time.monotonic() + _LONGEST_WAIT
    while not has_settled() and time.monotonic() < until:
        time.sleep(0.01)


def read_settings() -> dict[str, str]:
    """Return the settings of this process that concern all of its parts, by name."""
    library = load_c_library()
    settings = {"the working folder": "a folder that does not exist"}
    with contextlib.suppress(OSError):
        settings["the working folder"] = str(Path.cwd())
    with contextlib.suppress(AttributeError):
        library.setlocale.restype = ctypes.c_char_p
        settings["the locale"] = (library.setlocale(locale.LC_ALL, None) or b"").decode(errors="replace")
    settings.update(_read_floating_point())
    settings.update(_read_environment(library))
    settings.update(_read_limits())
    settings.update(_read_streams())
    with contextlib.suppress(OSError):
        for line in (_PROC / "status").read_text().splitlines():
            name, _, value = line.partition(":")
            if name in _MASKS:
                settings[f"the set of {_MASKS[name]}"] = value.strip()
            elif name == "Umask":
                settings["the mask of file permissions"] = value.strip()
    return settings


def _read_environment(library: Any) -> dict[str, str]:
    """Return the environment variables of C, without those of Python's own copy."""
    with contextlib.suppress(ValueError):
        entries = ctypes.POINTER(ctypes.c_char_p).in_dll(library, "environ")
        variables, k = [], 0
        while entries and entries[k] is not None:
            variables.append((entries[k] or b"").decode(errors="replace"))
            k += 1
        return {f"the environment variable {e.partition('=')[0]}": e.partition("=")[2] for e in variables}
    return {}


def _read_limits() -> dict[str, str]:
    """Return timers, the priority, and limits of resources."""
    limits = {}
    with contextlib.suppress(ImportError, OSError, AttributeError):
        import resource
        import signal

        on = [signal.getitimer(kind)[0] > 0.0 for kind in (signal.ITIMER_REAL, signal.ITIMER_VIRTUAL)]
        limits["the timers that send signals"] = "set" if any(on) else "unset"
        limits["the priority of the process"] = str(os.getpriority(os.PRIO_PROCESS, 0))
        for name in ("NOFILE", "STACK", "DATA", "CPU"):
            limits[f"the limit RLIMIT_{name}"] = str(resource.getrlimit(getattr(resource, f"RLIMIT_{name}")))
    return limits


def _read_streams() -> dict[str, str]:
    """Return where the standard streams lead."""
    streams: dict[str, str] = {}
    for number, name in enumerate(("standard input", "standard output", "standard error")):
        streams[name] = "closed"
        with contextlib.suppress(OSError):
            state = os.fstat(number)
            streams[name] = f"file {state.st_dev}:{state.st_ino}"
    return streams


def _read_floating_point() -> dict[str, str]:
    """Return rounding, handling of tiny numbers, and exceptions that end the process."""
    for load in (lambda: ctypes.CDLL("libm.so.6"), load_c_library):
        with contextlib.suppress(OSError, AttributeError):
            library = load()
            settings = {"the rounding of floating-point numbers": str(library.fegetround())}
            if platform.machine() == "x86_64" and (start := _MXCSR.get(sys.platform)) is not None:
                state = (ctypes.c_ubyte * 64)()
                library.fegetenv(state)
                control = int.from_bytes(bytes(state[start : start + 4]), "little")
                settings["the handling of tiny floating-point numbers"] = hex(control & 0x8040)
                settings["the mask of floating-point exceptions"] = hex(control & 0x1F80)
            return settings
    return {}


def can_read_memory() -> bool:
    """Return whether this system reports how much memory a process uses."""
    return Path("/proc/self/statm").exists()


def read_memory() -> float:
    """Return the resident memory of this process in bytes, after a garbage collection."""
    gc.collect()
    # the second number is that of resident pages
    return float(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def list_writable_memory() -> list[tuple[int, int]]:
    """Return the spans of addresses that this process may write to; none if the system does not tell."""
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return []
    spans = (line.split()[0].split("-") for line in lines if "w" in line.split()[1])
    return [(int(low, 16), int(high, 16)) for low, high in spans]


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
        _fill_freed_blocks(library)
        library.mallopt(_M_PERTURB, BYTE ^ 0xFF)  # glibc inverts what it fills with
    yield
    del shifting_block


def _fill_freed_blocks(library: Any) -> None:
    """Allocate, fill and free blocks of many sizes: the C library reuses small ones unchanged."""
    blocks = _allocate_blocks(library, _OF_EACH_SIZE)
    _allocate_blocks(library, 1)  # never freed, so that no memory goes back to the system
    for address, size in blocks:
        ctypes.memset(address, BYTE, size)
        library.free(ctypes.c_void_p(address))


def _allocate_blocks(library: Any, count: int) -> list[tuple[int, int]]:
    """Allocate `count` blocks of each size. Return their addresses and sizes."""
    return [(library.malloc(ctypes.c_size_t(size)), size) for size in _SIZES for _ in range(count)]
