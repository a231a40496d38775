"""The result of an identification."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars
from numpy.typing import NDArray

from ..frame.report import ReportedResult
from .certainty import Candidate, Estimate
from .residuals import Fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SAMPLES = {"experiment": str, "signal": str, "time": float, "measured": float, "predicted": float}
"""Columns of the table of samples."""


@dataclass(frozen=True, repr=False)
class IdentificationResult(ReportedResult):
    """Estimates with their certainty, and how well they predict what was measured.

    Attributes:
        name: name of the identification.
        estimates: the estimates; `result[name]` is one of them.
        set: start values for `Simulation.run(set=...)`, by full name.
        correlations: correlations of the estimates, shape (p, p); NaN for those that are not identified.
        condition: condition number of the derivatives; large where the data do not separate the parameters.
        fits: the fit of each signal in each experiment.
        sigma: standard deviations by which residuals were weighed, by signal, in its unit.
        samples: polars data frame with `experiment`, `signal`, `time` in s, `measured` and `predicted`.
        history: polars data frame with the cost of each evaluation.
        candidates: experiments by what they would tell, the best first, if a design was asked for.
        complete: whether the identification ended by itself.
        converged: whether the search ended by its tolerances.
        runs: number of runs.
        wall_s: wall time in s.
        notes: what to read before the estimates.
        folder: output folder; None without one.
        data_notes: how the measured data were read.
        plan: the plan as plain data.
        systems: what determines the result of a run, as plain data, for each experiment.
        scenario: content of a scenario file with the estimates.
    """

    name: str
    correlations: NDArray[np.float64]
    sigma: Mapping[str, float]
    history: polars.DataFrame
    estimates: Sequence[Estimate] = ()
    set: Mapping[str, Any] = field(default_factory=dict)
    condition: float = math.nan
    fits: Sequence[Fit] = ()
    samples: polars.DataFrame = field(default_factory=lambda: polars.DataFrame(schema=SAMPLES))
    candidates: Sequence[Candidate] = ()
    complete: bool = True
    converged: bool = True
    runs: int = 0
    wall_s: float = 0.0
    notes: Sequence[str] = field(default_factory=list)
    folder: Path | None = None
    data_notes: Sequence[str] = ()
    plan: Mapping[str, Any] = field(default_factory=dict)
    systems: Sequence[Mapping[str, Any]] = ()
    scenario: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter. Raises KeyError."""
        return {estimate.name: estimate for estimate in self.estimates}[name]

    @property
    def is_identified(self) -> bool:
        """Whether the data identify every parameter."""
        return all(estimate.problem is None for estimate in self.estimates)

    def plot(self) -> "Figure":
        """Draw measured over predicted signals, and their residuals."""
        from .report import draw_fit  # loads what only reports need

        return draw_fit(self)

    @property
    def record(self) -> dict[str, Any]:
        """Content of `identify.json`: what determines the result, and the result."""
        return {
            "format": "emla-identification",
            "name": self.name,
            "status": "completed" if self.complete else "unfinished",
            "converged": self.converged,
            "estimates": [asdict(item) for item in self.estimates],
            "correlations": [[None if x != x else x for x in row] for row in self.correlations.tolist()],
            "condition": self.condition,
            "fits": [asdict(item) for item in self.fits],
            "candidates": [asdict(item) for item in self.candidates],
            "sigma": dict(self.sigma),
            "notes": [*self.data_notes, *self.notes],
            "plan": self.plan,
            "systems": self.systems,
            "runs": self.runs,
            "wall_s": self.wall_s,
            "version": version("emla-cosim"),
        }
