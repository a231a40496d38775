"""Errors for the user: one message, fields for programs, and an exit code."""

import contextlib
import difflib
import errno
import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any


class CosimError(Exception):
    """Base class of all errors that a user can cause or must know about.

    Attributes:
        fields: parts of the error message by name, for programs.
    """

    exit_code = 1

    def __init__(self, sentence: str, **fields: Any) -> None:
        super().__init__(sentence)
        self.fields = fields

    def __reduce__(self) -> Any:
        """Support pickling, whatever arguments the constructor of a subclass takes.

        The cause is lost, but the exit code that follows from it is kept.
        """
        return _rebuild_error, (type(self), str(self), self.fields, find_exit_code(self))


class CommandError(CosimError):
    """The arguments, or a file they name, are wrong. Nothing was run."""

    exit_code = 2


class RunError(CosimError):
    """A run failed. `fields["result"]` has the results until then, if there are any."""


def _rebuild_error(
    kind: type[CosimError], sentence: str, fields: Mapping[str, Any], exit_code: int
) -> CosimError:
    error = kind.__new__(kind)
    CosimError.__init__(error, sentence, **fields)
    error.exit_code = exit_code
    return error


_MACHINE_ERRORS = {
    number
    for name in ("ENOSPC", "EDQUOT", "EIO", "EMFILE", "ENFILE", "ENOMEM", "EAGAIN")
    if (number := getattr(errno, name, None)) is not None
}
"""Errors of the system that no other command avoids: a full disk, limits, too little memory."""


def find_exit_code(error: CosimError) -> int:
    """Return the exit code of a command that ends with this error: 1 if the machine caused it."""
    return error.exit_code if find_machine_fault(error) is None else RunError.exit_code


def find_machine_fault(error: BaseException) -> OSError | None:
    """Return the error of the system that caused this error, if another machine would not have it."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and cause.errno in _MACHINE_ERRORS:
            return cause
        for number in _MACHINE_ERRORS if not isinstance(cause, CosimError) else ():  # libxml2 gives no number
            if str(cause).rstrip(".\n").endswith(os.strerror(number)):
                return OSError(number, os.strerror(number))
        cause = cause.__cause__
    return None


def raise_machine_fault(error: BaseException, subject: str) -> None:
    """Raise RunError if the system caused an error, so that a message does not blame a file.

    Args:
        error: The error.
        subject: What cannot be read, such as `'lift.fmu'`.
    """
    if (fault := find_machine_fault(error)) is not None:
        raise RunError(
            f"{subject} cannot be read on this machine: {fault.strerror}. See `ulimit -a` and the free space."
        ) from error


@contextlib.contextmanager
def show_paths_relative_to(folder: Path | None) -> Iterator[None]:
    """Remove a temporary folder from error messages: a file of a package becomes `PACKAGE.ssp/FILE`."""
    try:
        yield
    except CosimError as error:
        if folder is not None:
            error.args = (str(error).replace(f"{folder}{os.sep}", ""),)
        raise


def check_choice(kind: str, name: object, choices: Iterable[str]) -> None:
    """Check that `name` is one of the choices.

    Args:
        kind: What the error message calls it, such as `model`.
        name: The value to check.
        choices: The allowed names.

    Raises:
        CommandError: If it is not.
    """
    names = list(choices)
    if name not in names:
        raise CommandError(
            f"there is no {kind} '{name}'; choose from {join_names(map(str, names))}.",
            name=name,
            choices=names,
        )


def join_names(names: Iterable[str]) -> str:
    """Join one or more names to a phrase: `a, b and c`."""
    *front, last = names
    return f"{', '.join(front)} and {last}" if front else last


_MOST_SEARCHED = 20_000
"""The largest number of names in which to search for similar ones, which is slow."""


def suggest_names(name: str, names: Collection[str], hint: str = "", most: int = 12) -> str:
    """Return the end of an error message on an unknown name: similar names, or a list of all.

    Args:
        name: The unknown name.
        names: The known names.
        hint: What to say instead of the list if no name is similar.
        most: How many names to list; the message counts the others.
    """
    searched = names if len(names) <= _MOST_SEARCHED else ()
    near = [n for n in difflib.get_close_matches(name, searched, n=4, cutoff=0.5) if n != name][:3]
    if near:
        return f"did you mean {' or '.join(near)}?"
    if hint:
        return hint
    more = len(names) - most
    return (
        "there are "
        f"{join_names([*islice(names, most), *([f'{more} more'] if more > 0 else [])] or ['none'])}."
    )
