"""What a test does depends neither on the machine nor on how and where the suite was started."""

import ast
import importlib.util
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.paths import ROOT

same = pytest.mark.skipif(
    not settings.default.derandomize, reason="The chosen hypothesis profile draws new examples on purpose."
)


def drawn() -> list[tuple[float, str]]:
    """Examples of a property, in their order."""
    found = []

    @settings(max_examples=100)
    @given(st.floats(allow_nan=False), st.text())
    def take(number: float, text: str) -> None:
        found.append((number, text))

    take()
    return found


@same
def test_examples_are_the_same_whatever_modules_are_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hypothesis draws constants that it finds in a project's modules."""
    before = drawn()
    (tmp_path / "constants.py").write_text(f"NUMBERS = {[i + 0.123 for i in range(500)]}\nTEXT = 'lift'\n")
    spec = importlib.util.spec_from_file_location("constants", tmp_path / "constants.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(sys.modules, "constants", module)
    assert drawn() == before


@same
def test_examples_do_not_come_from_earlier_runs_and_no_property_has_a_deadline() -> None:
    assert settings.default.database is None
    assert settings.default.deadline is None


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no jobs that ignore SIGINT.")
def test_ctrl_c_ends_processes_of_a_suite_that_runs_in_the_background(tmp_path: Path) -> None:
    """A shell starts background jobs with SIGINT ignored, and processes inherit that."""
    wait = "import time; print(flush=True); time.sleep(60.0)"
    suite = (
        "import signal, subprocess, sys\n"
        "from tests.support.deterministic import heed_ctrl_c\n"
        "assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN\n"
        "heed_ctrl_c()\n"
        "assert signal.getsignal(signal.SIGINT) is signal.default_int_handler\n"
        f"child = subprocess.Popen([sys.executable, '-c', {wait!r}], stdout=subprocess.PIPE)\n"
        "child.stdout.readline()\n"
        "child.send_signal(signal.SIGINT)\n"
        "sys.exit(child.wait(30.0) != -signal.SIGINT)\n"
    )
    command = [sys.executable, "-c", suite]
    ignoring = lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)  # noqa: E731
    done = subprocess.run(command, cwd=ROOT, stderr=subprocess.PIPE, preexec_fn=ignoring, text=True)
    assert done.returncode == 0, done.stderr


def reasons(file: Path) -> Iterator[tuple[int, str]]:
    """Lines that skip tests, and the reasons; an empty one where pytest would make one up."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        name = ast.unparse(node.func)
        if name in ("pytest.skip", "pytest.mark.skip", "pytest.mark.skipif", "pytest.importorskip"):
            named = [k.value for k in node.keywords if k.arg == "reason"]
            found = named or (node.args[:1] if name.endswith(".skip") else [])
            yield node.lineno, found[0].value if found and isinstance(found[0], ast.Constant) else ""


def test_every_reason_to_skip_is_a_sentence() -> None:
    found = {
        f"{file}:{line}": text
        for file in sorted((ROOT / "tests").rglob("*.py"))
        for line, text in reasons(file)
    }
    assert len(found) > 30
    assert [place for place, text in found.items() if not re.fullmatch(r"\S.*\.", text)] == []
