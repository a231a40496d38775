"""What came out of a tuning, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import polars

from ..system.model import Value
from .score import Score


@dataclass(frozen=True)
class Tuned:
    """A set of gains, and what it is worth on the seeds of training and of validation.

    `values` are those that vary, by name, None for one that is no number in the scenario; `set` are the
    start values that `Simulation.run(set=...)` takes. `validation` is None where it was not come to.
    """

    values: Mapping[str, Value | None]
    set: Mapping[str, Value]
    training: Score
    validation: Score | None = None

    @property
    def ratio(self) -> float:
        """The objective of the validation by that of the training; NaN where there is none."""
        if self.validation is None or not self.training.objective:
            return float("nan")
        return self.validation.objective / self.training.objective


@dataclass(frozen=True)
class TuneData:
    """The gains that were found, and everything that was tried; `TuneResult` explains the fields."""

    name: str
    objective: str
    start: Tuned
    best: Tuned
    history: polars.DataFrame
    units: Mapping[str, str] = field(default_factory=dict)
    seeds: Mapping[str, Sequence[int]] = field(default_factory=dict)
    tolerance: float | None = None
    complete: bool = True
    runs: int = 0
    wall_s: float = 0.0
    folder: Path | None = None
    notes: Sequence[str] = ()
