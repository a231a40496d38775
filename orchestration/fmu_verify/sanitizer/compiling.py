"""Compile the sources of an FMU, and the host for it, with sanitizers."""

import hashlib
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from ..c_sources import find_inside, find_machine_compiler, find_zig, read_build_description, run_compiler
from ..subject import Subject

FOLDER = "sanitized"
"""Folder for libraries and results in the scratch folder of a subject."""

_FLAGS = ("-g1", "-O0", "-w", "-fno-omit-frame-pointer", "-fno-common")
# Parts of UBSan that take long to compile, for accesses that AddressSanitizer sees. The last one reports
# what is common and harmless: a NULL pointer with a length of 0.
_LESS = "-fno-sanitize=null,object-size,pointer-overflow,nonnull-attribute"

_ALL = ("-fsanitize=address,undefined", _LESS)
_UNDEFINED_ONLY = ("-fsanitize=undefined", "-fno-sanitize-trap=undefined", _LESS)

# Options to warn of functions that no file has. Some compilers link those of sanitizers only to programs.
_WARN = ("-Wl,--no-undefined", "-Wl,--warn-unresolved-symbols")


@dataclass(frozen=True)
class Compiler:
    """A command that compiles, its options for sanitizers, and whether it has AddressSanitizer."""

    command: tuple[str, ...]
    flags: tuple[str, ...]
    has_address: bool


@dataclass(frozen=True)
class SourceSet:
    """Sources to compile to one library: files, include folders, and macros as options."""

    files: tuple[Path, ...]
    includes: tuple[Path, ...]
    macros: tuple[str, ...] = ()

    @property
    def is_c(self) -> bool:
        """Whether all files are C."""
        return all(path.suffix == ".c" for path in self.files)


class CompilerError(Exception):
    """A compiler failed. The message is its first error."""


def list_compilers() -> list[Compiler]:
    """Return the compilers to try: the one of the machine, then zig, which has no AddressSanitizer."""
    candidates = (
        Compiler(find_machine_compiler(), _ALL, has_address=True),
        Compiler(find_zig(), _UNDEFINED_ONLY, has_address=False),
    )
    return [compiler for compiler in candidates if compiler.command]


def find_sources(subject: Subject, kind: str) -> SourceSet | None:
    """Return the sources for a kind of an FMU, from SourceFiles or the build description; None if none."""
    folder = subject.folder / "sources"
    names = [e.get("name") for e in subject.tree.iterfind(f"{kind}/SourceFiles/File")]
    includes, macros = [folder], list[str]()
    if (configuration := _read_configuration(subject, kind)) is not None:
        names = [e.get("name") for e in configuration.iterfind("SourceFileSet/SourceFile")]
        directories = configuration.iterfind("SourceFileSet/IncludeDirectory")
        includes += [folder / str(e.get("name")) for e in directories]
        for e in configuration.iterfind("SourceFileSet/PreprocessorDefinition"):
            value = e.get("value")
            macros.append(f"-D{e.get('name')}" + (f"={value}" if value is not None else ""))
    paths = [find_inside(folder, str(name)) for name in names]
    if not paths or None in paths:
        return None
    # folders of headers: some tools list theirs in files of their own
    includes += sorted({p.parent for p in folder.rglob("*.h")} - {folder})
    return SourceSet(tuple(p for p in paths if p is not None), tuple(includes), tuple(macros))


def _read_configuration(subject: Subject, kind: str) -> Any:
    """Return the element of the build description for the model identifier of a kind, or None."""
    identifier = subject.tree.find(kind).get("modelIdentifier")
    with suppress(etree.XMLSyntaxError, OSError):
        root = read_build_description(subject)
        configurations = [] if root is None else root.findall("BuildConfiguration")
        matching = [e for e in configurations if e.get("modelIdentifier") == identifier]
        platforms = (fmpy.platform_tuple, fmpy.platform, None)
        return next((e for p in platforms for e in matching if e.get("platform") == p), None)
    return None


def compile_host(compiler: Compiler, folder: Path, plan: str, seconds: float) -> Path:
    """Compile the host with a plan into a folder. Raise CompilerError if there is no such sanitizer."""
    folder.mkdir(exist_ok=True)
    (folder / "plan.h").write_text(plan, encoding="utf-8")
    target = folder / "host"
    plain = ["-fno-sanitize=undefined"] if compiler.has_address else []  # the library brings it
    with as_file(files(__package__ or "").joinpath("host.c")) as source:
        _compile(compiler, [*plain, f"-I{folder}", str(source), "-ldl"], target, folder, seconds)
    return target


def compile_library(compiler: Compiler, subject: Subject, sources: SourceSet, seconds: float) -> Path:
    """Return the library from sources of an FMU, which one check compiles for all.

    Its name has the suffix `.so` if nothing is known to be missing in it.

    Raises:
        CompilerError: They do not compile.
    """
    folder = subject.scratch / FOLDER
    folder.mkdir(exist_ok=True)
    target = folder / f"{hashlib.sha256(repr((compiler, sources)).encode()).hexdigest()[:16]}.so"
    if target.exists():
        return target
    options = ["-shared", "-fPIC", *sources.macros, *(f"-I{path}" for path in sources.includes)]
    options += _WARN if sys.platform == "linux" else []
    part = target.with_suffix(".part")
    messages = _compile(compiler, [*options, *map(str, sources.files), "-lm"], part, folder, seconds)
    is_complete = sys.platform == "linux" and "undefined" not in messages
    return part.rename(target) if is_complete else part


def build_complete_library(subject: Subject, sources: SourceSet, seconds: float) -> Path | None:
    """Return the library from sources of an FMU, with sanitizers; None if something is missing or fails."""
    compiler = next(iter(list_compilers()), None)
    if compiler is None or not compiler.has_address:
        return None
    with suppress(CompilerError):
        library = compile_library(compiler, subject, sources, seconds)
        return library if library.suffix == ".so" else None
    return None


def _compile(compiler: Compiler, arguments: Sequence[str], target: Path, folder: Path, seconds: float) -> str:
    """Compile, and return what the compiler said."""
    with as_file(files("fmpy") / "c-code") as headers:
        command = [*compiler.command, *_FLAGS, *compiler.flags, *arguments, f"-I{headers}", "-o", str(target)]
        try:
            process = run_compiler(command, folder, seconds)
        except subprocess.TimeoutExpired:
            raise CompilerError(f"the compiler takes more than {seconds:g} s") from None
        except OSError as error:
            raise CompilerError(str(error.strerror)) from error
    if process.returncode != 0:
        lines = process.stderr.strip().splitlines() or ["the compiler failed"]
        errors = [line for line in lines if "error" in line or "cannot find" in line]
        raise CompilerError([*errors, lines[-1]][0].strip().rstrip("."))
    return process.stderr
