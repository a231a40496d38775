"""A check: its stable name, what it rests on, what it needs, and the function that does it."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from .verdict import CheckOutcome, Clause

Examine = Callable[[Any], CheckOutcome]
"""What does a check: takes a `Subject`, or another thing that is examined."""


@dataclass(frozen=True)
class Check:
    """One question to an FMU, asked in a process of its own.

    `name` is stable, `group.what`; `title` is what a report calls it. `clause` is the sentence of the
    standard that a failure breaks. `needs` are names of checks that have to pass, or warn, before it
    makes sense. `hint` says what to do about a failure. `time_factor` and `memory_factor` multiply the time
    and the memory that it may take.
    """

    name: str
    title: str
    clause: Clause
    hint: str
    examine: Examine
    needs: tuple[str, ...] = ()
    time_factor: float = 1.0
    memory_factor: float = 1.0

    def __reduce__(self) -> Any:
        """As it goes to a process that has nothing of this one: by the name that its module has for it."""
        return _of, (self.examine.__module__, self.examine.__name__)

    @property
    def group(self) -> str:
        """The first part of the name."""
        return self.name.partition(".")[0]


def check(
    name: str,
    title: str,
    clause: Clause,
    hint: str,
    needs: tuple[str, ...] = (),
    time_factor: float = 1.0,
    memory_factor: float = 1.0,
) -> Callable[[Examine], Check]:
    """Make a check of a function; see `Check` for what is said of it."""

    def made(examine: Examine) -> Check:
        return Check(name, title, clause, hint, examine, needs, time_factor, memory_factor)

    return made


def _of(module: str, name: str) -> Check:
    return getattr(import_module(module), name)
