"""The result of a comparison, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import polars

PAPER, ROBUSTNESS, STABILITY, MARGINS = "paper", "robustness", "stability", "margins"
CERTIFICATE = "certificate"
TABLES = (PAPER, ROBUSTNESS, STABILITY, MARGINS)
"""Comparisons with tables of their own."""


@dataclass(frozen=True)
class CompareData:
    """The result of a comparison of controllers; `CompareResult` explains the fields."""

    name: str
    table: str | None
    rows: polars.DataFrame
    entrants: Sequence[str]
    errors: Mapping[int, polars.DataFrame] = field(default_factory=dict)
    commands: Mapping[int, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    complete: bool = True
    wall_s: float = 0.0
    folder: Path | None = None
