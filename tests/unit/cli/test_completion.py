"""Shell completion: what bash, zsh and fish get, and the installation of the script that asks for it."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from emla_cosim.base.option import RUN
from emla_cosim.cli.app import app
from emla_cosim.cli.completion import VARIABLE, answer
from emla_cosim.run.options import list_options
from emla_cosim.run.scenarios.scenario_file import SCENARIOS
from emla_cosim.study.registration import register

CALLED_FROM = """
import psutil
psutil.Process.parents = lambda _: [type("Caller", (), {{"name": lambda _: "{}"}})()]
"""
PROGRAM = "import sys; sys.argv[0] = 'emla'; from emla_cosim.cli.program import main; main()"

Complete = Callable[..., list[str]]


@pytest.fixture
def complete(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Complete:
    """Return a function that asks, in this process, how the last word of a line can be completed."""

    def ask(line: str, shell: str = "bash") -> list[str]:
        words = line.split(" ")
        place = words[-1] if shell == "fish" else str(len(words) - 1)
        variables = {"COMP_WORDS": line, "COMP_CWORD": place}
        for name, value in {VARIABLE: f"{shell}_complete", **variables}.items():
            monkeypatch.setenv(name, value)
        with pytest.raises(SystemExit):
            answer(app)
        captured = capsys.readouterr()
        assert captured.err == ""
        return captured.out.removesuffix("\n").split("\n")

    return ask


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("emla r", ["run", "rerun", "repair"]),
        ("emla -q run til", ["tilt"]),
        ("emla sweep study-r", ["study-robustness"]),
        ("emla build EmlaP", ["EmlaPlant"]),
        ("emla run lift --algorithm gauss", ["gauss-seidel"]),
        ("emla run lift --controller f", ["foc"]),
        ("emla run lift --gains pub", ["published"]),
        ("emla run lift --extrapolation m", ["master"]),
        ("emla run lift --set=", []),
        ("emla --inst", ["--install-completion"]),
    ],
)
def test_names_complete(line: str, expected: list[str], complete: Complete) -> None:
    register()
    assert [item.partition(",")[2] for item in complete(line) if item.startswith("plain,")] == expected


@pytest.mark.parametrize(
    "line",
    ["emla run lift --output ", "emla plot ", "emla run mine.t", "emla verify lift.fmu a", "emla repair l"],
)
def test_the_shell_completes_files(line: str, complete: Complete) -> None:
    assert complete(line) == [f"file,{line.rpartition(' ')[2]}"]


def test_scenarios_and_options_complete(complete: Complete) -> None:
    register()
    assert set(complete("emla run ")) == {f"plain,{name}" for name in SCENARIOS}
    flags = {item.removeprefix("plain,") for item in complete("emla run lift --")}
    assert {item.removeprefix("plain,") for item in complete("emla run --")} == flags
    assert {o.flag for o in list_options(RUN).values()} <= flags and "--quiet" in flags


def test_zsh_and_fish(complete: Complete) -> None:
    assert complete("emla run til", "zsh") == ["plain", "tilt", "_"]
    assert complete("emla run til", "fish") == ["plain,tilt"]


# ---- the program -------------------------------------------------------------------------------------


def emla(*arguments: str, program: str = PROGRAM, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own with these variables."""
    around = {**os.environ, **environment}
    return subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False, env=around
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "environment",
    [
        {VARIABLE: "bash_complete", "COMP_WORDS": "emla 'run", "COMP_CWORD": "x"},
        {VARIABLE: "tcsh_complete"},
        {VARIABLE: ""},
        {VARIABLE: "bash_complete", "COMP_WORDS": "emla nope --x", "COMP_CWORD": "9"},
    ],
)
def test_invalid_requests_give_no_traceback(environment: dict[str, str]) -> None:
    assert "Traceback" not in emla(**environment).stderr


@pytest.mark.slow
def test_installed_script_completes_in_bash(tmp_path: Path) -> None:
    called = CALLED_FROM.format("bash") + PROGRAM
    ended = emla("--install-completion", program=called, HOME=str(tmp_path), SHELL="/bin/bash")
    assert ended.returncode == 0 and str(tmp_path) in ended.stdout
    script = tmp_path / ".bash_completions/emla.sh"
    assert str(script) in (tmp_path / ".bashrc").read_text()
    message = emla("--show-completion", program=called, SHELL="/bin/bash").stdout
    assert script.read_text().strip() == message.strip()
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("There is no bash on this machine.")
    program = tmp_path / "emla"
    program.write_text(f"#!{sys.executable}\n{PROGRAM}\n")
    program.chmod(0o755)
    asking = f"source {script}; COMP_WORDS=(emla run tele); COMP_CWORD=2; _emla_completion {program}; "
    result = subprocess.run(
        [bash, "--norc", "-c", asking + 'echo "${COMPREPLY[@]}"'], capture_output=True, text=True, check=True
    )
    assert result.stdout == "telescope\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("home", "shell", "reason"),
    [
        ("/dev/null", "bash", "cannot install completion for bash"),
        ("/tmp", "none", "supported shells: bash"),
    ],
)
def test_failed_installation_gives_one_message(home: str, shell: str, reason: str) -> None:
    called = CALLED_FROM.format(shell) + PROGRAM
    ended = emla("--install-completion", program=called, HOME=home, SHELL=f"/bin/{shell}")
    assert ended.returncode == 1
    assert ended.stderr.startswith("Error: ") and len(ended.stderr.splitlines()) == 1
    assert reason in ended.stderr
