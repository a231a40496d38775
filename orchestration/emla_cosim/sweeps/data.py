"""What came out of a sweep, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import polars

from ..recorders.metrics import Shown
from .targets import Target

DONE, DIVERGED, REFUSED, FAILED, DIED = "done", "diverged", "refused", "failed", "died"
"""How a variant ended: whole; early, in a step; before its first step; by a figure or a requirement; with its
process."""

VARIANT, STATUS, PROBLEM = "variant", "status", "problem"
"""Columns of the table beside those of what varies and of figures."""


@dataclass(frozen=True)
class SweepData:
    """What came out of a sweep; `SweepResult` explains the fields."""

    name: str
    sampling: str
    seed: int
    factors: Sequence[str]
    figures: Sequence[str]
    variants: polars.DataFrame
    signals: Sequence[str] = ()
    series: polars.LazyFrame | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    shown: Mapping[str, Shown] = field(default_factory=dict)
    folder: Path | None = None
    complete: bool = True
    required: Sequence[str] = ()
    base: Sequence[str] | None = None
    targets: Mapping[str, Sequence[Target]] = field(default_factory=dict)
    wall_s: float = 0.0
    notes: Sequence[str] = ()
    resources: object = field(default=None, compare=False, repr=False)
