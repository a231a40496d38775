"""Messages between two processes."""

import ctypes
import os
import pickle
import select
import struct
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any
from weakref import WeakSet

if sys.platform == "win32":
    import msvcrt

POLL_INTERVAL = 0.1
"""Seconds between two checks that the other process is alive."""

_HEAD = struct.Struct("=8sQ")
_MARK = b"\x93emla\r\n\x1a"
_BLOCK = 2**16

_LONGEST = 2**29
"""Bytes of the longest message that is not unpickled."""

_GARBLED = "something else wrote to the stream"


class GarbledError(EOFError):
    """Something else wrote to the channel, such as an FMU."""


class Channel:
    """One end of a connection between two processes, through a pipe for each direction.

    An FMU can write to the pipes.
    """

    def __init__(self, incoming: int, outgoing: int, is_alive: Callable[[], bool] | None = None) -> None:
        """Use open files.

        Args:
            incoming: The number of the file to read from.
            outgoing: The number of the file to write to.
            is_alive: Returns whether the other process is alive. Needed because processes that the other one
                started can hold its end open. Without it, `receive` has no time limit.
        """
        self._incoming, self._outgoing, self._is_alive = incoming, outgoing, is_alive
        self._received, self._has_ended = bytearray(), False
        self._poll = select.poll() if is_alive is not None and hasattr(select, "poll") else None
        if self._poll is not None:
            self._poll.register(incoming, select.POLLIN)
        self.at_end_of_parent: Callable[[], None] = lambda: None
        """Called in a child whose parent was killed, from a thread."""
        _open_channels.add(self)

    def send(self, content: Any) -> None:
        """Send an object.

        Raises:
            OSError: The other end is closed.
        """
        self.send_bytes(pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL))

    def send_bytes(self, content: bytes) -> None:
        """Send bytes; see `send`."""
        # a pipe may take a part of a long message
        remaining = memoryview(_HEAD.pack(_MARK, len(content)) + content)
        while remaining:
            remaining = remaining[os.write(self._outgoing, remaining) :]

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
        content = self._receive(timeout)
        try:
            return pickle.loads(content)
        except (pickle.UnpicklingError, EOFError) as error:
            raise GarbledError(_GARBLED) from error

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
        if self in _open_channels:
            _open_channels.discard(self)
            os.close(self._incoming)
            os.close(self._outgoing)

    def _receive(self, timeout: float | None, longest: int = sys.maxsize) -> bytes:
        """Return the bytes of the next message, of at most `longest`. Raise what `receive` does."""
        until = None if timeout is None else time.monotonic() + timeout
        self._fill(_HEAD.size, until)
        mark, length = _HEAD.unpack_from(self._received)
        if mark != _MARK or length > longest:
            raise GarbledError(_GARBLED)
        end = _HEAD.size + length
        self._fill(end, until)
        content = bytes(memoryview(self._received)[_HEAD.size : end])
        del self._received[:end]
        return content

    def _fill(self, count: int, until: float | None) -> None:
        """Read until so many bytes are there. Raise EOFError at the end, TimeoutError at the time `until`."""
        while len(self._received) < count:
            if not self._has_input():
                if self._has_ended:  # at the look before: nothing more comes
                    raise EOFError
                self._has_ended = self._is_alive is not None and not self._is_alive()
                if until is not None and time.monotonic() >= until and not self._has_ended:
                    raise TimeoutError
            elif block := os.read(self._incoming, max(count - len(self._received), _BLOCK)):
                self._received += block
            else:
                raise EOFError

    def _has_input(self) -> bool:
        """Return whether there is something to read, or the other end is closed; wait for it a short time.

        It is always true where nothing can be checked; reading waits then.
        """
        if self._poll is not None:
            return bool(self._poll.poll(1e3 * POLL_INTERVAL))
        if sys.platform != "win32" or self._is_alive is None:
            return True
        pipe, until, count = (
            msvcrt.get_osfhandle(self._incoming),
            time.monotonic() + POLL_INTERVAL,
            ctypes.c_ulong(),
        )
        while ctypes.windll.kernel32.PeekNamedPipe(pipe, None, 0, None, ctypes.byref(count), None):
            if count.value or time.monotonic() > until:
                return count.value > 0
            time.sleep(0.001)
        return True


_open_channels: WeakSet[Channel] = WeakSet()


def close_channels() -> None:
    """Close all channels: in a copy of the process that opened them, where an FMU could write to them."""
    for channel in list(_open_channels):
        channel.close()
