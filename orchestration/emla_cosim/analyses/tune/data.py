"""The result of a tuning, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import polars

from ...system.model import Value
from .score import Score


@dataclass(frozen=True)
class Tuned:
    """A set of gains, with its score on the training and the validation seeds.

    Attributes:
        values: values that vary, by name; None for one that is not a number in the scenario.
        set: start values for `Simulation.run(set=...)`, by full name.
        training: score on the training seeds.
        validation: score on the validation seeds; None if these were not run.
        half_step: score on the training seeds with half the step, over the cases that were judged; None if
            the objective was not judged.
    """

    values: Mapping[str, Value | None]
    set: Mapping[str, Value]
    training: Score
    validation: Score | None = None
    half_step: Score | None = None

    @property
    def ratio(self) -> float:
        """Objective on the validation seeds divided by that on the training seeds, or NaN."""
        if self.validation is None or not self.training.objective:
            return float("nan")
        return self.validation.objective / self.training.objective


@dataclass(frozen=True)
class TuneData:
    """The gains found and all that were tried; `TuneResult` explains the fields."""

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
    remarks: Sequence[str] = ()
