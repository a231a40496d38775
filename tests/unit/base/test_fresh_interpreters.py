"""Children that are fresh interpreters, the only ones on Windows."""

import subprocess
import sys
from contextlib import closing
from threading import Thread
from types import SimpleNamespace

import pytest

from emla_cosim.base import process
from emla_cosim.base.channel import Channel
from emla_cosim.base.process import Child, ChildEndedError


def _echo(channel: Channel, factor: int) -> None:
    for request in channel.requests():
        channel.send(factor * request)


def test_messages_and_ends() -> None:
    with closing(Child(_echo, 2)) as child:
        for request in (21, b"x" * 3_000_000, "a\r\n\x1a"):
            child.send(request)
            assert child.receive(60.0) == 2 * request
        with pytest.raises(TimeoutError):
            child.receive(0.1)
        child.kill()
        with pytest.raises(ChildEndedError):
            child.receive()


def test_wait_on_windows_for_a_process_that_is_not_the_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    """The interpreter of a virtual environment there is the child of a launcher."""
    monkeypatch.setattr(process, "sys", SimpleNamespace(platform="win32"))
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        waiting = Thread(target=process._wait_for_end, args=(other.pid,))
        waiting.start()
        waiting.join(0.3)
        assert waiting.is_alive()
        other.communicate(b"\n")
        waiting.join(60.0)
        assert not waiting.is_alive()
