"""Child processes of this program. Each calls one function and exchanges messages with its parent.

A child is a copy of this process or a fresh interpreter. It leads a session of its own: Ctrl-C in a terminal
does not reach it, and all that it started ends with it. It ends when its parent ends.
"""

import gc
import importlib
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn

from .channel import POLL_INTERVAL, Channel, GarbledError, close_channels
from .interruption import POLITE, ignore_interrupts

_SHORTEST_PAUSE, _LONGEST_PAUSE = 0.0005, 0.02
"""Seconds between two looks whether a child has ended."""

_END_TIMEOUT = 5.0
"""Seconds that a child may take to end after it closed its end of the channel."""


class ChildEndedError(Exception):
    """The child has ended; the argument says how. A GarbledError is its cause if something else wrote."""


class Child:
    """A child process that calls `do(channel, *arguments)`, and then ends without exit handlers.

    All methods that exchange messages raise ChildEndedError if the child has ended.

    Args:
        do: A function of a module, or `module:function` if only a fresh interpreter loads it. Its first
            argument is the child's `Channel`.
        *arguments: The other arguments.
        fork: Whether the child is a copy of this process, if the system has that. It starts at once, and
            signals end it. Default: a fresh interpreter with the import path of this process, which ignores
            Ctrl-C and the like. It also works if this process has threads.
        environment: Variables that a fresh interpreter has besides those of this process.

    Raises:
        OSError: The child cannot start.
    """

    def __init__(
        self,
        do: Callable[..., None] | str,
        *arguments: Any,
        fork: bool = False,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        (request, outgoing), (incoming, answer) = os.pipe(), os.pipe()
        self._code: int | None = None
        self._channel = Channel(incoming, outgoing, self.is_alive)
        self._process: _Fork | subprocess.Popen[bytes]
        try:
            if fork and not isinstance(do, str) and hasattr(os, "fork"):
                self._process = _Fork(do, arguments, (request, answer))
            else:
                name = do if isinstance(do, str) else f"{do.__module__}:{do.__qualname__}"
                self._process = _start_interpreter(name, (request, answer), environment or {})
        except BaseException:
            self._channel.close()
            raise
        finally:
            os.close(request)
            os.close(answer)
        if not isinstance(self._process, _Fork):
            with suppress(ChildEndedError):  # `receive` reports it
                self.send(arguments)

    def send(self, content: Any) -> None:
        """Send an object."""
        try:
            self._channel.send(content)
        except (EOFError, OSError) as error:
            raise self._make_ended_error(error) from error

    def receive(self, timeout: float | None = None) -> Any:
        """Return the next object. Raise TimeoutError if it is not complete after `timeout` seconds."""
        return self._receive_from_child(self._channel.receive, timeout)

    def receive_bytes(self, timeout: float | None = None) -> bytes:
        """Return the next message of `Channel.send_bytes`; see `receive`."""
        return self._receive_from_child(self._channel.receive_bytes, timeout)

    def is_alive(self) -> bool:
        """Return whether the child runs. What it started ends with it."""
        if self._code is None:
            self._code = self._process.poll()
            if self._code is not None:
                self._kill_group()
        return self._code is None

    def wait(self, timeout: float | None = None) -> int | None:
        """Return the exit code or negative signal number; None if the child runs after `timeout` seconds."""
        until = None if timeout is None else time.monotonic() + timeout
        pause = _SHORTEST_PAUSE
        while self.is_alive() and (until is None or time.monotonic() < until):
            time.sleep(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE)
        return self._code

    def kill(self) -> None:
        """End the child and all that it started."""
        if self.is_alive():
            self._kill_group()
            with suppress(OSError):  # it may not lead its group yet
                os.kill(self._process.pid, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
        self.wait()

    def close(self, timeout: float = 0.0) -> None:
        """Close the channel, and kill the child if it does not end within `timeout` seconds."""
        if timeout:
            self._channel.close()
            self.wait(timeout)
        self.kill()
        self._channel.close()

    def _receive_from_child(self, receive: Callable[[float | None], Any], timeout: float | None) -> Any:
        """Call a method that receives. Raise ChildEndedError if the child ended, or TimeoutError."""
        try:
            return receive(timeout)
        except TimeoutError:
            raise
        except (EOFError, OSError) as error:
            raise self._make_ended_error(error) from error

    def _make_ended_error(self, error: Exception) -> ChildEndedError:
        """Return the error that says how the child ended, and end all that is left of it."""
        how = str(error) if isinstance(error, GarbledError) else describe_exit(self.wait(_END_TIMEOUT))
        self.kill()  # what wrote to the channel may continue
        return ChildEndedError(how)

    def _kill_group(self) -> None:
        """Kill the child and all that it started, where the system has process groups."""
        if hasattr(os, "killpg"):
            with suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)


class _Fork:
    """A copy of this process."""

    def __init__(self, do: Callable[..., None], arguments: tuple[Any, ...], pipes: tuple[int, int]) -> None:
        parent = os.getpid()
        self.pid = os.fork()
        if self.pid == 0:
            try:
                close_channels()
                os.setsid()
                for number in POLITE:
                    signal.signal(number, signal.SIG_DFL)
                _redirect(os.O_RDONLY, 0)
            finally:
                _call_and_exit(do, Channel(*pipes), arguments, parent)

    def poll(self) -> int | None:
        """Return how the process ended, or None."""
        try:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
        except ChildProcessError:  # an FMU ignores SIGCHLD in this process
            return 0
        return os.waitstatus_to_exitcode(status) if pid else None


def _start_interpreter(
    name: str, pipes: tuple[int, int], environment: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    """Start an interpreter that calls a function; its first message has the arguments."""
    command = [sys.executable, "-P", "-c", f"from {__name__} import main; main()", name, str(os.getpid())]
    incoming, outgoing = pipes
    variables = {**_make_environment(), **environment}
    return subprocess.Popen(command, stdin=incoming, stdout=outgoing, env=variables, start_new_session=True)


def main() -> None:
    """Call the function of a `Child` in its interpreter. The arguments are the function and the parent."""
    ignore_interrupts()
    module, _, function = sys.argv[1].partition(":")
    channel = Channel(os.dup(0), os.dup(1))
    _redirect(os.O_RDONLY, 0)
    try:
        os.dup2(2, 1)  # standard output is the parent's
    except OSError:  # there is no standard error
        _redirect(os.O_WRONLY, 1)
    with suppress(EOFError):
        arguments = channel.receive()
        gc.disable()  # looking for garbage takes a tenth of an import, and finds none
        do = getattr(importlib.import_module(module), function)
        gc.freeze()
        gc.enable()
        _call_and_exit(do, channel, arguments, int(sys.argv[2]))


def _call_and_exit(
    do: Callable[..., None], channel: Channel, arguments: tuple[Any, ...], parent: int
) -> NoReturn:
    """Call the function of a child, and end this process: exit handlers of FMU libraries must not run."""

    def end() -> None:
        channel.at_end_of_parent()
        if hasattr(os, "killpg"):
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    code = 1
    try:
        watch_parent(parent, end)  # even if an FMU never returns
        do(channel, *arguments)
        code = 0
    except ConnectionError:  # the parent has closed its end
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def watch_parent(parent: int, end: Callable[[], None]) -> None:
    """Call `end` from a thread when the parent of this process has ended.

    Args:
        parent: The process id of the parent.
        end: The function, whatever this process is doing.
    """

    def watch() -> None:
        _wait_for_end(parent)
        end()

    threading.Thread(target=watch, daemon=True).start()


def _wait_for_end(parent: int) -> None:
    """Wait until a process has ended that started this one, perhaps through a launcher on Windows."""
    if sys.platform == "win32":  # the interpreter of a virtual environment there is a launcher's child
        import psutil

        with suppress(psutil.NoSuchProcess):
            psutil.Process(parent).wait()
        return
    while os.getppid() == parent:
        time.sleep(POLL_INTERVAL)


class ChildPool:
    """Children for several threads. One that has ended is replaced.

    Args:
        start: Returns a new child.
        count: Number of children to start at once, so that they load meanwhile.
    """

    def __init__(self, start: Callable[[], Child], count: int = 0) -> None:
        self._start, self._lock = start, threading.Lock()
        self._idle, self._in_use = list[Child](), set[Child]()
        self.is_closed = False
        try:
            while len(self._idle) < count:
                self._idle.append(start())
        except BaseException:
            self.close()
            raise

    @contextmanager
    def member(self, use_once: bool = False) -> Iterator[Child]:
        """Yield a child that no other thread has; it has ended if the pool is closed. Exceptions end it.

        Args:
            use_once: Whether to replace an idle child by one that ends afterwards.
        """
        with self._lock:
            child = self._idle.pop() if self._idle else None
            if child is None or use_once or not child.is_alive():
                if child is not None:
                    child.close()
                child = self._start()
            self._in_use.add(child)
            if self.is_closed:
                child.kill()
        is_usable = False
        try:
            yield child
            is_usable = not use_once and child.is_alive()
        finally:
            with self._lock:
                self._in_use.discard(child)
                if is_usable and not self.is_closed:
                    self._idle.append(child)
                else:
                    child.close()

    def close(self, timeout: float = 0.0) -> None:
        """End all children, also those that threads have; idle ones may take `timeout` seconds each."""
        with self._lock:
            self.is_closed = True
            for child in self._in_use:
                child.kill()
            while self._idle:
                self._idle.pop().close(timeout)


def describe_exit(code: int | None) -> str:
    """Return how a process ended, from its exit code or the negative signal number.

    With None, the process has closed its connection, but still runs.
    """
    if code is None:
        return "it closed its connection"
    if code >= 0:
        return f"exit code {code}"
    return signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"


def silence() -> None:
    """Discard all output of this process."""
    _redirect(os.O_WRONLY, 1, 2)


def _redirect(mode: int, *streams: int) -> None:
    """Let standard streams of this process lead nowhere."""
    nowhere = os.open(os.devnull, mode)
    for stream in streams:
        os.dup2(nowhere, stream)
    os.close(nowhere)


def limit_memory(additional: int) -> None:
    """Limit the additional memory of this process in bytes, if the system supports limits.

    A crash then writes no memory dump, either.
    """
    with suppress(ImportError, OSError, ValueError):
        import resource

        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + additional, used + additional))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def count_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _make_environment() -> dict[str, str]:
    """Return the environment of a child process that can import what this one can.

    Each folder is listed once, and removed folders are left out: FMUs leave theirs behind, and the system
    limits the length.
    """
    folders = dict.fromkeys(folder or str(Path.cwd()) for folder in sys.path)
    return {**os.environ, "PYTHONPATH": os.pathsep.join(x for x in folders if Path(x).exists())}
