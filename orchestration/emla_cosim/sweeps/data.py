"""The data of a sweep's result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import polars

from ..recorders.metrics import MetricDisplay
from .targets import Target

DONE, DIVERGED, REFUSED, FAILED, DIED = "done", "diverged", "refused", "failed", "died"
TIMED_OUT = "timed out"
"""Statuses of a variant: completed; diverged in a step; refused before the first step; failed in a figure or
requirement; its process died; it took too long."""

VARIANT, STATUS, PROBLEM = "variant", "status", "problem"
"""Columns of the table besides factors and figures."""

RESERVED = (VARIANT, STATUS, PROBLEM, "end_s", "seed", "provenance", "time")
"""Columns of every table of variants. Factors and figures must not have these names."""


@dataclass(frozen=True)
class SweepData:
    """The data of a sweep's result. `SweepResult` explains the fields."""

    name: str
    sampling: str
    seed: int
    factors: Sequence[str]
    figures: Sequence[str]
    variants: polars.DataFrame
    signals: Sequence[str] = ()
    series: polars.LazyFrame | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    shown: Mapping[str, MetricDisplay] = field(default_factory=dict)
    folder: Path | None = None
    complete: bool = True
    required: Sequence[str] = ()
    base: Sequence[str] | None = None
    targets: Mapping[str, Sequence[Target]] = field(default_factory=dict)
    wall_s: float = 0.0
    notes: Sequence[str] = ()
    resources: object = field(default=None, compare=False, repr=False)
