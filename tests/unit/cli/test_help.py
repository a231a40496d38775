"""The help of the commands: what a stranger reads, and examples that are such commands."""

import re
import shlex
from importlib import import_module
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from emla_cosim.base.option import RUN
from emla_cosim.cli.app import COMMANDS, app
from emla_cosim.run.options import list_options


def told(*arguments: str) -> str:
    """The help in one line, without frames."""
    result = CliRunner().invoke(app, [*arguments, "--help"])
    assert result.exit_code == 0, result.output
    return re.sub(r"[\s│]+", " ", result.stdout)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_speaks_plainly_and_shows_examples(command: str) -> None:
    text = told(command)
    assert "Without: " not in text and "; without, " not in text
    examples = getattr(import_module(f"emla_cosim.cli.commands.{command}"), "EXAMPLES", ())
    assert examples or command in ("list", "info", "plot")
    for example in examples:
        assert example in text


@pytest.mark.parametrize("command", COMMANDS)
def test_examples_are_commands_that_can_be_given(command: str) -> None:
    """Their options are there, and their values are read."""
    for example in getattr(import_module(f"emla_cosim.cli.commands.{command}"), "EXAMPLES", ()):
        program, name, *arguments = shlex.split(example)
        assert (program, name) == ("emla", command)
        group: Any = get_command(app)
        assert group.get_command(None, name).make_context(name, arguments) is not None


def test_help_tells_choices_defaults_and_units() -> None:
    text = told("run")
    assert "One of jacobi, gauss-seidel, strong. Default: gauss-seidel." in text
    assert "TIME" in text and "In s, or with a unit" in text
    for option in list_options(RUN).values():
        assert option.flag in text
