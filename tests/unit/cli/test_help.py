"""The help of the commands: plain words, defaults and units, and examples that parse."""

import re
import shlex
from importlib import import_module
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from emla_cosim.cli.app import COMMANDS, app


def help_text(*arguments: str) -> str:
    """Return the help in one line, without frames."""
    result = CliRunner().invoke(app, [*arguments, "--help"])
    assert result.exit_code == 0, result.output
    return re.sub(r"[\s│]+", " ", result.stdout)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_examples_that_parse(command: str) -> None:
    text = help_text(command)
    assert "Without: " not in text and "; without, " not in text
    examples = getattr(import_module(f"emla_cosim.cli.commands.{command}"), "EXAMPLES", ())
    assert examples or command in ("list", "info", "plot")
    for example in examples:
        assert example in text
        program, name, *arguments = shlex.split(example)
        assert (program, name) == ("emla", command)
        group: Any = get_command(app)
        assert group.get_command(None, name).make_context(name, arguments) is not None
