"""Build the C code of the stepper for this machine on first use, keep it in the user's cache, and load it."""

import ctypes
import hashlib
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from fmublock.platforms import TARGETS, host_platform

from ..base.errors import RunError
from ..base.files import CacheError, cache_folder, temporary_folder, write_atomically
from .layout import SIZES

_MAIN = "library.c"

_POINTER, _NUMBER = ctypes.c_void_p, ctypes.c_int64

_FUNCTIONS: dict[str, tuple[tuple[Any, ...], Any]] = {
    "stepper_run": ((_POINTER, _NUMBER, _NUMBER, _NUMBER, _POINTER), ctypes.c_int32),
    "stepper_control": ((_POINTER, _POINTER, _NUMBER, _NUMBER, _POINTER), ctypes.c_int32),
    "interrupts_catch": ((_POINTER,), None),
    "interrupts_release": ((), None),
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
        control: Tries steps under error control: addresses of a `Stepper` and a `Control`, number of trials,
            number of rows, and their address or None. Returns a `Failure`.
        catch_interrupts: Sets a flag, whose address it gets, on signals that have a handler.
        release_interrupts: Undoes this.
        reduce_rows: See `rows.py`.
        why_not_kept: Why it was not kept in the cache; empty if it was.
    """

    run: Any
    control: Any
    catch_interrupts: Any
    release_interrupts: Any
    reduce_rows: Any
    why_not_kept: str = ""


def native_sources() -> dict[str, bytes]:
    """Return the C files by name."""
    folder = files("emla_cosim.stepper").joinpath("native")
    return {f.name: f.read_bytes() for f in sorted(folder.iterdir(), key=lambda f: f.name) if f.is_file()}


@cache
def find_stepper() -> StepperLibrary | None:
    """Return the functions in C; None if they cannot be built or loaded on this machine."""
    try:
        return load_stepper()
    except StepperBuildError:
        return None


@cache
def load_stepper() -> StepperLibrary:
    """Load the functions in C; the first use on a machine builds them.

    Raises:
        StepperBuildError: They cannot be built or loaded.
    """
    sources, platform = native_sources(), host_platform()
    if platform not in TARGETS:
        raise StepperBuildError(f"there is no compiler for the platform '{platform}'.")
    name = f"stepper-{_hash(sources, platform)}{TARGETS[platform][1]}"
    path = Path(name)
    try:
        path = cache_folder() / "code" / name
        if path.is_file():
            with suppress(StepperBuildError):  # of a damaged file
                return _bind(path)
        built = _build(sources, platform)
        path.parent.mkdir(parents=True, exist_ok=True)
        with write_atomically(path) as stream:
            stream.write(built)
        return _bind(path)
    except CacheError as error:
        why = str(error)
    except OSError as error:
        why = f"'{path.parent}' cannot be written: {error.strerror or error}"
    return replace(_build_elsewhere(name, sources, platform), why_not_kept=why)


_temporary = ExitStack()
"""Owner of the folder of a library that could not be kept."""


def _build_elsewhere(name: str, sources: dict[str, bytes], platform: str) -> StepperLibrary:
    """Build the library in a temporary folder, as the cache cannot be used."""
    try:
        path = _temporary.enter_context(temporary_folder("stepper")) / name
        path.write_bytes(_build(sources, platform))
    except (OSError, RunError) as error:
        raise StepperBuildError(f"it cannot be written: {error}") from error
    return _bind(path)


def _hash(sources: dict[str, bytes], platform: str) -> str:
    """Return what distinguishes builds: a hash of the sources, and of what compiles them."""
    compiler = files("fmublock").joinpath("compiling.py").read_bytes()
    return hashlib.sha256(repr((sorted(sources.items()), compiler, platform)).encode()).hexdigest()[:32]


def _build(sources: dict[str, bytes], platform: str) -> bytes:
    from fmublock.compiling import compile_libraries  # slow to import, and rarely needed
    from fmublock.errors import BuildError

    content = {f"sources/{name}": text for name, text in sources.items()}
    try:
        (library,) = compile_libraries("stepper", [_MAIN], content, [platform]).values()
    except BuildError as error:
        raise StepperBuildError(str(error)) from error
    return library


def _bind(path: Path) -> StepperLibrary:
    try:
        library = ctypes.CDLL(str(path))  # which releases the interpreter's lock during calls
        sizes = tuple((ctypes.c_size_t * len(SIZES)).in_dll(library, "stepper_sizes"))
        functions = [getattr(library, name) for name in _FUNCTIONS]
    except (AttributeError, OSError, ValueError) as error:
        raise StepperBuildError(f"'{path}' cannot be loaded: {error}") from error
    if sizes != SIZES:
        raise StepperBuildError(f"the records in C have sizes {sizes}, not {SIZES}.")
    for function, (arguments, result) in zip(functions, _FUNCTIONS.values(), strict=True):
        function.argtypes, function.restype = arguments, result
    return StepperLibrary(*functions)
