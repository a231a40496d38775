"""Requests and answers between two processes, through a pipe each way."""

import pickle
import struct
from typing import IO, Any, NamedTuple

_LENGTH = struct.Struct("=Q")
_BLOCK = 2**16


class Request(NamedTuple):
    """What an isolated slave is asked to do: first to set inputs and their slopes, then a call by name."""

    call: str
    arguments: tuple[Any, ...]
    inputs: bytes | None = None
    slopes: bytes | None = None


class Channel:
    """Sends and receives objects; both ends are ours, and trust each other."""

    def __init__(self, incoming: IO[bytes] | None, outgoing: IO[bytes] | None) -> None:
        """Take unbuffered streams."""
        assert incoming is not None
        assert outgoing is not None
        self._incoming, self._outgoing = incoming, outgoing
        self._ahead = b""

    def send(self, content: Any) -> None:
        """Send one object; OSError where nobody listens any more."""
        text = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
        left = memoryview(_LENGTH.pack(len(text)) + text)
        while left:
            left = left[self._outgoing.write(left) :]

    def receive(self) -> Any:
        """Wait for one object; EOFError where nobody will send any."""
        (length,) = _LENGTH.unpack(self._read(_LENGTH.size))
        return pickle.loads(self._read(length))

    def close(self) -> None:
        """Let the other end know that nothing more will come."""
        for stream in (self._outgoing, self._incoming):
            try:
                stream.close()
            except OSError:
                continue

    def _read(self, count: int) -> bytes:
        found = self._ahead
        while len(found) < count:
            block = self._incoming.read(max(count - len(found), _BLOCK))  # what there is, mostly all of it
            if not block:
                raise EOFError
            found += block
        self._ahead = found[count:]
        return found[:count]
