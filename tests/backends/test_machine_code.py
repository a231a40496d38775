"""Machine code is compiled once, and again where what was kept does not serve."""

import ctypes
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from emla_cosim.master.stepping import machine_code
from emla_cosim.sandbox.interruption import raise_on_interrupt

TRIPLE = """
define i64 @triple(i64 %x) {
  %y = mul i64 %x, 3
  ret i64 %y
}
"""

Load = Callable[..., int]


@pytest.fixture
def triple(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Load the function from a cache of its own, call it, and say how often it has been compiled so far."""
    monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path / "cache"))
    compiled = []

    def generate() -> str:
        compiled.append(1)
        return TRIPLE

    def call(source: bytes = b"x * 3") -> int:
        address = machine_code.load("triple", source, generate)
        function = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(address)
        assert (function(7), function(-2)) == (21, -6)
        return len(compiled)

    return call


def test_code_is_compiled_once_for_a_source_and_a_processor(
    triple: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert [triple(), triple(), triple(b"3 * x"), triple(b"3 * x"), triple()] == [1, 1, 2, 2, 2]
    monkeypatch.setattr(machine_code, "_features", lambda: "")
    assert triple() == 3


@pytest.mark.parametrize("damage", [lambda x: x[:-1], lambda x: x[:-1] + bytes([x[-1] ^ 1])])
def test_damaged_code_is_compiled_again(
    damage: Callable[[bytes], bytes], triple: Load, tmp_path: Path
) -> None:
    assert triple() == 1
    (path,) = [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    path.write_bytes(damage(path.read_bytes()))
    assert [triple(), triple()] == [2, 2]


def test_code_is_compiled_every_time_without_a_place_to_keep_it(triple: Load, tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("no folder")
    assert [triple(), triple()] == [1, 2]


def test_ctrl_c_ends_it_once_code_is_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not before: where LLVM calls Python it would be lost, with a traceback."""
    monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path / "cache"))
    done = []

    def generate() -> str:
        signal.raise_signal(signal.SIGINT)
        done.append(1)
        return TRIPLE

    with raise_on_interrupt(), pytest.raises(KeyboardInterrupt):
        machine_code.load("triple", b"x * 3", generate)
    assert done == [1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
