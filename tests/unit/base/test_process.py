"""Child processes: messages, ends, what they leave, and pools of them."""

import os
import signal
import stat
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path

import psutil
import pytest

from emla_cosim.base.channel import Channel
from emla_cosim.base.process import (
    Child,
    ChildEndedError,
    ChildPool,
    limit_memory,
)
from tests.support.waiting import wait_for

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no `fork`.")
WAYS = pytest.mark.parametrize("fork", [True, False], ids=["fork", "interpreter"])


def _echo(channel: Channel, factor: int) -> None:
    for request in channel.requests():
        channel.send(factor * request)


@WAYS
def test_messages_of_any_size(fork: bool) -> None:
    with closing(Child(_echo, 2, fork=fork)) as child:
        for request in (21, b"x" * 3_000_000, ["a"]):
            child.send(request)
            assert child.receive() == 2 * request
        assert child.is_alive()
    assert not child.is_alive()


def _die(channel: Channel, number: int) -> None:
    channel.send("last")
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


@WAYS
@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGTERM])
def test_end_is_described_after_the_last_message(fork: bool, number: signal.Signals) -> None:
    with closing(Child(_die, number, fork=fork)) as child:
        assert child.receive() == "last"
        with pytest.raises(ChildEndedError, match=number.name):
            child.receive()
        with pytest.raises(ChildEndedError, match=number.name):
            child.send("anything")
        assert child.wait() == -number


def _leave_a_copy(channel: Channel) -> None:
    if os.fork() == 0:
        time.sleep(1000.0)  # it has the channel open
    os._exit(3)


@WAYS
def test_copy_with_an_open_channel_hides_no_end(fork: bool) -> None:
    with closing(Child(_leave_a_copy, fork=fork)) as child, pytest.raises(ChildEndedError, match="code 3"):
        child.receive(60.0)


def test_copy_with_an_open_channel_hides_no_end_from_short_waits() -> None:
    with closing(Child(_leave_a_copy, fork=True)) as child, pytest.raises(ChildEndedError, match="code 3"):
        for _ in range(100):
            with suppress(TimeoutError):
                child.receive_bytes(0.1)


def _write_another_object(channel: Channel) -> None:
    channel.send_bytes(b"not pickled")


def test_unreadable_object_is_reported_as_written_by_others() -> None:
    with (
        closing(Child(_write_another_object, fork=True)) as child,
        pytest.raises(ChildEndedError, match="something else wrote"),
    ):
        child.receive()


def _list_files() -> set[int]:
    return {int(path.name) for path in Path("/dev/fd").iterdir()}


def _write(channel: Channel, inherited: set[int], content: bytes) -> None:
    for number in _list_files() - inherited:
        with suppress(OSError):
            if stat.S_ISFIFO(os.fstat(number).st_mode):
                os.write(number, content)
    time.sleep(1000.0)


BEGUN = struct.pack("=8sQ", b"\x93emla\r\n\x1a", 1000)


@pytest.mark.skipif(not Path("/dev/fd").exists(), reason="Open files are not listed there.")
@pytest.mark.parametrize(
    ("content", "error"),
    [(b"x", TimeoutError), (BEGUN + b"x", TimeoutError), (b"a log message of an FMU", ChildEndedError)],
)
def test_what_an_fmu_writes_does_not_block_the_parent(content: bytes, error: type[Exception]) -> None:
    with closing(Child(_write, _list_files(), content, fork=True)) as child:
        start_time = time.monotonic()
        with pytest.raises(error):
            child.receive_bytes(0.5)
        assert time.monotonic() - start_time < 60.0


def _count_pipes(channel: Channel) -> None:
    channel.send(sum(path.is_fifo() for path in Path("/dev/fd").iterdir()))


@pytest.mark.skipif(sys.platform != "linux", reason="Open files are not listed there.")
def test_child_has_no_other_channel(tmp_path: Path) -> None:
    """An FMU in a copy of this process cannot write to the channels of this process."""
    with closing(Child(_count_pipes, fork=True)) as child:
        count = child.receive()
    with closing(Child(_echo, 2)), closing(Child(_count_pipes, fork=True)) as child:
        assert child.receive() == count


def _start_others(channel: Channel) -> None:
    child = Child(_echo, 2, fork=True)
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"])
    channel.send([os.getpid(), child._process.pid, process.pid])
    time.sleep(1000.0)


def _pass_on(channel: Channel, fork: bool) -> None:
    child = Child(_start_others, fork=fork)
    channel.send(child.receive())
    time.sleep(1000.0)


def _all_ended(pids: list[int]) -> bool:
    return not any(psutil.pid_exists(p) and psutil.Process(p).status() != "zombie" for p in pids)


@WAYS
@pytest.mark.parametrize("end", [Child.kill, Child.close])
def test_all_that_a_child_started_ends_with_it(fork: bool, end: Callable[[Child], None]) -> None:
    child = Child(_start_others, fork=fork)
    pids = child.receive()
    end(child)
    wait_for(lambda: _all_ended(pids), 60.0)
    child.close()


@WAYS
def test_child_ends_when_its_parent_is_killed(fork: bool) -> None:
    with closing(Child(_pass_on, fork)) as parent:
        pids = parent.receive()
        os.kill(psutil.Process(pids[0]).ppid(), signal.SIGKILL)
        wait_for(lambda: _all_ended(pids), 60.0)


def _need_memory(channel: Channel, limit: int) -> None:
    limit_memory(limit)
    try:
        bytearray(2 * limit)
    except MemoryError:
        channel.send("refused")


def test_memory_can_be_limited() -> None:
    with closing(Child(_need_memory, 2**28, fork=True)) as child:
        assert child.receive() == "refused"


@pytest.fixture
def pool() -> Iterator[ChildPool]:
    pool = ChildPool(lambda: Child(_echo, 2))
    yield pool
    pool.close()


def test_pool_replaces_members(pool: ChildPool) -> None:
    with pool.member() as first:
        first.send(1)
        assert first.receive() == 2
    with pool.member() as second:
        assert second is first
        second.kill()
        with pytest.raises(ChildEndedError, match="SIGKILL"):
            second.receive()
    with pool.member() as third:
        assert third is not first
        third.send(2)
        assert third.receive() == 4
        pool.close()
        assert not third.is_alive()
    with pool.member() as fourth, pytest.raises(ChildEndedError):
        fourth.receive()


def test_child_used_once_replaces_an_idle_one_and_ends() -> None:
    started = list[Child]()

    def start() -> Child:
        started.append(Child(_echo, 2, fork=True))
        return started[-1]

    pool = ChildPool(start, count=2)
    assert len(started) == 2
    with pool.member(use_once=True) as single_use:
        assert single_use is started[2]
        assert [child.is_alive() for child in started] == [True, False, True]
    assert not single_use.is_alive()
    started[0].kill()  # while it is idle
    with pool.member() as member:
        assert member is started[3]
    pool.close(timeout=5.0)
    assert not any(child.is_alive() for child in started)


def test_start_from_a_script_without_a_guard(tmp_path: Path) -> None:
    """A fresh interpreter does not run the script again."""
    script = tmp_path / "script.py"
    script.write_text(
        "from emla_cosim.base.process import Child, silence\n"
        "child = Child(silence)\nprint('once')\nchild.close()"
    )
    process = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert process.stdout == "once\n"
