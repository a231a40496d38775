"""The result of an identification."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .certainty import Estimate
from .data import IdentificationData
from .pictures import draw_fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class IdentificationResult(IdentificationData):
    """Estimates with their certainty, and how well they predict what was measured.

    Attributes:
        name: name of the identification.
        estimates: the estimates; `result[name]` is one of them.
        set: start values for `Simulation.run(set=...)`, by full name.
        correlations: correlations of the estimates, shape (p, p); NaN for those that are not identified.
        condition: condition number of the derivatives; large where parameters cannot be told apart.
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
    """

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter. Raises KeyError."""
        return {one.name: one for one in self.estimates}[name]

    @property
    def is_identified(self) -> bool:
        """Whether the data identify every parameter."""
        return all(one.problem is None for one in self.estimates)

    def plot(self) -> "Figure":
        """Draw measured over predicted signals, and their residuals."""
        return draw_fit(self)
