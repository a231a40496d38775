"""A process that answers requests of its parent."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, NoReturn

from .channel import Channel, ChannelTimeoutError, open_parent_channel
from .interruption import ignore_interrupts
from .processes import describe_exit, make_environment, watch_parent

_END_S = 2.0
"""How long a killed process takes at most to end after it closed its streams, in s."""


class ServerEndedError(Exception):
    """The process has ended; the argument says how."""


class Server:
    """A process that runs a module, which calls `serve`. All methods but `close` may raise ServerEndedError.

    It has the import path of this process, and Ctrl-C in a terminal does not reach it.
    """

    def __init__(self, module: str, *arguments: str) -> None:
        """Start the process.

        Args:
            module: The name of the module.
            *arguments: The arguments of its command line.

        Raises:
            OSError: If the process cannot start.
        """
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", module, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env=make_environment(),
            start_new_session=True,
        )
        self._channel = Channel(self._process.stdout, self._process.stdin, self.is_alive)

    def send(self, request: Any) -> None:
        """Send a request."""
        try:
            self._channel.send(request)
        except OSError as error:
            raise self._ended() from error

    def receive(self, patience: float | None = None) -> Any:
        """Wait for an answer; kill the process if there is none within `patience` seconds."""
        try:
            return self._channel.receive(patience)
        except ChannelTimeoutError as error:
            raise self._killed("no answer") from error
        except EOFError as error:
            if error.args:  # something else writes to the stream and may continue
                raise self._killed(str(error)) from error
            raise self._ended() from error
        except KeyboardInterrupt as error:  # a second Ctrl-C ends a call that never returns
            raise self._killed("interrupted") from error
        except BaseException:  # a late answer must not be taken for that of the next request
            self.kill()
            raise

    def is_alive(self) -> bool:
        """Return whether the process is running."""
        return self._process.poll() is None

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()

    def close(self, patience: float = 0.0) -> None:
        """Close the streams, and kill the process if it does not end within `patience` seconds."""
        self._channel.close()
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self.kill()

    def _killed(self, how: str) -> ServerEndedError:
        self.kill()
        return ServerEndedError(how)

    def _ended(self) -> ServerEndedError:
        return ServerEndedError(describe_exit(self._process.wait()))


def serve(
    answer: Callable[[Any, Callable[[Any], None]], Any], clean_up: Callable[[], None] | None = None
) -> NoReturn:
    """Answer the requests of the parent process until it ends.

    Args:
        answer: Gets a request, and a function that sends objects before the answer; returns the answer.
        clean_up: Called once the parent is gone, possibly from a thread.
    """

    def end() -> NoReturn:
        if clean_up is not None:
            clean_up()
        os._exit(0)

    ignore_interrupts()  # the parent ends this process
    parent = os.getppid()
    watch_parent(parent, end)  # even if an FMU never returns
    channel = open_parent_channel()
    while True:
        try:
            request = channel.receive()
        except EOFError:
            break
        answered = answer(request, channel.send)
        try:
            channel.send(answered)
        except OSError:
            break
    if clean_up is None:  # the parent may wait for this process to end
        os._exit(0)
    until = time.monotonic() + _END_S
    while os.getppid() == parent and time.monotonic() < until:
        time.sleep(0.01)  # a killed process closes its streams before it has ended
    if os.getppid() != parent:
        clean_up()
    os._exit(0)
