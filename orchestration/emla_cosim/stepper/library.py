"""Build the C code of the stepper for this machine on first use, keep it in the user's cache, and load it."""

import ctypes
import hashlib
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from fmublock.cache import find_prebuilt
from fmublock.platforms import TARGETS, host_platform, zig_target

from ..base.arrays import Vector
from ..base.errors import RunError
from ..base.extras import explain_missing
from ..base.files import CacheError, cache_folder, temporary_folder, write_atomically
from .layout import EVENT_SIZES, HALVES_SIZE, LANES_SIZES, SIZES

_CODE = "code"
"""Folder in a cache."""

_MAINS = ("library.c", "halves.c", "system.c")

_POINTER, _NUMBER, _REAL = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double

_FUNCTIONS: dict[str, tuple[tuple[Any, ...], Any]] = {
    "stepper_run": ((_POINTER, _NUMBER, _NUMBER, _NUMBER, _POINTER), ctypes.c_int32),
    "stepper_run_halves": ((_POINTER, _POINTER, _NUMBER, _NUMBER, _POINTER), ctypes.c_int32),
    "stepper_control": ((_POINTER, _POINTER, _NUMBER, _NUMBER, _POINTER), ctypes.c_int32),
    "lanes_start": ((_POINTER, _POINTER, ctypes.c_int32), _POINTER),
    "lanes_run": ((_POINTER, _NUMBER, _NUMBER, _NUMBER, _POINTER), ctypes.c_int32),
    "lanes_end": ((_POINTER,), None),
    "effort_clock": ((), ctypes.c_int64),
    "effort_cost": ((_POINTER, _NUMBER), ctypes.c_int64),
    "interrupts_catch": ((_POINTER,), None),
    "interrupts_release": ((), None),
    "events_start": ((_POINTER, _POINTER, _REAL), ctypes.c_int32),
    "events_enter": ((_POINTER, _POINTER), ctypes.c_int32),
    "events_leave": ((_POINTER, _POINTER), ctypes.c_int32),
    "events_step": ((_POINTER, _POINTER, _REAL, _REAL, ctypes.c_int32), ctypes.c_int32),
    "rows_reduce": ((_POINTER, _NUMBER, _NUMBER, _POINTER, _POINTER, _POINTER), None),
}
"""Arguments and result of each function."""


class StepperBuildError(Exception):
    """The C code cannot be built or loaded on this machine; the message says why."""


@dataclass(frozen=True)
class StepperLibrary:
    """The functions in C. Python's other threads run meanwhile.

    Attributes:
        run: Does steps: address of a `Stepper`, number of the first step, number of steps, distance of rows
            in steps, and address of the rows. Returns a `Failure`.
        run_halves: Does steps in halves: addresses of a `Stepper` and of `Halves`, number of the first step,
            number of steps, and address of a row for each. Returns a `Failure`.
        control: Tries steps under error control: addresses of a `Stepper` and a `Control`, number of trials,
            number of rows, and their address or None. Returns a `Failure`.
        start_lanes: Starts threads: address of a `Stepper`, address of a LANE per thread, and number of
            threads. Returns the lanes; None if there are too few threads.
        run_lanes: Does steps in lanes, as `run` does.
        end_lanes: Ends the threads.
        clock: Returns the time in ns that EFFORT counts.
        measure_cost: Measures calls that do nothing: address of an EFFORT, and number of calls. Returns the
            ns that all of it took.
        catch_interrupts: Sets a flag, whose address it gets, on signals that have a handler.
        release_interrupts: Undoes this.
        start_events: Starts the clocks of an instance, in initialization mode. This and the following get the
            addresses of an `Activity` and of `Events`, and return a `Problem`.
        enter_events: Enters event mode.
        leave_events: Updates the discrete states and enters step mode.
        step_events: Does a step with its events.
        reduce_rows: See the function `reduce_rows`.
        why_not_kept: Why it was not kept in the cache; empty if it was.
    """

    run: Any
    run_halves: Any
    control: Any
    start_lanes: Any
    run_lanes: Any
    end_lanes: Any
    clock: Any
    measure_cost: Any
    catch_interrupts: Any
    release_interrupts: Any
    start_events: Any
    enter_events: Any
    leave_events: Any
    step_events: Any
    reduce_rows: Any
    why_not_kept: str = ""


def read_native_sources() -> dict[str, bytes]:
    """Return the C files by name."""
    folder = files("emla_cosim.stepper").joinpath("native")
    return {f.name: f.read_bytes() for f in sorted(folder.iterdir(), key=lambda f: f.name) if f.is_file()}


def require_stepper() -> StepperLibrary:
    """Return the functions in C.

    Raises:
        RunError: They cannot be built or loaded on this machine.
    """
    try:
        return load_stepper()
    except StepperBuildError as error:
        raise RunError(f"the C code that steps FMUs cannot be built on this machine: {error}") from error


@cache
def load_stepper() -> StepperLibrary:
    """Load the functions in C; the first use on a machine builds them.

    Raises:
        StepperBuildError: They cannot be built or loaded.
    """
    sources, platform = read_native_sources(), host_platform()
    if platform not in TARGETS:
        raise StepperBuildError(f"there is no compiler for the platform '{platform}'.")
    name = _name_library(sources, platform)
    if (prebuilt := find_prebuilt(_CODE, name)) is not None:
        with suppress(StepperBuildError):  # of a machine that differs from all others of its platform
            return _bind(prebuilt)
    path = Path(name)
    try:
        path = cache_folder() / _CODE / name
        if path.is_file():
            with suppress(StepperBuildError):  # of a damaged file
                return _bind(path)
        _write_library(path, _build(sources, platform))
        return _bind(path)
    except CacheError as error:
        why = str(error)
    except OSError as error:
        why = f"'{path.parent}' cannot be written: {error.strerror or error}"
    return replace(_build_elsewhere(name, sources, platform), why_not_kept=why)


def prebuild_stepper(platform: str) -> Path:
    """Build the functions for a platform into the cache, unless they are there, and return the path.

    Raises:
        StepperBuildError: They cannot be built.
    """
    sources = read_native_sources()
    path = cache_folder() / _CODE / _name_library(sources, platform)
    if not path.is_file():
        _write_library(path, _build(sources, platform))
    return path


def _write_library(path: Path, library: bytes) -> None:
    """Write the library to a file, and create its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(path) as stream:
        stream.write(library)


def address_of_clock(library: StepperLibrary) -> int:
    """Return the address of the clock, for EFFORT records."""
    return ctypes.cast(library.clock, ctypes.c_void_p).value or 0


_temporary = ExitStack()
"""Owner of the folder of a library that could not be kept."""


def _build_elsewhere(name: str, sources: dict[str, bytes], platform: str) -> StepperLibrary:
    """Build the library in a temporary folder, as the cache cannot be used."""
    try:
        path = _temporary.enter_context(temporary_folder("stepper")) / name
        path.write_bytes(_build(sources, platform))
    except (OSError, RunError) as error:
        raise StepperBuildError(
            f"neither the cache nor a temporary folder can be written: {error}"
        ) from error
    return _bind(path)


def _name_library(sources: dict[str, bytes], platform: str) -> str:
    """Return the file name of a build, which has a hash of the sources and of what compiles them."""
    compiler = files("fmublock").joinpath("compiling.py").read_bytes()
    content = repr((sorted(sources.items()), compiler, zig_target(platform))).encode()
    return f"stepper-{hashlib.sha256(content).hexdigest()[:32]}{TARGETS[platform][1]}"


def _build(sources: dict[str, bytes], platform: str) -> bytes:
    """Return the content of the library; StepperBuildError or CommandError if it cannot be compiled."""
    from fmublock.compiling import compile_libraries  # slow to import, and rarely needed
    from fmublock.errors import BuildError

    content = {f"sources/{name}": text for name, text in sources.items()}
    try:
        (library,) = compile_libraries("stepper", _MAINS, content, [platform]).values()
    except BuildError as error:
        raise StepperBuildError(str(error)) from error
    except ImportError as error:
        raise explain_missing(error, "the C code that steps FMUs") or error from error
    return library


def _bind(path: Path) -> StepperLibrary:
    """Load a library; StepperBuildError if that fails, or if its records have other sizes."""
    try:
        library = ctypes.CDLL(str(path))  # which releases the interpreter's lock during calls
        expected = {"stepper_sizes": SIZES, "lanes_sizes": LANES_SIZES, "events_sizes": EVENT_SIZES}
        expected["halves_size"] = HALVES_SIZE
        sizes = {n: tuple((ctypes.c_size_t * len(s)).in_dll(library, n)) for n, s in expected.items()}
        functions = [getattr(library, name) for name in _FUNCTIONS]
    except (AttributeError, OSError, ValueError) as error:
        raise StepperBuildError(f"'{path}' cannot be loaded: {error}") from error
    if sizes != expected:
        raise StepperBuildError(f"the records in C have sizes {sizes}, not {expected}.")
    for function, (arguments, result) in zip(functions, _FUNCTIONS.values(), strict=True):
        function.argtypes, function.restype = arguments, result
    return StepperLibrary(*functions)


def reduce_rows(rows: Vector) -> tuple[Vector, Vector, Vector]:
    """Return minimum, maximum and sum of squares of every column.

    Args:
        rows: Contiguous rows of doubles, shape (rows, columns). A column with NaN has NaN for all three.

    Raises:
        RunError: The C code cannot be built or loaded on this machine.
    """
    count, width = rows.shape
    low, high, squares = np.full(width, np.inf), np.full(width, -np.inf), np.zeros(width)
    results = (low.ctypes.data, high.ctypes.data, squares.ctypes.data)
    require_stepper().reduce_rows(rows.ctypes.data, count, width, *results)
    # comparisons with NaN are false, so only the sum shows it
    missing = np.isnan(squares)
    low[missing] = high[missing] = np.nan
    return low, high, squares
