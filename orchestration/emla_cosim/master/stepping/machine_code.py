"""Machine code of this host's processor, kept from one process to the next.

numba keeps machine code itself, but needs 0.4 s to load it again, because it has to be imported and set
up as if it were to compile. Code that calls nothing of numba is loaded by LLVM alone, in a tenth of that.
"""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import llvmlite
import llvmlite.binding as llvm

from ...base.files import CacheError, cache_folder, write_atomically
from ...sandbox.interruption import defer_interrupts

_DIGEST = hashlib.sha256

_unkept: list[str] = []
"""Why code that was compiled could not be kept."""

_loaded: list[llvm.ExecutionEngine] = []
"""Owners of the code that is in memory; it stays there until the process ends."""


def load(name: str, source: bytes, generate: Callable[[], str]) -> int:
    """The address of a function in memory, compiled or taken from an earlier process.

    `generate` gives LLVM's text of the function `name`, compiled from `source`; it is called only where
    the code for this source, processor and LLVM is not known yet.
    """
    path = _path(f"{name}-{_key(source)}.o")
    code = _read(path)
    if code is None:
        with defer_interrupts():  # LLVM calls Python as it compiles
            code = _compile_text(generate())
        _keep(path, code)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _loaded.append(engine)
    return engine.get_function_address(name)


def why_not_kept() -> str:
    """Why code had to be compiled that could not be kept for later processes; empty if nothing had to."""
    return _unkept[-1] if _unkept else ""


def _path(name: str) -> Path | None:
    """Where code of this name is kept; None where nothing can be."""
    try:
        return cache_folder() / "code" / name
    except CacheError as error:
        _unkept.append(str(error))
        return None


def _key(source: bytes) -> str:
    host = f"{llvmlite.__version__} {llvm.get_process_triple()} {llvm.get_host_cpu_name()} {_features()}"
    return _DIGEST(host.encode() + b"\n" + source).hexdigest()[:32]


@cache
def _features() -> str:
    return llvm.get_host_cpu_features().flatten()


@cache
def _machine() -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=_features(), opt=3, jit=True)


def _compile_text(text: str) -> bytes:
    """Machine code in the form of an object file."""
    module = llvm.parse_assembly(text)
    missing = [f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")]
    if missing:
        raise RuntimeError(f"the compiled code would call {', '.join(missing)}")
    return _machine().emit_object(module)


def _read(path: Path | None) -> bytes | None:
    """What was kept; None where there is nothing, or something else than was written."""
    try:
        content = path.read_bytes() if path is not None else b""
    except OSError:
        return None
    size = _DIGEST().digest_size
    digest, code = content[:size], content[size:]
    return code if digest == _DIGEST(code).digest() else None


def _keep(path: Path | None, code: bytes) -> None:
    """Write the code for later processes, in one go; without a place for it, they will compile again."""
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with write_atomically(path) as stream:
            stream.write(_DIGEST(code).digest() + code)
    except OSError as error:
        _unkept.append(f"'{path.parent}' cannot be written: {error.strerror or error}")
