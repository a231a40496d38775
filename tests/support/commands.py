"""The `emla` command in the test's process, and what it says when it fails."""

from collections.abc import Callable

import pytest
from click.testing import Result

from emla_cosim.views.terminal import ERR, OUT

Emla = Callable[..., Result]


def widen_terminal(monkeypatch: pytest.MonkeyPatch, columns: int = 100) -> None:
    """Make the terminal so wide that no table is folded, whatever it was when it was first used."""
    monkeypatch.setenv("COLUMNS", str(columns))
    for console in (OUT, ERR):
        monkeypatch.setattr(console, "width", columns)


def sentence(result: Result, exit_code: int) -> str:
    """Return the one error message of a command that failed with this exit code, and no traceback."""
    assert result.exit_code == exit_code, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    lines = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert len(lines) == 1, result.stderr
    return lines[0]
