"""Read the dependencies that the model structure declares."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from fmpy.model_description import Unknown

from ..subject import Subject


@dataclass(frozen=True)
class Dependency:
    """An unknown and the names of its dependencies; None if they are not declared."""

    unknown: str
    on: frozenset[str] | None

    def excludes(self, name: str) -> bool:
        """Return whether the declaration excludes a dependency on a variable."""
        return self.on is not None and name not in self.on


REAL = ("Real",)
ALL_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")


def at_initialization(subject: Subject, types: Sequence[str] = REAL) -> list[Dependency]:
    """Return the dependencies of outputs of some types in initialization mode."""
    return [d for d in _read(subject.description.initialUnknowns, types) if _is_output(subject, d.unknown)]


def at_events(subject: Subject, types: Sequence[str] = REAL) -> list[Dependency]:
    """Return the dependencies of outputs and state derivatives in event and continuous-time mode."""
    return _read([*subject.description.outputs, *subject.description.derivatives], types)


def _read(unknowns: Iterable[Unknown], types: Sequence[str]) -> list[Dependency]:
    return [
        Dependency(
            u.variable.name,
            None if u.dependencies is None else frozenset(v.name for v in u.dependencies),
        )
        for u in unknowns
        if u.variable is not None and u.variable.type in types
    ]


def _is_output(subject: Subject, name: str) -> bool:
    return subject.variables[name].causality == "output"
