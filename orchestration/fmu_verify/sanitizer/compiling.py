"""Compile the sources of an FMU and its host with sanitizers; the plan for the host."""

import hashlib
import math
import subprocess
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ModelVariable
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.fmu.elements import PERIODIC, ElementVariable, InputClock
from emla_cosim.fmu.fmi_3_calls import NUMBER_TYPES
from emla_cosim.fmu.instance import kind_of

from ..c_sources import find_inside, find_machine_compiler, find_zig, read_build_description, run_compiler
from ..host.experiment import read_span
from ..host.other_values import list_settable, read_start
from ..subject import Subject
from ..subprocess_run import is_single_instance

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


_STEPS = 20
_TYPES = {2: ("Real", "Integer", "Boolean", "String"), 3: (*NUMBER_TYPES, "Boolean", "String")}
"""Types in the names of functions, by version of FMI."""

# step of Model Exchange relative to the communication step: the host integrates by Euler's rule
_PART_OF_STEP = 0.01


def format_plan(subject: Subject, kind: str) -> str:
    """Return the text of plan.h for a kind of an FMU."""
    start, step, _ = read_span(subject)
    description = subject.description
    model = kind == "ModelExchange"
    version, clocks = subject.version, [] if model else _list_periodic_clocks(subject)
    real = "Float64" if version == 3 else "Real"
    continuous = [v for v in list_settable(subject, "input") if kind_of(v) == real and not v.clocks]
    outputs = [v for v in description.modelVariables if v.causality == "output" and kind_of(v) == real]
    outputs = [v for v in outputs if not v.clocks]
    defined: dict[str, Any] = {
        "VERSION": version,
        "IS_MODEL": int(model),
        "EVENTS": int(not model and subject.has_clocks and subject.has_flag("hasEventMode", kind)),
        "CLOCKS": len(clocks),
        "PREFIX": _quote(f"{subject.find_kind_element(kind).modelIdentifier}_"),
        "GUID": _quote(str(description.guid)),
        "RESOURCES": _quote((subject.folder / "resources").as_uri()),
        "START_TIME": _format_real(start),
        "STEP": _format_real(step * _PART_OF_STEP if model else step),
        "STEPS": min(_STEPS, subject.most_steps),
        "INSTANCES": 1 if is_single_instance(subject) else 2,
        "STATES": len(description.derivatives) if model else 0,
        "INDICATORS": int(description.numberOfEventIndicators or 0) if model else 0,
        "HAS_STATES": int(subject.has_capability("canGetAndSetFMUstate", kind)),
        "SERIALIZES": int(subject.has_capability("canSerializeFMUstate", kind)),
        "PROVIDES_DERIVATIVES": int(
            bool(continuous) and subject.has_capability("providesDirectionalDerivative", kind)
        ),
    }
    lines = [f'#include "fmi{version}FunctionTypes.h"']
    lines += [f"#define {name} {value}" for name, value in defined.items()]
    lines += _format_references(version, "UNKNOWN", outputs)
    lines += _format_references(version, "KNOWN", continuous)
    lines += [
        _format_array(f"fmi{version}ValueReference", "CLOCK", [clock.reference for clock in clocks]),
        _format_array("double", "CLOCK_INTERVAL", [_format_real(clock.interval or 0.0) for clock in clocks]),
        _format_array("double", "CLOCK_SHIFT", [_format_real(clock.shift) for clock in clocks]),
    ]
    variables = description.modelVariables
    settable = _list_settable_variables(subject)
    lines += _format_group(version, "START", [v for v in settable if v.causality != "input"])
    inputs = [v for v in list_settable(subject, "input") if read_start(v) is not None]
    if model:  # the others cannot be set in continuous-time mode
        inputs = [v for v in inputs if v.type == "Real" and v.variability in (None, "continuous")]
    lines += _format_group(version, "INPUT", [v for v in inputs if not v.clocks])
    lines += _format_group(version, "TICK", [v for v in inputs if v.clocks])
    lines += _format_group(version, "ALL", [v for v in variables if not v.clocks], values=False)
    lines += _format_group(version, "TICKED", [v for v in variables if v.clocks], values=False)
    return "\n".join([*lines, ""])


def list_clocks_without_ticks(subject: Subject, kind: str) -> list[str]:
    """Return the names of the Clocks that do not tick when the host in C runs a kind of the FMU."""
    moving = [] if kind == "ModelExchange" else _list_periodic_clocks(subject)
    return [clock.name for clock in subject.input_clocks if clock not in moving]


def _list_periodic_clocks(subject: Subject) -> list[InputClock]:
    """Return the Clocks whose ticks follow from the model description."""
    return [clock for clock in subject.input_clocks if clock.kind in PERIODIC and clock.interval]


def _list_settable_variables(subject: Subject) -> list[ModelVariable]:
    """Return the variables that can be set before initialization, without aliases."""
    variables_by_reference: dict[tuple[str, int], ModelVariable] = {}
    for v in subject.description.modelVariables:
        allowed = v.variability != "constant" and v.initial in ("exact", "approx")
        if allowed and v.causality != "independent" and read_start(v) is not None:
            variables_by_reference.setdefault((kind_of(v), int(v.valueReference)), v)
    return list(variables_by_reference.values())


def _format_group(
    version: int, name: str, variables: Iterable[ModelVariable], values: bool = True
) -> list[str]:
    """Return the arrays of a group of variables, for each type."""
    lines = []
    for kind in _TYPES[version]:
        members, prefix = [v for v in variables if kind_of(v) == kind], f"{name}_{kind.upper()}"
        lines += _format_references(version, prefix, members)
        if values:
            literals = [_format_literal(x) for v in _drop_aliases(members) for x in _list_start_values(v)]
            lines.append(_format_array(f"fmi{version}{kind}", f"{prefix}_VALUES", literals))
    return lines


def _format_references(version: int, name: str, variables: Iterable[ModelVariable]) -> list[str]:
    """Return the value references of variables, the number of these, and that of values."""
    unique = _drop_aliases(variables)
    return [
        f"#define {name}_REFERENCES {len(unique)}",
        f"#define {name}_COUNT {sum(getattr(v, 'size', 1) for v in unique)}",
        _format_array(f"fmi{version}ValueReference", name, [v.valueReference for v in unique]),
    ]


def _drop_aliases(variables: Iterable[ModelVariable]) -> list[ModelVariable]:
    """Return one element of each array of FMI 3.0; all variables of FMI 2.0, of which some are aliases."""
    by_reference: dict[Any, ModelVariable] = {}
    for v in variables:
        by_reference.setdefault(v.valueReference if isinstance(v, ElementVariable) else id(v), v)
    return list(by_reference.values())


def _list_start_values(variable: ModelVariable) -> Sequence[Any]:
    """Return the start values of the whole array of an element, or that of a scalar."""
    if isinstance(variable, ElementVariable) and variable.size > 1:
        return variable.array_start
    return [read_start(variable)]


def _format_array(ctype: str, name: str, values: Sequence[Any]) -> str:
    return f"static const {ctype} {name}[] = {{{', '.join(map(str, values)) or '0'}}};"


def _format_literal(value: Any) -> str:
    """Return a value of any type in C."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return _format_real(value)
    return _quote(value) if isinstance(value, str) else str(value)


def _format_real(value: float) -> str:
    return value.hex() if math.isfinite(value) else "0.0"


def _quote(text: str) -> str:
    """Return a C string literal with all bytes as octal numbers, safe for any text."""
    return '"' + "".join(f"\\{byte:03o}" for byte in text.encode()) + '"'
