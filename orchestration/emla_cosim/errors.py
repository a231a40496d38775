"""Errors that end a command with one sentence and an exit code."""

from collections.abc import Iterable


class CosimError(Exception):
    """A sentence for the user: what was wrong, where, and what would be right."""

    exit_code = 1


class CommandError(CosimError):
    """The command, or a file it names, was wrong; nothing was run."""

    exit_code = 2


class RunError(CosimError):
    """The run failed; what was computed before is on disk."""


def check_choice(kind: str, name: str, choices: Iterable[str]) -> None:
    """Raise CommandError unless `name` is one of the choices."""
    names = list(choices)
    if name not in names:
        raise CommandError(f"there is no {kind} '{name}'; choose from {listed(names)}.")


def listed(names: Iterable[str]) -> str:
    """Names as a phrase: a, b and c."""
    *front, last = names
    return f"{', '.join(front)} and {last}" if front else last
