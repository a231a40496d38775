"""What a command line means: flags with and without values, repeated options, empty and negative values."""

import shlex
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from emla_cosim.base.errors import CommandError
from emla_cosim.cli.app import app, load_command
from emla_cosim.cli.parameters import read_values
from emla_cosim.run.options import list_options
from tests.support.commands import Emla, sentence


def read(line: str) -> dict[str, Any]:
    """Return the values of the options that a command line has, by name."""
    name, *arguments = shlex.split(line)
    context = load_command(name).make_context(name, arguments)
    return read_values(list_options(name).values(), context.params)


@pytest.mark.parametrize(
    ("line", "values"),
    [
        ("run lift", {}),
        ("run lift --plots", {"plots": True}),
        ("run lift --no-plots", {"plots": False}),
        ("run lift --no-plots --plots", {"plots": True}),
        (
            "run lift --no-together --no-coupling-estimate",
            {"integrate_together": False, "estimate_coupling": False},
        ),
        ("run lift --isolate", {"isolate": ["*"]}),
        ("run lift --isolate --no-plots", {"isolate": ["*"], "plots": False}),
        ("run lift --isolate --isolate lift.plant", {"isolate": ["*", "lift.plant"]}),
        ("run lift --isolate=lift.plant", {"isolate": ["lift.plant"]}),
        ("run lift --isolate ''", {"isolate": [""]}),
        ("run lift --no-event-mode --stop-time 1", {"no_event_mode": ["*"], "stop_time": 1.0}),
        ("run --isolate -- lift", {"isolate": ["*"]}),
        ("run lift --stop-time -1", {"stop_time": -1.0}),
        ("run lift --stop-time=-1", {"stop_time": -1.0}),
        ("run lift --stop-time '10 ms'", {"stop_time": 0.01}),
        ("run lift --fmi-tolerance 1e-3", {"fmi_tolerance": 1e-3}),
        ("run lift --realtime -1", {"real_time": -1.0}),
        ("run lift --set a.b=-1 --set 'a.c=2 kN'", {"set": {"a.b": "-1", "a.c": "2 kN"}}),
        ("run lift --set a.b=1 --set a.b=2", {"set": {"a.b": "2"}}),
        ("run lift --set 'a.b=[1, [2 kN]]'", {"set": {"a.b": ["1", ["2 kN"]]}}),
        ("run lift --set 'a.b = x=y'", {"set": {"a.b": "x=y"}}),
        ("run lift --step-multiple a.b=5", {"step_multiples": {"a.b": 5}}),
        ("run lift --output a/b", {"output": Path("a/b")}),
        ("run lift --output ''", {"output": Path()}),
        ("run lift --threads auto", {"threads": None}),
        ("run lift --threads 2 --threads 3", {"threads": 3}),
        ("run lift --bond 'l*' --bond 'a = b.F * c.v'", {"bonds": {"l*": "", "a": "b.F * c.v"}}),
        ("run lift --kind me --kind a=cs", {"kind": {"*": "me", "a": "cs"}}),
        ("run lift --order a,b", {"order": ["a", "b"]}),
        ("run lift --signals a --signals b", {"signals": ["a", "b"]}),
        ("run lift --parameters a.ssv", {"parameters": [Path("a.ssv")]}),
        ("run lift --replace a=b.fmu", {"replace": {"a": "b.fmu"}}),
        ("run lift --mapping a=b.ssm", {"mapping": {"a": Path("b.ssm")}}),
        ("run lift --criterion a.b=1mm", {"criteria": {"a.b": "1mm"}}),
        ("export lift a.fmu --fmi 3 --platform win64", {"fmi": 3, "platform": ["win64"]}),
    ],
)  # fmt: skip
def test_values_of_options(line: str, values: dict[str, Any]) -> None:
    assert read(line) == values


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("run lift --set ''", "--set '' has no name or no value; write --set NAME=VALUE."),
        ("run lift --set a=", "--set a= has no name or no value; write --set NAME=VALUE."),
        (
            "run lift --set a=[1,[2]",
            "--set a=[1,[2] is not a list; write [1,2], or [[1,2],[3,4]] for a matrix.",
        ),
        (
            "run lift --stop-time ''",
            "--stop-time is ''; it must be a number, or a number and a unit such as 30 kN.",
        ),
        (
            "run lift --stop-time nan",
            "--stop-time is 'nan'; it must be a number, or a number and a unit such as 30 kN.",
        ),
        ("run lift --fmi-tolerance x", "--fmi-tolerance x is not a number."),
        ("run lift --step-multiple a=2.5", "--step-multiple a=2.5 is not a whole number."),
        ("run lift --threads x", "--threads x is neither a whole number nor auto."),
        ("export lift a.fmu --fmi x", "--fmi x is not a whole number."),
    ],
)  # fmt: skip
def test_texts_that_are_no_values(line: str, message: str) -> None:
    with pytest.raises(CommandError) as caught:
        read(line)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("rnu", "there is no command 'rnu'; did you mean run"),
        ("run lift --stop-tme 1", "there is no option '--stop-tme'; did you mean --stop-time"),
        ("run lift --nonsense", "there is no option '--nonsense'"),
        ("run lift -x", "there is no option '-x'. See `emla run --help`."),
        ("--nope", "there is no option '--nope'. See `emla --help`."),
        ("run", "Missing argument 'SCENARIO'"),
        ("run --isolate lift", "Missing argument 'SCENARIO'"),
        ("export lift", "Missing argument 'FILE.ssp|FILE.fmu|FILE.c'"),
        ("run lift extra", "unexpected extra argument (extra)"),
        ("run lift -- --quiet", "unexpected extra argument (--quiet)"),
        ("list x", "unexpected extra argument (x)"),
        ("run lift --stop-time", "'--stop-time' requires an argument"),
        ("run lift --no-plots=1", "'--no-plots' does not take a value"),
        ("run -- --help", "there is no scenario '--help'"),
        ("sweep lift --vary a", "--vary a has no name or no values"),
        ("sweep lift --runs 1.5", "--runs 1.5 is not a whole number."),
        ("sweep lift --vary a=1 --vary a=2", "--vary names a twice."),
        ("compare lift --reserves 1,x", "the reserves are '1,x'; they must be two numbers"),
        ("build Reference --clock x", "--clock is 'x'; it must be a number"),
        ("verify --excite x", "there is no shape 'x'; choose from steps"),
        ("size lift --life 20000", "--life 20000 has no unit; write '20000 h' or '20000 s'."),
        ("size lift --ambient 40", "--ambient 40 has no unit"),
        ("trajectory --set a", "--set a has no name or no value"),
        ("linearize lift --at ''", "--at is ''; it must be a number"),
        ("plot", "Missing argument 'RUN...'"),
    ],
)  # fmt: skip
def test_wrong_command_lines(line: str, words: str) -> None:
    assert words in sentence(CliRunner().invoke(app, shlex.split(line)), 2)


def test_command_alone_shows_its_help() -> None:
    result = CliRunner().invoke(app, [])
    assert result.exit_code == 2 and result.stdout.startswith("Usage: emla [OPTIONS] COMMAND")


def test_json_without_a_file_is_shown(emla: Emla, tmp_path: Path) -> None:
    output = emla("info", "lift", "--json", "-q").stdout
    assert emla("info", "lift", "--json", "-").stdout == output
    assert output.startswith("{") and list(tmp_path.iterdir()) == []
    assert emla("info", "--json", "a.json", "lift").stdout == ""
    assert (tmp_path / "a.json").read_text(encoding="utf-8") == output
