"""Errors that end a command with one sentence and an exit code."""


class CosimError(Exception):
    """A sentence for the user: what was wrong, where, and what would be right."""

    exit_code = 1


class CommandError(CosimError):
    """The command, or a file it names, was wrong; nothing was run."""

    exit_code = 2


class RunError(CosimError):
    """The run failed; what was computed before is on disk."""
