"""Messages between two processes."""

import pickle
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any
from weakref import WeakSet

LOOK = 0.1
"""Seconds between two checks that the other process is alive."""

_HEAD = struct.Struct("=8sQ")
_MARK = b"\x93emla\r\n\x1a"
_BLOCK = 2**16

_LONGEST = 2**29
"""Bytes of the longest message that is not unpickled."""


class GarbledError(EOFError):
    """Something else wrote to the channel, such as an FMU."""


class Channel:
    """One end of a connection between two processes; an FMU can write to the other one."""

    def __init__(self, end: socket.socket, is_alive: Callable[[], bool] | None = None) -> None:
        """Use a socket.

        Args:
            end: The socket.
            is_alive: Returns whether the other process is alive. Needed because processes that the other one
                started can hold its end open.
        """
        self._socket, self._is_alive = end, is_alive
        self._received, self._has_ended = bytearray(), False
        self.at_end_of_parent: Callable[[], None] = lambda: None
        """Called in a child whose parent was killed, from a thread."""
        if is_alive is not None:
            end.settimeout(LOOK)
        _open_channels.add(self)

    def send(self, content: Any) -> None:
        """Send an object.

        Raises:
            EOFError: The other process has ended.
            OSError: The other end is closed.
        """
        self.send_bytes(pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL))

    def send_bytes(self, content: bytes) -> None:
        """Send bytes; see `send`."""
        left = memoryview(_HEAD.pack(_MARK, len(content)) + content)
        while left:
            try:
                left = left[self._socket.send(left) :]
            except TimeoutError:
                self._look()

    def receive(self, timeout: float | None = None) -> Any:
        """Wait for an object.

        Args:
            timeout: The longest wait in s; default: unlimited.

        Raises:
            TimeoutError: The object is not complete in time.
            EOFError: The other process has ended, or closed its end.
            OSError: The same.
            GarbledError: Something else wrote to the channel.
        """
        return pickle.loads(self._receive(timeout))

    def receive_bytes(self, timeout: float | None = None) -> bytes:
        """Wait for bytes, which are not unpickled: that could execute code in this process. See `receive`."""
        return self._receive(timeout, _LONGEST)

    def requests(self) -> Iterator[Any]:
        """Yield the objects that arrive, until the other process closes its end."""
        while True:
            try:
                request = self.receive()
            except (EOFError, OSError):
                return
            yield request

    def close(self) -> None:
        """Close this end, so that the other process gets EOFError."""
        self._socket.close()
        _open_channels.discard(self)

    def _receive(self, timeout: float | None, most: int = sys.maxsize) -> bytes:
        until = None if timeout is None else time.monotonic() + timeout
        self._fill(_HEAD.size, until)
        mark, length = _HEAD.unpack_from(self._received)
        if mark != _MARK or length > most:
            raise GarbledError("something else wrote to the stream")
        end = _HEAD.size + length
        self._fill(end, until)
        content = bytes(memoryview(self._received)[_HEAD.size : end])
        del self._received[:end]
        return content

    def _fill(self, count: int, until: float | None) -> None:
        """Read until so many bytes are there."""
        while len(self._received) < count:
            try:
                block = self._socket.recv(max(count - len(self._received), _BLOCK))
            except TimeoutError:
                if until is not None and time.monotonic() >= until:
                    raise
                self._look()
                continue
            if not block:
                raise EOFError
            self._received += block

    def _look(self) -> None:
        """Raise EOFError if the other process had ended at the look before: nothing more comes from it."""
        if self._has_ended:
            raise EOFError
        self._has_ended = self._is_alive is not None and not self._is_alive()


_open_channels: WeakSet[Channel] = WeakSet()


def close_channels() -> None:
    """Close all channels: in a copy of the process that opened them, where an FMU could write to them."""
    for channel in list(_open_channels):
        channel.close()
