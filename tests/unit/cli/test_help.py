"""The help of the commands: no word is cut at any width, and examples parse."""

import re
import shlex
from importlib import import_module

import pytest
from click.testing import CliRunner

from emla_cosim.cli.app import COMMANDS, app, load_command
from emla_cosim.run.options import list_options


def help_text(*arguments: str, columns: int = 80) -> str:
    result = CliRunner().invoke(app, [*arguments, "--help"], terminal_width=columns)
    assert result.exit_code == 0, result.output
    return result.stdout


def words(text: str) -> list[str]:
    return text.replace("\\\n", "").split()


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_examples_that_parse(command: str) -> None:
    text = " ".join(words(help_text(command)))
    assert "Without: " not in text and "; without, " not in text
    examples = getattr(import_module(f"emla_cosim.cli.commands.{command}"), "EXAMPLES", ())
    assert examples or command in ("list", "info", "plot")
    for example in examples:
        assert example in text
        program, name, *arguments = shlex.split(example)
        assert (program, name) == ("emla", command)
        assert load_command(name).make_context(name, arguments) is not None


@pytest.mark.parametrize("command", COMMANDS)
def test_no_width_cuts_a_word(command: str) -> None:
    wide = help_text(command, columns=1000)
    for columns in (60, 80, 120):
        narrow = help_text(command, columns=columns)
        assert words(narrow) == words(wide)
        assert max(map(len, narrow.splitlines())) <= columns


def test_each_option_has_a_line_with_its_placeholder() -> None:
    lines = [line.strip() for line in help_text("run").splitlines()]
    for option in list_options("run").values():
        assert " ".join((", ".join(option.flags), option.placeholder)).strip() in lines


def test_common_options_come_first() -> None:
    text = help_text("run")
    groups = re.findall(r"^(\S.*):\n  (\S+)", text, re.MULTILINE)
    assert groups == [
        ("Arguments", "SCENARIO"),
        ("What is run", "--set"),
        ("How it is stepped", "--stop-time"),
        ("What comes out", "--output"),
        ("Options", "--quiet,"),
        ("Examples", "emla"),
    ]


def test_titles_are_bold_on_terminals_with_color(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[1mOptions:" in CliRunner().invoke(app, ["list", "--help"], color=True).stdout
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in CliRunner().invoke(app, ["list", "--help"], color=True).stdout
