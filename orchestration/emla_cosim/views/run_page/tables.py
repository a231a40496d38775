"""Figures and settings of a run as rows."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ...recorders.metrics import Shown
from ...run.result import Result
from ..telling import cell, text

MOST = 1000
"""Rows of a table; who needs more has the files."""


BONDS = (
    Shown("energy_error", "energy created or destroyed by the coupling", 100.0, "%"),
    Shown("energy_error_J", "the same in joules", 1.0, "J"),
    Shown("energy_exchanged_J", "energy exchanged", 1.0, "J"),
)
"""How a person sees the figures of power bonds."""


@dataclass(frozen=True)
class Figures:
    """Figures of one kind: what they are of, and a row each of label, values and unit."""

    kind: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...], str], ...]


@dataclass(frozen=True)
class Start:
    """A start value that is not that of the FMU, and that one."""

    name: str
    value: str
    unit: str
    default: str


def figures(result: Result) -> Iterator[Figures]:
    """The tables that the terminal shows."""
    for kind, found in result.metrics.items():
        if shown := result.shown.get(kind, ()):
            rows = tuple(
                (one.label, tuple(cell(f[one.name], one) for f in found.values()), one.unit) for one in shown
            )
            yield Figures(kind, tuple(found), rows)
    bonds = {name: found for name, found in result.coupling.items() if BONDS[0].name in found}
    if bonds:
        rows = tuple(
            (one.label, tuple(cell(f[one.name], one) for f in bonds.values()), one.unit) for one in BONDS
        )
        yield Figures("power bonds", tuple(bonds), rows)


def settings(result: Result) -> list[tuple[str, str]]:
    """The options as they were in effect."""
    return [(name, text(value)) for name, value in result.record.get("settings", {}).items()]


def starts(result: Result) -> list[Start]:
    """Start values that differ from those of the FMUs."""
    return [
        Start(
            f"{component}.{name}", _value(found["value"]), str(found["unit"] or ""), _value(found["default"])
        )
        for component, about in result.record.get("components", {}).items()
        for name, found in about.get("changed", {}).items()
    ]


def _value(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else text(value)
