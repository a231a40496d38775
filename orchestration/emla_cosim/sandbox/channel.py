"""Requests and answers between two processes, through one pipe for each direction."""

import os
import pickle
import select
import struct
import time
from collections.abc import Callable
from typing import IO, Any

_HEAD = struct.Struct("=8sQ")
_MARK = b"\x93emla\r\n\x1a"
_BLOCK = 2**16
_LOOK = 0.5
"""Seconds between two checks that the other process is alive."""


class ChannelTimeoutError(Exception):
    """The other process did not answer in time."""


class Channel:
    """Sends and receives objects.

    Both ends belong to this package, but an FMU can write to any open stream.
    """

    def __init__(
        self,
        incoming: IO[bytes] | None,
        outgoing: IO[bytes] | None,
        alive: Callable[[], bool] | None = None,
    ) -> None:
        """Use unbuffered streams.

        Args:
            incoming: The stream to read from.
            outgoing: The stream to write to.
            alive: Returns whether the other process is alive. It is needed because processes that the other
                one started can hold its end of a stream open.
        """
        assert incoming is not None
        assert outgoing is not None
        self._incoming, self._outgoing = incoming, outgoing
        self._ahead = b""
        self._alive, self._poll = alive, None
        if alive is not None and hasattr(select, "poll"):
            self._poll = select.poll()
            self._poll.register(incoming, select.POLLIN)

    def send(self, content: Any) -> None:
        """Send one object.

        Raises:
            OSError: If the other end is closed.
        """
        text = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
        left = memoryview(_HEAD.pack(_MARK, len(text)) + text)
        while left:
            left = left[self._outgoing.write(left) :]

    def receive(self, patience: float | None = None) -> Any:
        """Wait for one object.

        Args:
            patience: The longest wait in s; default: unlimited. Without `poll` in the system there is no
                limit.

        Raises:
            EOFError: If the other end is closed, or something else wrote to the stream.
            ChannelTimeoutError: If no object arrives in time.
        """
        mark, length = _HEAD.unpack(self._read(_HEAD.size, patience))
        if mark != _MARK:
            raise EOFError("something else wrote to the stream")
        return pickle.loads(self._read(length))

    def close(self) -> None:
        """Close both streams, so that the other process receives EOFError."""
        for stream in (self._outgoing, self._incoming):
            try:
                stream.close()
            except OSError:
                continue

    def _read(self, count: int, patience: float | None = None) -> bytes:
        found = self._ahead
        while len(found) < count:
            self._wait(patience)
            block = self._incoming.read(max(count - len(found), _BLOCK))  # mostly the whole message
            if not block:
                raise EOFError
            found += block
        self._ahead = found[count:]
        return found[:count]

    def _wait(self, patience: float | None) -> None:
        """Wait until there is something to read, or the other end is closed."""
        if self._poll is None or self._alive is None:
            return
        until = time.monotonic() + patience if patience is not None else None
        while not self._poll.poll(1e3 * _LOOK):
            if not self._alive():
                raise EOFError
            if until is not None and time.monotonic() > until:
                raise ChannelTimeoutError


_to_parent: list[Channel] = []


def open_parent_channel() -> Channel:
    """Return the channel to the parent of a process that it started with pipes as standard input and output.

    All other output of this process goes to standard error from now on.
    """
    incoming, outgoing = os.dup(0), os.dup(1)
    os.dup2(2, 1)
    os.close(0)
    channel = Channel(os.fdopen(incoming, "rb", buffering=0), os.fdopen(outgoing, "wb", buffering=0))
    _to_parent.append(channel)
    return channel


def close_parent_channels() -> None:
    """Close what `open_parent_channel` opened: in a fork that runs an FMU, which could write to it."""
    while _to_parent:
        _to_parent.pop().close()
