"""Cache machine code for this host's processor between processes.

numba has a cache of its own, but needs 0.4 s to load code from it, because numba must be imported and
prepared as for compiling. LLVM alone loads code that calls nothing of numba, in a tenth of that time.
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
"""Reasons why compiled code could not be cached."""

_loaded: list[llvm.ExecutionEngine] = []
"""Owners of the loaded code, which stays in memory until the process ends."""


def load(name: str, source: bytes, generate: Callable[[], str]) -> int:
    """Load a function from the cache, or compile it, and return its address.

    Args:
        name: Name of the function.
        source: Source of the function, as a key of the cache.
        generate: Return LLVM's text of the function. Called only if the cache has no code for this source,
            processor and LLVM.
    """
    path = _path(f"{name}-{_key(source)}.o")
    code = _read(path)
    if code is None:
        with defer_interrupts():  # LLVM calls Python while it compiles
            code = _compile_text(generate())
        _keep(path, code)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _loaded.append(engine)
    return engine.get_function_address(name)


def why_not_kept() -> str:
    """Return why compiled code could not be cached; empty if it was cached, or nothing was compiled."""
    return _unkept[-1] if _unkept else ""


def _path(name: str) -> Path | None:
    """Return the place of this code in the cache; None without a cache folder."""
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


def inline(text: str) -> str:
    """Return LLVM's text with all calls inlined, also that of numba's function within the C function."""
    module = llvm.parse_assembly(text.replace("noinline", "alwaysinline"))
    passes = llvm.create_pass_builder(_machine(), llvm.create_pipeline_tuning_options(speed_level=3))
    passes.getModulePassManager().run(module, passes)
    return str(module)


def _compile_text(text: str) -> bytes:
    """Compile LLVM's text to an object file."""
    module = llvm.parse_assembly(text)
    missing = [f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")]
    if missing:
        raise RuntimeError(f"the compiled code would call {', '.join(missing)}")
    return _machine().emit_object(module)


def _read(path: Path | None) -> bytes | None:
    """Return code from the cache; None if it is missing or damaged."""
    try:
        content = path.read_bytes() if path is not None else b""
    except OSError:
        return None
    size = _DIGEST().digest_size
    digest, code = content[:size], content[size:]
    return code if digest == _DIGEST(code).digest() else None


def _keep(path: Path | None, code: bytes) -> None:
    """Write the code to the cache. If that fails, later processes compile again."""
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with write_atomically(path) as stream:
            stream.write(_DIGEST(code).digest() + code)
    except OSError as error:
        _unkept.append(f"'{path.parent}' cannot be written: {error.strerror or error}")
