"""What shells are told to complete: as bash, zsh and fish ask, and how they come to ask."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from emla_cosim.base.option import RUN
from emla_cosim.run.options import list_options
from emla_cosim.run.scenarios.built_in import SCENARIOS
from emla_cosim.study.registration import register

CALLED_FROM = "import shellingham; shellingham.detect_shell = lambda: ('{}', ''); "
PROGRAM = "import sys; sys.argv[0] = 'emla'; from emla_cosim.cli.program import main; main()"


def emla(*arguments: str, **environment: str | None) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, with these variables, or without those that are None."""
    around = {**os.environ, **{n: v for n, v in environment.items() if v is not None}}
    for name in (n for n, v in environment.items() if v is None):
        around.pop(name, None)
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=False, env=around
    )


def completed(line: str, shell: str = "bash") -> list[str]:
    """What completes the last word of a line."""
    if shell == "bash":
        words = line.split(" ")
        asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    else:
        asked = {"_TYPER_COMPLETE_ARGS": line, "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    ended = emla(_EMLA_COMPLETE=f"complete_{shell}", **asked)
    assert ended.stderr == ""
    return ended.stdout.split("\n")[:-1] if ended.stdout else []


def test_commands_and_scenarios_complete() -> None:
    register()
    assert completed("emla r") == ["run", "rerun"]
    assert set(completed("emla run ")) == set(SCENARIOS)
    assert completed("emla -q run lif") == ["lift"]
    assert completed("emla sweep study-r") == ["study-robustness"]


def test_options_and_their_choices_complete() -> None:
    flags = set(completed("emla run lift --"))
    assert {o.flag for o in list_options(RUN).values()} <= flags and "--quiet" in flags
    assert completed("emla run lift --algorithm gauss") == ["gauss-seidel"]
    assert completed("emla run lift --output ") == [""], "the shell offers files"


def test_zsh_and_fish_ask_in_their_own_ways() -> None:
    assert '"lift"' in "".join(completed("emla run lif", "zsh"))
    assert completed("emla run lif", "fish") == ["lift"]


@pytest.mark.parametrize(
    "asked",
    [
        {"_EMLA_COMPLETE": "complete_bash"},
        {"_EMLA_COMPLETE": "complete_bash", "COMP_WORDS": "emla 'run", "COMP_CWORD": "x"},
        {"_EMLA_COMPLETE": "complete_tcsh"},
        {"_EMLA_COMPLETE": ""},
        {"_EMLA_COMPLETE": "complete_bash", "COMP_WORDS": "emla nope --x", "COMP_CWORD": "9"},
    ],
)
def test_a_shell_that_asks_nonsense_gets_no_traceback(asked: dict[str, str]) -> None:
    assert "Traceback" not in emla(**asked).stderr


def test_completion_is_installed_in_the_users_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bash itself, with what was installed, completes a command."""
    monkeypatch.setitem(globals(), "PROGRAM", CALLED_FROM.format("bash") + PROGRAM)
    ended = emla("--install-completion", HOME=str(tmp_path), SHELL="/bin/bash")
    assert ended.returncode == 0 and str(tmp_path) in ended.stdout
    script = tmp_path / ".bash_completions/emla.sh"
    assert str(script) in (tmp_path / ".bashrc").read_text()
    assert script.read_text().strip() == emla("--show-completion", SHELL="/bin/bash").stdout.strip()
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("There is no bash on this machine.")
    program = tmp_path / "emla"
    program.write_text(f"#!{sys.executable}\n{PROGRAM}\n")
    program.chmod(0o755)
    asking = f"source {script}; COMP_WORDS=(emla run lif); COMP_CWORD=2; _emla_completion {program}; "
    found = subprocess.run(
        [bash, "--norc", "-c", asking + 'echo "${COMPREPLY[@]}"'], capture_output=True, text=True, check=True
    )
    assert found.stdout == "lift\n"


@pytest.mark.parametrize(
    ("home", "shell", "reason"),
    [
        ("/dev/null", "/bin/bash", "cannot install completion for bash"),
        ("/proc/none", "/bin/zsh", "cannot install completion for "),
        ("/tmp", "/bin/none", "supported shells: bash"),
    ],
)
def test_what_keeps_it_from_being_installed_is_told_in_one_sentence(
    home: str, shell: str, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shell that calls is not looked for here: it may be any."""
    monkeypatch.setitem(globals(), "PROGRAM", CALLED_FROM.format(Path(shell).name) + PROGRAM)
    ended = emla("--install-completion", HOME=home, SHELL=shell)
    assert ended.returncode == 1
    assert ended.stderr.startswith("Error: ") and len(ended.stderr.splitlines()) == 1
    assert reason in ended.stderr
