"""What a shell completes of `emla` commands, and how it is told to."""

import os
from collections.abc import Callable, Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any

import typer

PROGRAM, VARIABLE = "emla", "_EMLA_COMPLETE"
"""The command that is completed, and the variable in the environment with which a shell asks."""

SHELLS = ("bash", "zsh", "fish", "powershell", "pwsh")


def answer(app: typer.Typer) -> None:
    """Tell a shell what completes its line, which is in the environment; or nothing."""
    from typer._completion_classes import completion_init

    completion_init()
    try:
        app(prog_name=PROGRAM)
    except Exception:  # who presses a key is not to read why it had no effect
        raise SystemExit(1) from None


def add_completion(command: Any) -> None:
    """Make a command know what completes the values of its options and arguments: names, or files."""
    from typer._click.shell_completion import CompletionItem

    def completing(names: Callable[[], Iterable[str]]) -> Any:
        return lambda ctx, param, begun: [CompletionItem(n) for n in names() if n.startswith(begun)]

    for parameter in command.params:
        if parameter.name in _NAMES:
            parameter._custom_shell_complete = completing(_NAMES[parameter.name])
        elif not getattr(parameter, "is_flag", False):  # the shell itself offers files then
            parameter._custom_shell_complete = lambda ctx, param, begun: []


def complete_first_argument(command: str, begun: str) -> list[Any] | None:
    """What may come first after a command; None where nobody knows without importing it."""
    from typer._click.shell_completion import CompletionItem

    names = _FIRST.get(command)
    return None if names is None else [CompletionItem(n) for n in names() if n.startswith(begun)]


def _scenarios() -> Iterable[str]:
    return sorted([*_files("scenarios"), *_files("joints")])


def _plans() -> Iterable[str]:
    return [*_scenarios(), *_files("plans")]


def _files(folder: str) -> Iterable[str]:
    """Names of the files of the study in a folder, which are quicker to list than to load."""
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
    **{name: _choices(name) for name in ("algorithm", "flavour", "platform", "output_format")},
}
"""What values there are, by the name of what takes them."""


_FIRST: dict[str, Callable[[], Iterable[str]]] = {
    **dict.fromkeys(("run", "export", "compare"), _scenarios),
    **dict.fromkeys(("sweep", "tune"), _plans),
    **dict.fromkeys(("rerun", "plot", "verify", "trajectory", "info"), tuple),
    "build": _models,
}
"""What may come first, by command; nothing where that are files."""


def install() -> str:
    """Make the user's shell complete; returns a sentence that says where.

    Raises ValueError with the reason where that cannot be.
    """
    from typer._completion_shared import install as installed

    shell = _shell()
    try:
        _, place = installed(shell, PROGRAM, VARIABLE)
    except (OSError, RuntimeError, ValueError) as error:  # no home, or one that cannot be written
        reason = getattr(error, "strerror", None) or str(error).rstrip(".")
        raise ValueError(f"completion cannot be installed for {shell}: {reason}") from error
    return f"Completion for {shell} is in {place}; it works in shells that are opened from now on."


def script() -> str:
    """What makes the user's shell complete. Raises ValueError with a reason."""
    from typer._completion_shared import get_completion_script

    return get_completion_script(prog_name=PROGRAM, complete_var=VARIABLE, shell=_shell())


def _shell() -> str:
    """The shell that the command was called from; else the user's own."""
    import shellingham

    try:
        name = shellingham.detect_shell()[0]
    except (shellingham.ShellDetectionFailure, OSError, ValueError):
        name = ""
    if name not in SHELLS:  # a script may have called
        name = Path(os.environ.get("SHELL", "")).name or name
    if name not in SHELLS:
        raise ValueError(f"the shell is {name or 'not known'}; there is completion for {', '.join(SHELLS)}")
    return name
