"""A check: its name, the clause of the standard, the checks that it needs, and its function."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.resources import files
from typing import Any

import msgspec

from .terms import say_in_catalogue
from .verdict import CheckOutcome, Clause, quote

TEXTS = msgspec.json.decode(
    (files(__package__ or "") / "checks.json").read_bytes(), type=dict[str, dict[str, tuple[str, str]]]
)
"""Title and hint of each check by its name, by group."""

Examine = Callable[[Any], CheckOutcome]
"""The function of a check. Takes a `Subject` or a `WholeSystem`."""


@dataclass(frozen=True)
class Check:
    """One check of an FMU. It runs in a subprocess.

    Attributes:
        name: Stable name, `group.what`.
        title: Title in reports.
        clause: Clause of the standard that a failure violates.
        hint: What to do about a failure.
        examine: Function of the check.
        needs: Names of checks that must pass or warn first.
        time_factor: Multiplies the time limit.
        memory_factor: Multiplies the memory limit.
        advisory: Whether a failure only warns or, if the clause is a rule of this program, is only noted.
        only_for: Version of FMI that alone has what the check is about, 2 or 3; 0 for both.
    """

    name: str
    title: str
    clause: Clause
    hint: str
    examine: Examine
    needs: tuple[str, ...] = ()
    time_factor: float = 1.0
    memory_factor: float = 1.0
    advisory: bool = False
    only_for: int = 0

    def of(self, version: int) -> "Check":
        """Return the check with the texts for a version of FMI, 2 or 3."""
        title, hint = (say_in_catalogue(text, version) for text in (self.title, self.hint))
        return replace(self, clause=self.clause.of(version), title=title, hint=hint)

    def __reduce__(self) -> Any:
        """Pickle the check by its module and name, for other processes."""
        return _load_check, (self.examine.__module__, self.examine.__name__)

    @property
    def group(self) -> str:
        """The first part of the name: `state`."""
        return self.name.partition(".")[0]

    @property
    def procedure(self) -> str:
        """What the check does, as one paragraph."""
        return " ".join(inspect.cleandoc(self.examine.__doc__ or "").partition("\n\n")[0].split())


def check(
    name: str, title: str = "", clause: Clause | None = None, hint: str = "", **more: Any
) -> Callable[[Examine], Check]:
    """Decorate a function as a check. `Check` describes the arguments.

    By default, title and hint are those in checks.json, and the clause is that in quotations.json.
    """
    if not title:
        title, hint = next(texts[name] for texts in TEXTS.values() if name in texts)
    clause = clause or quote(name)
    return lambda examine: Check(name, title, clause, hint, examine, **more)


def _load_check(module: str, name: str) -> Check:
    return getattr(import_module(module), name)
