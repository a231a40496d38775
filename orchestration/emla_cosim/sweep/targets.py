"""Where the values of a variant go, as options of a run and as arguments of `emla run`."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..option import SWEEP
from ..options import table
from ..system.model import Replacement, Value

OPTION, FMU, START = "option", "replace", "set"
"""What a target is: an option, a component whose FMU varies, or a start value by its full name."""


@dataclass(frozen=True)
class Target:
    """Where a value goes; `nominal` is what it multiplies there, if it is relative."""

    name: str
    kind: str = START
    nominal: float | None = None


def assigned(targets: Sequence[Target], value: Value | None) -> dict[str, Any]:
    """The options that bring a value of the table of variants to these targets; none for None."""
    found: dict[str, Any] = {}
    if value is None:
        return found
    for target in targets:
        given = value
        if target.nominal is not None and len(targets) > 1:
            given = target.nominal * float(value)
        if target.kind == OPTION:
            found[target.name] = given
        else:
            found.setdefault(target.kind, {})[target.name] = given
    return found


def merged(parts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Options of several factors as those of one run."""
    found: dict[str, Any] = {}
    for part in parts:
        for name, value in part.items():
            found[name] = {**found.get(name, {}), **value} if isinstance(value, Mapping) else value
    return found


def as_arguments(options: Mapping[str, Any]) -> list[str] | None:
    """Options as `emla run` takes them; None where one is an object that only Python has."""
    found = list[str]()
    known = table(SWEEP)
    for name, value in options.items():
        option = known[name]
        if isinstance(value, bool):
            found.append(option.flag if value else f"--no-{option.flag.removeprefix('--')}")
        elif isinstance(value, Mapping):
            for key, inner in value.items():
                if isinstance(inner, Replacement):
                    found += [option.flag, f"{key}={inner.fmu}"]
                    found += [] if inner.mapping is None else ["--mapping", f"{key}={inner.mapping}"]
                else:
                    found += [option.flag, f"{key}={_text(inner)}"]
        elif isinstance(value, (list, tuple)):
            for inner in value:
                found += [option.flag, _text(inner)]
        elif isinstance(value, (str, int, float, Path)):
            found += [option.flag, _text(value)]
        elif value is not None:
            return None
    return found


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)
