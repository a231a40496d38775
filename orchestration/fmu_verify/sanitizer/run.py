"""Build an FMU with sanitizers, run it, and read what they report."""

import os
import re
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from emla_cosim.base.process import describe_exit
from emla_cosim.fmu.instance import ERROR, FATAL, STATUS

from ..c_sources import NO_COMPILER
from ..compute_once import compute_once
from ..messages import join_few_names, shorten_sentence
from ..subject import Subject
from .compiling import (
    FOLDER,
    Compiler,
    CompilerError,
    SourceSet,
    compile_host,
    compile_library,
    find_sources,
    format_plan,
    list_clocks_without_ticks,
    list_compilers,
)

_ERROR = re.compile(r"ERROR: AddressSanitizer:? (?P<kind>[\w-]+)(?P<rest>[^\n]*)")
_ACCESS = re.compile(r"^(?P<access>READ|WRITE) of size (?P<size>\d+)", re.MULTILINE)
_FRAME = re.compile(r"^\s*#\d+ 0x[0-9a-f]+ (?:in (?P<function>\S+) )?\(?(?P<place>[^\s()]+)", re.MULTILINE)
_LEAK = re.compile(r"^(?:Direct|Indirect) leak of (?P<bytes>\d+) byte\(s\)[^\n]*\n", re.MULTILINE)
_UNDEFINED = re.compile(r"^(?P<place>\S+?:\d+)(?::\d+)?: runtime error: (?P<what>[^\n]+)", re.MULTILINE)
_PANIC = re.compile(r"^thread \d+ panic: (?P<what>[^\n]+)\n(?P<place>\S+?:\d+)", re.MULTILINE)
NO_LEAKS = "LeakSanitizer has encountered a fatal error"
"""What LeakSanitizer says where the system does not let it look at the process."""

_MEANINGS = {
    "heap-buffer-overflow": "outside of allocated memory",
    "stack-buffer-overflow": "outside of a local variable",
    "stack-buffer-underflow": "outside of a local variable",
    "dynamic-stack-buffer-overflow": "outside of a local variable",
    "global-buffer-overflow": "outside of a static variable",
    "container-overflow": "outside of a container",
    "heap-use-after-free": "memory that was freed",
    "stack-use-after-return": "a local variable of a function that has returned",
    "stack-use-after-scope": "a local variable after the end of its block",
    "SEGV": "an invalid address",
    "bad-free": "It frees memory that was not allocated",
    "double-free": "It frees memory twice",
    "attempting": "It frees memory wrongly",
    "memcpy-param-overlap": "It copies between memory that overlaps",
    "stack-overflow": "It needs more stack than there is",
    "allocation-size-too-big": "It allocates more memory than is possible",
}


@dataclass(frozen=True)
class SourceLine:
    """A function and its line in the sources: `set_value (model.c:12)`."""

    function: str
    line: str

    def __str__(self) -> str:
        return f"{self.function} ({self.line})" if self.function else self.line


@dataclass(frozen=True)
class MemoryFault:
    """The first error of AddressSanitizer, as a message."""

    kind: str
    sentence: str


@dataclass(frozen=True)
class Leak:
    """Memory that was not freed: bytes, and where it was allocated."""

    size: int
    source_line: str


def read_memory_error(text: str, sources: Path, call: str = "") -> MemoryFault | None:
    """Return the first error of AddressSanitizer in a report, or None; `call` was the last FMI function."""
    match = _ERROR.search(text)
    if match is None:
        return None
    kind = match["kind"]
    if kind == "attempting":  # "attempting double-free on", "attempting free on address"
        kind = "double-free" if "double-free" in match["rest"] else "bad-free"
    stacks = text[match.end() :].split("\n\n")
    frames = list(_find_frames(stacks[0], sources))
    meaning = _MEANINGS.get(kind, f"It causes the error {kind} of AddressSanitizer")
    if not meaning.startswith("It "):
        access = _ACCESS.search(stacks[0])
        size = f" {format_bytes(int(access['size']))}" if access else ""
        is_write = "WRITE of size" in stacks[0] or "caused by a WRITE" in stacks[0]
        preposition = " at" if kind == "SEGV" else " of" if "use-after" in kind else ""
        meaning = f"It {'writes' if is_write else 'reads'}{size}{preposition} {meaning}"
    return MemoryFault(kind, f"{meaning}{_locate(frames) or (f' in {call}' if call else '')}.")


def format_bytes(size: int) -> str:
    """Return `1 byte` or `8 bytes`."""
    return f"{size} byte" if size == 1 else f"{size} bytes"


def _locate(frames: Sequence[SourceLine]) -> str:
    """Return where an error is: the innermost function, and the FMI function that called it."""
    if not frames:
        return ""
    called = next((p.function for p in frames if p.function.startswith(("fmi2", "fmi3"))), "")
    by = f", called by {called}" if called and called != frames[0].function else ""
    return f" in {frames[0]}{by}"


def read_leaks(text: str, sources: Path) -> list[Leak]:
    """Return the leaks of a report whose memory the FMU allocated, each place once."""
    bytes_by_line: dict[str, int] = {}
    pieces = _LEAK.split(text)
    for size, stack in zip(pieces[1::2], pieces[2::2], strict=True):
        frames = list(_find_frames(stack.split("\n\n")[0], sources))
        if frames:
            bytes_by_line[str(frames[0])] = bytes_by_line.get(str(frames[0]), 0) + int(size)
    return [Leak(size, line) for line, size in bytes_by_line.items()]


def read_undefined(text: str, sources: Path) -> list[str]:
    """Return what UBSan reports about the sources of the FMU, each place once."""
    messages = dict[str, None]()
    for pattern in (_UNDEFINED, _PANIC):
        for match in pattern.finditer(text):
            if (line := _shorten_path(match["place"], sources)) is not None:
                # addresses differ from run to run
                problem = re.sub(r" 0x[0-9a-f]+", "", match["what"]).strip()
                messages[f"{line}: {problem}."] = None
    return list(messages)


def _find_frames(stack: str, sources: Path) -> Iterator[SourceLine]:
    """Yield the frames of a stack that are in the sources, innermost first."""
    for frame in _FRAME.finditer(stack):
        if (line := _shorten_path(frame["place"], sources)) is not None:
            yield SourceLine(frame["function"] or "", line)


def _shorten_path(source_path: str, sources: Path) -> str | None:
    """Return `file:line` relative to the sources, or None if it is elsewhere."""
    path, _, rest = source_path.partition(":")
    try:
        inside = Path(path).resolve().relative_to(sources.resolve())
    except (ValueError, OSError):
        return None
    line = rest.partition(":")[0]
    return f"{inside.as_posix()}:{line}" if line else inside.as_posix()


TIME_FACTOR = 5.0
"""Multiplies the time limit of a check that builds and runs an FMU."""

_COMPILE, _RUN = 1.5, 1.0
"""Most time to compile a library, and to run an instance, relative to the time limit of a check."""

_EXIT_CODE = 99

_PREFIXES = ("fmi2", "fmi3")
"""Beginnings of names of functions."""


@dataclass(frozen=True)
class SanitizedRun:
    """What sanitizers report about one kind of an FMU, or about all of them.

    Attributes:
        missing: Why there is no such build, as a message; empty if there is one.
        has_sources: Whether the FMU lists sources.
        has_address: Whether AddressSanitizer was there.
        ran: Whether steps were made.
        judges_leaks: Whether instances were freed, so that what is left is a leak.
        memory_faults: Errors of AddressSanitizer.
        leaks: Memory that is left.
        undefined: Messages of UBSan.
        gaps: What the run did not reach, as sentences.
    """

    missing: str = ""
    has_sources: bool = True
    has_address: bool = False
    ran: bool = False
    judges_leaks: bool = False
    memory_faults: tuple[MemoryFault, ...] = ()
    leaks: tuple[Leak, ...] = ()
    undefined: tuple[str, ...] = ()
    gaps: tuple[str, ...] = ()


def run_sanitized(subject: Subject) -> SanitizedRun:
    """Return what sanitizers report about an FMU. Build and run it once for all checks of an examination."""
    return compute_once(subject.scratch / FOLDER / "run.pickle", lambda: _build_and_run(subject))


def _build_and_run(subject: Subject) -> SanitizedRun:
    """Build and run an FMU, or return why that is not possible."""
    kinds = [kind for kind in subject.kinds if kind != "ScheduledExecution"]
    if not kinds:
        return SanitizedRun("It is for Scheduled Execution only, which is not run.")
    by_kind = {kind: find_sources(subject, kind) for kind in kinds}
    sets = {kind: sources for kind, sources in by_kind.items() if sources is not None}
    if not sets:
        return SanitizedRun("The FMU has no sources that it lists.", has_sources=False)
    if not all(sources.is_c for sources in sets.values()):
        return SanitizedRun("Not all of its sources are C.")
    if subject.description_problem:
        return SanitizedRun(subject.description_problem)
    with tempfile.TemporaryDirectory(dir=subject.folder.parent) as scratch:
        return _build_and_run_all(subject, sets, Path(scratch))


def _build_and_run_all(subject: Subject, sets: Mapping[str, SourceSet], scratch: Path) -> SanitizedRun:
    """Build and run all kinds of an FMU with the first compiler that has sanitizers."""
    limit, problem = _COMPILE * subject.settings.seconds, NO_COMPILER
    plans = {kind: format_plan(subject, kind) for kind in sets}
    for compiler in list_compilers():
        try:
            hosts = {k: compile_host(compiler, scratch / k, plan, limit) for k, plan in plans.items()}
        except CompilerError as error:
            if problem == NO_COMPILER:
                problem = f"The compiler of this machine has no sanitizers: {error}."
            continue
        try:
            libraries = {s: compile_library(compiler, subject, s, limit) for s in {*sets.values()}}
        except CompilerError as error:
            return SanitizedRun(f"Its sources do not compile with sanitizers: {error}.")
        return _join_runs([_run_host(subject, k, compiler, hosts[k], libraries[s]) for k, s in sets.items()])
    return SanitizedRun(problem)


def _join_runs(runs: list[SanitizedRun]) -> SanitizedRun:
    """Return what was found for all kinds."""
    if first := next((run for run in runs if run.missing), None):
        return first
    return SanitizedRun(
        has_address=runs[0].has_address,
        ran=all(run.ran for run in runs),
        judges_leaks=all(run.judges_leaks for run in runs),
        memory_faults=tuple(dict.fromkeys(e for run in runs for e in run.memory_faults)),
        leaks=tuple({leak.source_line: leak for run in runs for leak in run.leaks}.values()),
        undefined=tuple(dict.fromkeys(line for run in runs for line in run.undefined)),
        gaps=tuple(dict.fromkeys(gap for run in runs for gap in run.gaps)),
    )


def _run_host(subject: Subject, kind: str, compiler: Compiler, host: Path, library: Path) -> SanitizedRun:
    """Run a kind of the FMU in its host, and read what the sanitizers report."""
    folder, sources = host.parent, subject.folder / "sources"
    trace, limit, ended = folder / "calls.txt", _RUN * subject.settings.seconds, ""
    with (folder / "errors.txt").open("wb") as errors:
        try:
            code = subprocess.run(
                [str(host), str(library), str(trace)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                check=False,
                timeout=limit,
                env={**os.environ, **_make_environment(folder, subject.settings.memory)},
            ).returncode
        except subprocess.TimeoutExpired:
            code, ended = 0, f"It did not end within {limit:g} s."
        except OSError as error:
            return SanitizedRun(f"The host does not start: {error.strerror}.")
    log_lines = trace.read_text(errors="replace").splitlines() if trace.is_file() else []
    # AddressSanitizer writes to files with this name; UBSan writes to standard error
    text = "\n".join(
        _read_beginning(path) for path in [*sorted(folder.glob("report*")), folder / "errors.txt"]
    )
    memory_fault = (
        read_memory_error(text, sources, _find_last_call(log_lines)) if compiler.has_address else None
    )
    undefined = read_undefined(text, sources)
    complete = log_lines[-1:] == ["end"]
    gaps = [f"{kind}: {reason}" for reason in _list_failed_calls(log_lines)]
    if not complete and memory_fault is None and (compiler.has_address or not undefined):
        gaps.append(f"{kind}: {ended or _describe_end(log_lines, code)}")
    if still := list_clocks_without_ticks(subject, kind):
        gaps.append(f"{kind}: {join_few_names(still)} did not tick.")
    leaks = read_leaks(text, sources) if complete else []
    return SanitizedRun(
        has_address=compiler.has_address,
        ran=any(call[:4] in _PREFIXES and call[4:] in ("DoStep", "SetTime") for call in log_lines),
        judges_leaks=compiler.has_address and complete and NO_LEAKS not in text,
        memory_faults=(memory_fault,) if memory_fault is not None else (),
        leaks=tuple(leaks),
        undefined=tuple(undefined),
        gaps=tuple(gaps),
    )


def _list_failed_calls(log_lines: list[str]) -> list[str]:
    """Return messages on calls that answered Error or Fatal: `fmi2DoStep answered fmi2Error: ...`."""
    messages, call, reason = [], "", ""
    for line in log_lines:
        if line.startswith("#"):
            reason = f": {line.removeprefix('# ')}"
        elif not line.isdecimal():
            call, reason = line, ""
        elif int(line) in (ERROR, FATAL):
            messages.append(shorten_sentence(f"{call} answered {STATUS[int(line)]}{reason.rstrip('. ')}."))
    return messages


def _find_last_call(log_lines: list[str]) -> str:
    """Return the last FMI function in a log; empty if there is none."""
    return next((line for line in reversed(log_lines) if line.startswith(_PREFIXES)), "")


def _describe_end(log_lines: list[str], code: int) -> str:
    """Return why a run did not come to its end."""
    log_message = next((line.removeprefix("# ") for line in reversed(log_lines) if line.startswith("#")), "")
    call = _find_last_call(log_lines)
    if log_lines[-1:] == ["NULL"]:
        reason = f"fmi2Instantiate answered NULL: {log_message}"
        reason = reason if call else "it does not export fmi2Instantiate"
        return shorten_sentence(f"{reason.rstrip(': .')}.")
    return f"It ended the process in {call or 'its first call'} ({describe_exit(code)})."


def _make_environment(folder: Path, memory_limit: int) -> dict[str, str]:
    """Return environment variables for the sanitizers."""
    common = {
        "log_path": str(folder / "report"),
        "exitcode": _EXIT_CODE,
        "print_stacktrace": 1,
        "symbolize": 1,
        "detect_leaks": 1,
        "detect_stack_use_after_return": 1,
        "detect_odr_violation": 0,
        "allocator_may_return_null": 1,
        # the address space cannot be limited: AddressSanitizer reserves most of it
        "hard_rss_limit_mb": max(1, memory_limit >> 20),
    }
    text = ":".join(f"{name}={value}" for name, value in common.items())
    return {"ASAN_OPTIONS": text, "UBSAN_OPTIONS": text, "LSAN_OPTIONS": "print_suppressions=0"}


def _read_beginning(path: Path) -> str:
    """Return the first MiB of a file."""
    with path.open("rb") as stream:
        return stream.read(2**20).decode(errors="replace")
