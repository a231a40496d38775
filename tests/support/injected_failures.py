"""Calls that reach the disk and fail once, in any thread, and in processes that are forked or started.

A failure is an OSError before the call is made. Python reports most calls to audit hooks; `write` and `fsync`
are wrapped. What libraries write past Python's streams is not seen.
"""

import builtins
import errno
import io
import mmap
import os
import re
import sys
import tempfile
import zlib
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

VARIABLE = "EMLA_TEST_FAILURES"
"""Environment variable with the file that all processes share; `injected/sitecustomize.py` looks for it."""

CHANGES = frozenset(
    (
        "write",
        "fsync",
        "create",
        "os.mkdir",
        "os.rename",
        "os.link",
        "os.remove",
        "os.rmdir",
        "os.chmod",
        "os.truncate",
    )
)
"""Calls that change what is on the disk."""

LOOKS = frozenset(
    ("open", "os.scandir", "os.listdir", "tempfile.mkstemp", "tempfile.mkdtemp", "shutil.rmtree")
)
"""Calls that only look, and events that precede others."""

_OURS = re.compile(r"[/\\](emla_cosim|fmublock)[/\\](?!test_)")

_ARMED, _DEEP, _FAILED, _TEXTS, _BITS = 0, 1, 2, 8, 2**14
_TEXT = (_BITS - _TEXTS) // 3
_SIZE = _BITS + 2**20


class Failures:
    """Lets a call fail at a place of our code where none has failed yet.

    A place is the kind of the call and the innermost line of ours; if `deep`, all lines of ours that lead
    there.
    """

    def __init__(self, path: Path) -> None:
        """Share what failed in this file. This process is watched for ever: audit hooks cannot be removed."""
        if not path.exists() or path.stat().st_size != _SIZE:
            path.write_bytes(bytes(_SIZE))
        with path.open("r+b") as stream:
            self._memory = mmap.mmap(stream.fileno(), 0)
        self._original = io.open, os.fsync
        for module in (io, builtins):
            vars(module)["open"] = self._open
        os.fsync = self._fsync
        sys.addaudithook(self._hear)

    def forget(self) -> None:
        """Forget all places."""
        self._memory[_BITS:] = bytes(_SIZE - _BITS)
        self.count = 0

    count = 0

    def arm(self, folder: Path, kinds: Collection[str], deep: bool) -> None:
        """Let one call fail from now on, of these kinds and in this folder."""
        self._write(0, str(folder))
        self._write(1, ",".join(kinds))
        self._write(2, "")
        self._memory[_DEEP], self._memory[_FAILED], self._memory[_ARMED] = deep, 0, 1

    def disarm(self) -> str | None:
        """Let no call fail any more; return the place that failed, or None."""
        self._memory[_ARMED] = 0
        if not self._memory[_FAILED]:
            return None
        self.count += 1
        return self._read(2)

    def _write(self, which: int, text: str) -> None:
        content = text.encode()[-(_TEXT - 2) :]
        at = _TEXTS + which * _TEXT
        self._memory[at : at + 2 + len(content)] = len(content).to_bytes(2, "big") + content

    def _read(self, which: int) -> str:
        at = _TEXTS + which * _TEXT
        length = int.from_bytes(self._memory[at : at + 2], "big")
        return self._memory[at + 2 : at + 2 + length].decode(errors="replace")

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Take an event of the interpreter."""
        if not self._memory[_ARMED] or self._memory[_FAILED] or event not in CHANGES | LOOKS or not arguments:
            return
        if event == "open" and arguments[2] & (os.O_CREAT | os.O_TRUNC):
            self._fail("create", arguments[0])
        self._fail(event, arguments[0])

    def _fail(self, kind: str, path: Any) -> None:
        """Raise OSError if this call is one to fail."""
        if not self._memory[_ARMED] or self._memory[_FAILED] or kind not in self._read(1).split(","):
            return
        if isinstance(path, int):
            try:
                path = str(Path(f"/proc/self/fd/{path}").readlink())
            except OSError:
                return
            if not path.startswith("/"):  # a pipe or a socket
                return
        if not isinstance(path, (str, bytes, os.PathLike)) or not self._is_inside(os.fsdecode(path)):
            return
        place = f"{kind} {_place(bool(self._memory[_DEEP]))}"
        bit = zlib.crc32(place.encode()) % (8 * (_SIZE - _BITS))
        if self._memory[_BITS + bit // 8] & 1 << bit % 8:
            return
        self._memory[_BITS + bit // 8] |= 1 << bit % 8
        self._memory[_FAILED] = 1
        self._write(2, f"{place} {os.fsdecode(path)}")
        raise OSError(errno.EIO, os.strerror(errno.EIO), os.fsdecode(path))

    def _is_inside(self, path: str) -> bool:
        return not Path(path).is_absolute() or path.startswith(self._read(0))

    def _fsync(self, stream: Any) -> None:
        self._fail("fsync", stream if isinstance(stream, int) else stream.fileno())
        self._original[1](stream)

    def _open(
        self,
        file: Any,
        mode: str = "r",
        buffering: int = -1,
        encoding: str | None = None,
        errors: str | None = None,
        newline: str | None = None,
        closefd: bool = True,
        opener: Any = None,
    ) -> Any:
        if not self._memory[_ARMED] or not set(mode) & set("wax+"):
            return self._original[0](file, mode, buffering, encoding, errors, newline, closefd, opener)
        raw = _Raw(file, mode.replace("t", "").replace("b", ""), closefd, opener, self._fail)
        if buffering == 0:
            return raw
        size = buffering if buffering > 1 else io.DEFAULT_BUFFER_SIZE
        stream: Any = io.BufferedRandom(raw, size) if "+" in mode else io.BufferedWriter(raw, size)
        return stream if "b" in mode else io.TextIOWrapper(stream, encoding, errors, newline, buffering == 1)


class _Raw(io.FileIO):
    """A file whose writes may fail."""

    def __init__(
        self, file: Any, mode: str, closefd: bool, opener: Any, fail: Callable[[str, Any], None]
    ) -> None:
        self._error: OSError | None
        super().__init__(file, mode, closefd, opener)
        self._fail_first, self._error = fail, None

    def write(self, content: Any) -> Any:
        """Write, or fail now and whenever the rest is written again."""
        if self._error is not None:
            raise self._error
        try:
            self._fail_first("write", self.fileno())
        except OSError as error:
            self._error = error
            raise
        return super().write(content)


def _place(deep: bool) -> str:
    """Return the lines of ours that are being executed: the innermost one, or all."""
    frame, lines = sys._getframe(2), list[str]()
    outermost = f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
    while frame is not None and (deep or not lines):
        if _OURS.search(frame.f_code.co_filename):
            lines.append(f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}")
        frame = frame.f_back  # type: ignore[assignment]
    return " < ".join(lines) or outermost


def watch_this_process() -> None:
    """Take part in the failures of the process that started this one."""
    if (path := os.environ.get(VARIABLE)) and Path(path).exists():
        Failures(Path(path))


def new_failures() -> Failures:
    """Return failures for this process, and for those that it starts with `injected` on their path."""
    handle, name = tempfile.mkstemp(prefix="emla-test-failures-")
    os.close(handle)
    os.environ[VARIABLE] = name
    found = Failures(Path(name))
    found.forget()
    return found
