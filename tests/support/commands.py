"""The `emla` command in the test's process, and what it says when it fails."""

from collections.abc import Callable

from typer.testing import Result

Emla = Callable[..., Result]


def sentence(result: Result, exit_code: int) -> str:
    """The one sentence of a command that failed with this exit code, and no traceback."""
    assert result.exit_code == exit_code, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    lines = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert len(lines) == 1, result.stderr
    return lines[0]
