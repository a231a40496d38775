"""Read the reports of sanitizers."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

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
    """Return the first error of AddressSanitizer in a report; `call` was the last FMI function."""
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
        size = f" {count_bytes(int(access['size']))}" if access else ""
        is_write = "WRITE of size" in stacks[0] or "caused by a WRITE" in stacks[0]
        preposition = " at" if kind == "SEGV" else " of" if "use-after" in kind else ""
        meaning = f"It {'writes' if is_write else 'reads'}{size}{preposition} {meaning}"
    return MemoryFault(kind, f"{meaning}{_locate(frames) or (f' in {call}' if call else '')}.")


def count_bytes(size: int) -> str:
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
