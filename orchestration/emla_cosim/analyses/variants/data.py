"""Variants and their outcomes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import polars

from ...recorders.metrics import Figure
from ...run.half_step import HalfStep

DONE, DIVERGED, REFUSED, FAILED, DIED = "done", "diverged", "refused", "failed", "died"
TIMED_OUT = "timed out"
"""Statuses of a variant: completed; diverged in a step; refused before the first step; failed in a figure or
requirement; its process died; it took too long."""

VARIANT, STATUS, PROBLEM = "variant", "status", "problem"
"""Columns of the table besides factors and figures."""

RESERVED = (VARIANT, STATUS, PROBLEM, "end_s", "seed", "provenance", "time")
"""Columns of every table of variants. Factors and figures must not have these names."""


@dataclass(frozen=True)
class Variant:
    """One variant: its number, its options, and whether it runs with half the step of them."""

    number: int
    options: Mapping[str, Any]
    is_halved: bool = False


@dataclass(frozen=True)
class VariantOutcome:
    """The outcome of a variant: status, reason, end time in s, and figures.

    Attributes:
        cut_short: Whether an FMU asked to end the run before its stop time; its status is then "done".
        half_step: How a variant with half the step was run.
    """

    number: int
    status: str
    problem: str | None = None
    end_s: float | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)
    cut_short: bool = False
    half_step: HalfStep | None = None

    @property
    def complete(self) -> bool:
        """Whether the variant ran as long as it was asked to, so that its figures compare with others."""
        return self.status == DONE and not self.cut_short


@dataclass(frozen=True)
class Chunk:
    """The outcomes of a chunk, and its signals as a Parquet file."""

    outcomes: Sequence[VariantOutcome]
    series: bytes | None = None


@dataclass(frozen=True)
class SimulationDescription:
    """The signals (with units) and figures of a prepared simulation."""

    units: Mapping[str, str]
    further: Mapping[str, str]
    """Other variables that metrics can name, with units."""
    figures: Mapping[str, Figure]
    """Figures by name, before the first step."""
    rows: int
    """Rows of a table with the options of the scenario."""


def to_parquet(table: polars.DataFrame) -> bytes:
    """Return a table as the content of a Parquet file."""
    stream = BytesIO()
    table.write_parquet(stream)
    return stream.getvalue()
