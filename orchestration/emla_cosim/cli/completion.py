"""Shell completion of `emla` commands, and its installation."""

import os
from collections.abc import Callable, Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any

import typer

from fmublock.files import write_atomically

PROGRAM, VARIABLE = "emla", "_EMLA_COMPLETE"
"""Program to complete, and the environment variable that a shell sets to ask for completions."""

SHELLS = ("bash", "zsh", "fish", "powershell", "pwsh")


def answer(app: typer.Typer) -> None:
    """Print the completions of the command line in the environment."""
    from typer._completion_classes import completion_init

    completion_init()
    try:
        app(prog_name=PROGRAM)
    except Exception:  # an error message would disturb the line that the user types
        raise SystemExit(1) from None


def add_completion(command: Any) -> None:
    """Add completions to the options and arguments of a command: names, or files."""
    from typer._click.shell_completion import CompletionItem

    def completing(names: Callable[[], Iterable[str]]) -> Any:
        return lambda ctx, param, begun: [CompletionItem(n) for n in names() if n.startswith(begun)]

    for parameter in command.params:
        if parameter.name in _NAMES:
            parameter._custom_shell_complete = completing(_NAMES[parameter.name])
        elif not getattr(parameter, "is_flag", False):  # the shell itself completes files
            parameter._custom_shell_complete = lambda ctx, param, begun: []


def complete_first_argument(command: str, begun: str) -> list[Any] | None:
    """Return completions of the first argument, or None if that needs an import of the command."""
    from typer._click.shell_completion import CompletionItem

    names = _FIRST.get(command)
    return None if names is None else [CompletionItem(n) for n in names() if n.startswith(begun)]


def _scenarios() -> Iterable[str]:
    return sorted([*_files("scenarios"), *_files("joints")])


def _plans() -> Iterable[str]:
    return [*_scenarios(), *_files("plans")]


def _files(folder: str) -> Iterable[str]:
    """Return the names of the study's files in a folder, without loading them."""
    places = files("emla_cosim").joinpath("study", folder).iterdir()
    return sorted(p.name.removesuffix(".toml") for p in places if p.name.endswith(".toml"))


def _controllers() -> Iterable[str]:
    from ..study.controllers import CONTROLLERS

    return CONTROLLERS


def _gains() -> Iterable[str]:
    from ..study.controllers import CONTROLLERS

    return dict.fromkeys(name for controller in CONTROLLERS.values() for name in controller.gains)


def _models() -> Iterable[str]:
    from ..fmu.models import MODELS

    return MODELS


def _choices(name: str) -> Callable[[], Iterable[str]]:
    def found() -> Iterable[str]:
        from ..run.options import list_options

        choices = list_options()[name].about.choices
        return choices() if choices is not None else ()

    return found


_NAMES: dict[str, Callable[[], Iterable[str]]] = {
    "scenario": _scenarios,
    "plan": _plans,
    "models": _models,
    "controller": _controllers,
    "controllers": _controllers,
    "gains": _gains,
    **{name: _choices(name) for name in ("algorithm", "flavour", "platform", "output_format", "plot_format")},
}
"""Completions by parameter name."""


_FIRST: dict[str, Callable[[], Iterable[str]]] = {
    **dict.fromkeys(("run", "export", "compare"), _scenarios),
    **dict.fromkeys(("sweep", "tune"), _plans),
    **dict.fromkeys(("rerun", "plot", "verify", "trajectory", "info"), tuple),
    "build": _models,
}
"""Completions of the first argument by command; an empty tuple means files."""


def install() -> str:
    """Install completion for the user's shell, and return a message that says where.

    Raises:
        ValueError: If completion cannot be installed, with the reason.
    """
    shell = _shell()
    try:
        place = _install_script(shell)
    except (OSError, RuntimeError, ValueError) as error:  # no home folder, or one that is not writable
        reason = getattr(error, "strerror", None) or str(error).rstrip(".")
        raise ValueError(f"cannot install completion for {shell}: {reason}") from error
    return f"Completion for {shell} is in {place}. It works in new shells."


def _install_script(shell: str) -> Path:
    """Write the completion script, and add what loads it to the start file of the shell. May raise OSError.

    typer's own function writes over the start file, which would be lost on a full disk.
    """
    home = Path.home()
    place, start, lines = {
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
    }.get(shell, (None, None, []))
    if place is None:  # PowerShell
        from typer._completion_shared import install as installed

        return installed(shell, PROGRAM, VARIABLE)[1]
    place.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(place) as stream:
        stream.write(f"{script()}\n".encode())
    if start is not None:
        start = Path(os.path.realpath(start))  # it may be a link to where its owner keeps such files
        before = start.read_bytes() if start.exists() else b""
        # zsh: a style of the user's stays
        new = [x for x in lines if x.split()[0].encode() not in before or x.startswith("source")]
        if added := [x for x in new if x.encode() not in before]:
            with write_atomically(start) as stream:
                stream.write(before + "\n".join(["", *added, ""]).encode())
    return place


def script() -> str:
    """Return the completion script of the user's shell. Raise ValueError if the shell is not supported."""
    from typer._completion_shared import get_completion_script

    return get_completion_script(prog_name=PROGRAM, complete_var=VARIABLE, shell=_shell())


def _shell() -> str:
    """Return the shell that called this command; if that is not known, the user's login shell."""
    import shellingham

    try:
        name = shellingham.detect_shell()[0]
    except (shellingham.ShellDetectionFailure, OSError, ValueError):
        name = ""
    if name not in SHELLS:  # the caller may be a script
        name = Path(os.environ.get("SHELL", "")).name or name
    if name not in SHELLS:
        raise ValueError(
            f"the shell {name or '(unknown)'} is not supported; supported shells: {', '.join(SHELLS)}"
        )
    return name
