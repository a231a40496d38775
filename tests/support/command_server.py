"""The `emla` command in processes that cost little: each divides from one that has imported everything.

As a program it reads requests as lines of JSON and answers each with a line: see `Call` and `Ended`.
`CommandServer` starts it and asks. Streams, limits and environment are those of the divided process alone.
"""

import atexit
import gc
import json
import os
import resource
import selectors
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

TO_END = 30.0
"""Seconds within which a process ends that was asked to."""

USABLE, CLOSED, FULL, TERMINAL = "usable", "closed", "full", "terminal"
"""What streams can be: read by us, closed, on a full disk, or what a terminal shows."""

_ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Call:
    """A call of the command in a folder.

    Variables of the environment that are None are not there. `largest` is how many bytes a file may have.
    Who is not done after `patience` seconds gets Ctrl-C. A `cold` process imports everything itself.
    """

    arguments: list[str]
    folder: str
    streams: tuple[str, str, str] = (USABLE, USABLE, USABLE)
    environment: Mapping[str, str | None] = field(default_factory=dict)
    encoding: str = "utf-8"
    largest: int | None = None
    patience: float = 8.0
    cold: bool = False


@dataclass(frozen=True)
class Ended:
    """How a call ended: its exit code, or minus the signal; whether it got Ctrl-C; whether all ended."""

    code: int
    stdout: str
    stderr: str
    asked: bool
    alone: bool


class CommandServer:
    """A process that calls the command for us; it has run a scenario with these FMUs already."""

    def __init__(self, fmus: Path) -> None:
        self._fmus = fmus

    def __enter__(self) -> "CommandServer":
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.command_server", str(self._fmus)],
            cwd=_ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.communicate()

    def call(self, call: Call) -> Ended:
        """Make a call and wait for its end."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(asdict(call)).encode() + b"\n")
        self._process.stdin.flush()
        return Ended(**json.loads(self._process.stdout.readline()))


# ---- the process itself ----------------------------------------------------------------------------


def _serve(fmus: str) -> None:
    """Answer requests; a divided process returns and calls the command."""
    import emla_cosim as ec
    from emla_cosim.cli.commands import build, export, list, run  # noqa: F401

    with ec.load("lift", stop_time=0.002, fmus=fmus).prepare() as simulation:
        simulation.run()
    gc.freeze()
    for line in sys.stdin.buffer:
        call = Call(**json.loads(line))
        ends, theirs = _pipes(call.streams[1:])
        child = os.fork()
        if child == 0:
            _become(call, theirs)
            return
        for end in theirs:
            os.close(end)
        answer = _watched(child, ends, call)
        for end in ends:
            os.close(end)
        sys.stdout.write(json.dumps(asdict(answer)) + "\n")
        sys.stdout.flush()
    os._exit(0)


def _pipes(streams: Any) -> tuple[list[int], list[int]]:
    """Ends to read and to write for output and errors; of a terminal if they go to one."""
    pairs = [os.openpty() if kind == TERMINAL else os.pipe() for kind in streams]
    return [r for r, _ in pairs], [w for _, w in pairs]


def _become(call: Call, ends: list[int]) -> None:
    """Give this process the surroundings of a call."""
    os.setsid()
    os.chdir(call.folder)
    for name, value in call.environment.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    os.environ["PYTHONIOENCODING"] = call.encoding
    tempfile.tempdir = None
    with Path(os.devnull).open("rb") as nothing:
        _connect(0, call.streams[0], nothing.fileno())
    for number, kind, end in zip((1, 2), call.streams[1:], ends, strict=True):
        _connect(number, kind, end)
    os.closerange(3, 256)
    if call.largest is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (call.largest, call.largest))
    if call.cold:
        os.execv(sys.executable, [sys.executable, "-m", "emla_cosim", *call.arguments])
    sys.argv = ["emla", *call.arguments]
    sys.stdin, sys.stdout, sys.stderr = (_stream(number, call) for number in range(3))


def _connect(number: int, kind: str, end: int) -> None:
    if kind == CLOSED:
        os.close(number)
        return
    if kind == FULL:
        end = os.open("/dev/full", os.O_RDWR)
    os.dup2(end, number)


def _stream(number: int, call: Call) -> Any:
    """A stream as Python has it when it starts."""
    if call.streams[number] == CLOSED:
        return None
    mode, errors = ("r", "strict") if number == 0 else ("w", ("strict", "backslashreplace")[number - 1])
    return open(number, mode, encoding=call.encoding, errors=errors, closefd=False)


def _watched(child: int, ends: list[int], call: Call) -> Ended:
    """All that a process says, and how it ended."""
    said: dict[int, bytes] = dict.fromkeys(ends, b"")
    began, asked = time.monotonic(), False
    with selectors.DefaultSelector() as readable:
        for end in ends:
            readable.register(end, selectors.EVENT_READ)
        while readable.get_map():
            for key, _ in readable.select(0.2):
                text = _read(key.fd)
                said[key.fd] += text
                if not text:
                    readable.unregister(key.fd)
            waited = time.monotonic() - began
            if waited > call.patience and not asked:
                os.killpg(child, signal.SIGINT)
                asked = True
            if waited > call.patience + TO_END:
                break
        status = _status(child, call.patience + TO_END - (time.monotonic() - began))
    output, errors = (said[end].decode(call.encoding, "replace") for end in ends)
    return Ended(os.waitstatus_to_exitcode(status), output, errors, asked, _all_ended(child))


def _read(end: int) -> bytes:
    try:
        return os.read(end, 2**16)
    except OSError:  # a terminal nobody holds any more
        return b""


def _status(child: int, seconds: float) -> int:
    """The status of a process; one that does not end is killed."""
    deadline = time.monotonic() + max(seconds, 1.0)
    while time.monotonic() < deadline:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return status
        time.sleep(0.002)
    os.killpg(child, signal.SIGKILL)
    return os.waitpid(child, 0)[1]


def _all_ended(group: int) -> bool:
    """Whether nobody of a group of processes goes on; who does is killed."""
    deadline = time.monotonic() + 2.0
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    os.killpg(group, signal.SIGKILL)
    return False


def _done() -> None:
    """Call the command and end as Python would, but for the time that tidying up modules costs."""
    from emla_cosim.cli.program import main

    code = 0
    try:
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        traceback.print_exc()
        code = 1
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        code = 120  # as Python says it
    os._exit(code)


if __name__ == "__main__":
    _serve(sys.argv[1])
    _done()
