"""Shell completion of `emla` commands, and its installation."""

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib.resources import files
from pathlib import Path

import click
from click.shell_completion import CompletionItem, get_completion_class

from fmublock.files import write_atomically

PROGRAM, VARIABLE = "emla", "_EMLA_COMPLETE"
"""Program to complete, and the environment variable that a shell sets to ask for completions."""

SHELLS = ("bash", "zsh", "fish")


def answer(app: click.Command) -> None:
    """Print the completions of the command line in the environment."""
    try:
        app(prog_name=PROGRAM)
    except Exception:  # an error message would disturb the line that the user types
        raise SystemExit(1) from None


def complete_value(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return completions of the value of a parameter: names, or that the shell is to complete files."""
    option = getattr(parameter, "option", None)
    choices = option.choices if option is not None else None
    return _match(choices or _NAMES.get(str(parameter.name), tuple), incomplete)


def complete_first_argument(command: str, incomplete: str) -> list[CompletionItem] | None:
    """Return completions of the first argument, or None if that needs an import of the command."""
    names = _FIRST_ARGUMENTS.get(command)
    return None if names is None else _match(names, incomplete)


def _match(names: Callable[[], Iterable[object]], incomplete: str) -> list[CompletionItem]:
    """Return the names that begin with a text; without any, the shell is to complete files."""
    matches = [CompletionItem(n) for n in map(str, names()) if n.startswith(incomplete)]
    return matches or [CompletionItem(incomplete, type="file")]


def _list_scenarios() -> Iterable[str]:
    # hdrm has one scenario for each mode
    machines = (name for name in _list_study_files("machines") if name != "hdrm")
    return sorted([*_list_study_files("scenarios"), *_list_study_files("joints"), *machines])


def _list_plans() -> Iterable[str]:
    return [*_list_scenarios(), *_list_study_files("plans")]


def _list_study_files(folder: str) -> Iterable[str]:
    """Return the names of the study's files in a folder, without loading them."""
    paths = files("emla_cosim").joinpath("study", folder).iterdir()
    return sorted(p.name.removesuffix(".toml") for p in paths if p.name.endswith(".toml"))


def _list_controllers() -> Iterable[str]:
    from ..study.controllers import CONTROLLERS

    return CONTROLLERS


def _list_gains() -> Iterable[str]:
    from ..study.controllers import CONTROLLERS

    return dict.fromkeys(name for controller in CONTROLLERS.values() for name in controller.gains)


def _list_models() -> Iterable[str]:
    from ..fmu.models import MODELS

    return MODELS


_NAMES: dict[str, Callable[[], Iterable[str]]] = {
    "scenario": _list_scenarios,
    "plan": _list_plans,
    "models": _list_models,
    "controller": _list_controllers,
    "controllers": _list_controllers,
    "gains": _list_gains,
}
"""Completions by parameter name, of parameters without declared choices."""


_FIRST_ARGUMENTS: dict[str, Callable[[], Iterable[str]]] = {
    **dict.fromkeys(("run", "export", "compare"), _list_scenarios),
    **dict.fromkeys(("sweep", "tune"), _list_plans),
    **dict.fromkeys(("rerun", "plot", "verify", "repair", "trajectory", "info"), tuple),
    "build": _list_models,
}
"""Completions of the first argument by command; an empty tuple means files."""


def install(app: click.Command) -> str:
    """Install completion for the user's shell, and return a message that says where.

    Raises:
        ValueError: If completion cannot be installed, with the reason.
    """
    shell = _detect_shell()
    try:
        path = _install_script(app, shell)
    except (OSError, RuntimeError, ValueError) as error:  # no home folder, or one that is not writable
        reason = getattr(error, "strerror", None) or str(error).rstrip(".")
        raise ValueError(f"cannot install completion for {shell}: {reason}") from error
    return f"Completion for {shell} is in {path}. It works in new shells."


def _install_script(app: click.Command, shell: str) -> Path:
    """Write the completion script, and make the start file of the shell load it. Return the script's path.

    May raise OSError.
    """
    home = Path.home()
    path, start, lines = {
        "bash": (
            home / ".bash_completions" / f"{PROGRAM}.sh",
            home / ".bashrc",
            [f"source '{home / '.bash_completions' / PROGRAM}.sh'"],
        ),
        "zsh": (
            home / ".zfunc" / f"_{PROGRAM}",
            home / ".zshrc",
            ["fpath+=~/.zfunc; autoload -Uz compinit; compinit", "zstyle ':completion:*' menu select"],
        ),
        "fish": (home / ".config" / "fish" / "completions" / f"{PROGRAM}.fish", None, []),
    }[shell]
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(path) as stream:
        stream.write(f"{make_script(app)}\n".encode())
    if start is not None:
        start = Path(os.path.realpath(start))  # it may be a link to where its owner keeps such files
        before = start.read_bytes() if start.exists() else b""
        # zsh: a style of the user's stays
        new = [x for x in lines if x.split()[0].encode() not in before or x.startswith("source")]
        if added := [x for x in new if x.encode() not in before]:
            with write_atomically(start) as stream:
                stream.write(before + "\n".join(["", *added, ""]).encode())
    return path


def make_script(app: click.Command) -> str:
    """Return the completion script of the user's shell. Raise ValueError if the shell is not supported."""
    shell = get_completion_class(_detect_shell())
    assert shell is not None
    return shell(app, {}, PROGRAM, VARIABLE).source()


def _detect_shell() -> str:
    """Return the shell that called this command; if that is not known, the user's login shell."""
    import psutil

    callers = list[str]()
    with suppress(psutil.Error):
        callers = [process.name().removesuffix(".exe") for process in psutil.Process().parents()]
    login = Path(os.environ.get("SHELL", "")).name
    name = next((n for n in (*callers, login) if n in SHELLS), login)
    if name not in SHELLS:
        raise ValueError(
            f"the shell {name or '(unknown)'} is not supported; supported shells: {', '.join(SHELLS)}"
        )
    return name
