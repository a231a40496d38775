"""Faults of files against their standard: those that end a command, and those that are accepted and listed.

A fault that cannot change a result is always accepted. `--lenient` also accepts others that tools accept.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .errors import CommandError
from .units import (
    IDENTITY,
    LinearTransformation,
    SiUnit,
    UndefinedUnitError,
    find_conversion,
    list_contradictions,
)

LENIENT = "lenient"
"""The option that accepts faults."""

ADVICE = "`--lenient` accepts this"
"""What an error message says about a fault that the option accepts."""


@dataclass
class AcceptedFaults:
    """The faults that a `with` block of `accept_faults` has accepted so far.

    Attributes:
        lenient: Whether the option `lenient` is set.
        by_file: The problems by the name of the file, in the order in which they were found.
    """

    lenient: bool
    by_file: dict[str, list[str]] = field(default_factory=dict)

    def add(self, where: str, problems: Sequence[str]) -> None:
        """Add problems of a file, each once."""
        earlier = self.by_file.setdefault(where, [])
        earlier += [p for p in dict.fromkeys(problems) if p not in earlier]

    def merge(self, by_file: Mapping[str, Sequence[str]]) -> None:
        """Add other accepted problems by file."""
        for where, problems in by_file.items():
            self.add(where, problems)

    def list_by_file(self, unpacked: Path | None = None) -> dict[str, list[str]]:
        """Return the problems by file; files in the folder `unpacked` have their names in the package."""
        prefix = "" if unpacked is None else f"{unpacked}{os.sep}"
        return {where.removeprefix(prefix): list(problems) for where, problems in self.by_file.items()}

    def remarks(self, unpacked: Path | None = None) -> list[str]:
        """Return one message for each file."""
        return [
            f"'{where}' has a fault, which was accepted: {problems[0]}"
            + (f", and {len(problems) - 1} more" if len(problems) > 1 else "")
            + "."
            for where, problems in self.list_by_file(unpacked).items()
        ]


_current: ContextVar[AcceptedFaults | None] = ContextVar("accepted_faults", default=None)


@contextlib.contextmanager
def accept_faults(lenient: bool) -> Iterator[AcceptedFaults]:
    """Collect the faults that are accepted inside the block; a block around it collects them, too.

    Args:
        lenient: Whether to accept faults that can change a result.
    """
    outer, inner = _current.get(), AcceptedFaults(lenient)
    token = _current.set(inner)
    try:
        yield inner
    finally:
        _current.reset(token)
        if outer is not None:
            outer.merge(inner.by_file)


def is_lenient() -> bool:
    """Return whether faults that can change a result are accepted."""
    current = _current.get()
    return current is not None and current.lenient


def note_fault(where: str, *problems: str) -> None:
    """Add problems to the accepted ones; without a block of `accept_faults`, they are dropped.

    Args:
        where: The name of the file.
        *problems: The problems, without full stops.
    """
    if problems and (current := _current.get()) is not None:
        current.add(where, problems)


def accept_if_lenient(where: str, problem: str, message: str, **fields: Any) -> None:
    """Accept a problem with the option `lenient`.

    Args:
        where: The name of the file.
        problem: The problem, without a full stop.
        message: The error message without the option, without a full stop.
        **fields: The fields of the error.

    Raises:
        CommandError: If the option is not set.
    """
    if not is_lenient():
        raise CommandError(f"{message}. {ADVICE}.", **fields)
    note_fault(where, problem)


def convert_documents_units(where: str, source: SiUnit | None, target: SiUnit | None) -> LinearTransformation:
    """Return the conversion of units that documents name.

    With `lenient`, numbers in undefined units do not change. A unit whose definition contradicts its name is
    reported.

    Args:
        where: What has the units, for the list of accepted faults.
        source: The unit of the source.
        target: The unit of the target.

    Raises:
        ValueError: If there is no conversion; the message is a phrase.
    """
    contradictions = list_contradictions(source, target)
    try:
        conversion = find_conversion(source, target)
    except UndefinedUnitError as error:
        if not is_lenient():
            raise UndefinedUnitError(f"{error} ({ADVICE} and does not change the number)") from error
        note_fault(where, f"{error}; the number is not changed")
        return IDENTITY
    except ValueError as error:
        raise ValueError("; ".join([str(error), *contradictions])) from error
    note_fault(where, *(f"{text}; it is converted as declared" for text in contradictions))
    return conversion
