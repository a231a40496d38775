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


def kept(folder: Path) -> list[Path]:
    return [path for path in (folder / "cache").rglob("*") if path.is_file()]


def test_code_is_compiled_once_for_a_source(triple: Load, tmp_path: Path) -> None:
    assert [triple(), triple(), triple(b"3 * x"), triple(b"3 * x"), triple()] == [1, 1, 2, 2, 2]
    assert len(kept(tmp_path)) == 2


def test_another_processor_gets_code_of_its_own(triple: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    assert triple() == 1
    monkeypatch.setattr(machine_code, "_features", lambda: "")
    assert triple() == 2


@pytest.mark.parametrize("damage", [lambda x: b"", lambda x: x[:-1], lambda x: x[:-1] + bytes([x[-1] ^ 1])])
def test_damaged_code_is_compiled_again(
    damage: Callable[[bytes], bytes], triple: Load, tmp_path: Path
) -> None:
    assert triple() == 1
    (path,) = kept(tmp_path)
    path.write_bytes(damage(path.read_bytes()))
    assert [triple(), triple()] == [2, 2]


def test_without_a_place_to_keep_it_code_is_compiled_every_time(triple: Load, tmp_path: Path) -> None:
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


def test_code_that_needs_a_runtime_is_refused(triple: Load) -> None:
    text = (
        "declare i64 @runtime(i64)\ndefine i64 @f(i64 %x) {\n %y = call i64 @runtime(i64 %x)\n ret i64 %y\n}"
    )
    with pytest.raises(RuntimeError, match="would call runtime"):
        machine_code.load("f", b"f", lambda: text)
