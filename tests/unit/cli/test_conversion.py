"""Values of the command line are converted late, to the same values and messages as by typer."""

from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

import pytest
import typer
from typer.core import TyperCommand
from typer.testing import CliRunner

from emla_cosim.cli.conversion import PlainCommand

ARGUMENTS = (
    ["word"],
    ["", "--text", "", "--texts", "", "--number", " 3 "],
    ["ä", "--text=x", "--texts", "a", "--texts=b", "--path", "a/b", "--paths", "c", "--paths", "d"],
    ["x", "--flag", "--number", "1e2", "--whole", "7", "--shouted", "loud"],
    ["x", "--no-flag"],
    ["x", "--number", "many"],
    ["x", "--whole", "1.5"],
    ["x", "--text"],
    ["x", "y"],
    [],
    ["--help"],
)


def run(kind: type[TyperCommand], arguments: list[str]) -> tuple[int, str, list[Any]]:
    app, found = typer.Typer(add_completion=False, pretty_exceptions_enable=False), list[Any]()

    @app.command(cls=kind)
    def command(
        argument: Annotated[str, typer.Argument(help="A word.")],
        text: str | None = None,
        texts: list[str] | None = None,
        shouted: Annotated[str | None, typer.Option(parser=str.upper)] = None,
        path: Path | None = None,
        paths: list[Path] | None = None,
        number: float | None = None,
        whole: int | None = None,
        flag: bool | None = None,
    ) -> None:
        found.extend([argument, text, texts, shouted, path, paths, number, whole, flag])

    result = CliRunner().invoke(app, arguments)
    return result.exit_code, result.output, found


@pytest.mark.parametrize("arguments", ARGUMENTS)
def test_values_and_messages_are_those_of_typer(arguments: list[str]) -> None:
    assert run(PlainCommand, arguments) == run(TyperCommand, arguments)


def test_parameters_of_other_typer_releases_are_not_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    others = [SimpleNamespace(), SimpleNamespace(get_runtime_param=int), SimpleNamespace(type_descriptor=int)]
    before = [dict(vars(one)) for one in others]
    monkeypatch.setattr(TyperCommand, "get_params", lambda self, ctx: others)
    assert PlainCommand("command").get_params(None) is others
    assert [vars(one) for one in others] == before
