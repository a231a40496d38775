"""What random draws of a sweep say about all that could have been drawn."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..frame.confidence import describe_share, quantile_interval, share_interval
from ..variants.data import DONE
from .columns import figure_values, good_outcome, is_truth, read_outcomes, variant_numbers
from .sensitivity import SALTELLI

if TYPE_CHECKING:
    from .result import SweepResult

QUANTILES = {"median": 0.5, "95 %": 0.95}
"""Quantiles with intervals, by name."""

_EVEN = ("latin-hypercube", "sobol", SALTELLI)
"""Samplings that spread their draws more evenly than independent ones."""

_ASSUMPTION = (
    "The confidence is that of independent draws. Draws of the sampling {} are spread more evenly, which "
    "usually makes the interval wider than needed."
)


@dataclass(frozen=True)
class QuantileInterval:
    """A quantile of a figure, and the ends of its interval, which can be infinite."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Statements:
    """What a sweep says about all variants that could have been drawn.

    Attributes:
        event: What a variant must not be, such as "not held".
        count: Number of variants that are.
        total: Number of variants that count: of a Saltelli sample those of matrix A, whose draws alone are
            not related to each other.
        sentences: How probable it is, and the assumption.
        quantiles: Quantiles of the figures over variants that are done, by figure and name of the quantile.
    """

    event: str
    count: int
    total: int
    sentences: list[str]
    quantiles: Mapping[str, Mapping[str, QuantileInterval]]

    def record(self) -> dict[str, Any]:
        """Return the entries for sweep.json."""
        low, high = share_interval(self.count, self.total)
        share = {"count": self.count, "total": self.total, "low": low, "high": high}
        return {
            "statements": {"texts": self.sentences, self.event: share},
            "quantiles": {
                figure: {name: vars(interval) for name, interval in intervals.items()}
                for figure, intervals in self.quantiles.items()
            },
        }


def make_statements(result: "SweepResult") -> Statements | None:
    """Return the statements of a sweep; None if it is not complete, or its variants are not drawn at random.

    Variants that were not finished before an interrupt may be the slow ones, so that the others are no
    random draw.
    """
    is_random = result.sampling == "random"
    if not (result.complete and result.variants.height and (is_random or result.sampling in _EVEN)):
        return None
    outcomes, what = read_outcomes(result), "variants"
    if result.sampling == SALTELLI:
        outcomes = outcomes[variant_numbers(result) % (len(result.factors) + 2) == 0]
        what = "base samples"
    event, total = f"not {good_outcome(result)}", len(outcomes)
    count = int((outcomes != DONE).sum())
    sentences = [f"{describe_share(count, total, f'{what} {event}')}."]
    if not is_random:
        sentences.append(_ASSUMPTION.format(result.sampling))
    return Statements(event, count, total, sentences, _intervals(result))


def _intervals(result: "SweepResult") -> dict[str, dict[str, QuantileInterval]]:
    """Return intervals of quantiles; none for a Saltelli sample, whose draws are related to each other."""
    intervals = dict[str, dict[str, QuantileInterval]]()
    for figure in result.figures if result.sampling != SALTELLI else ():
        values = figure_values(result, figure)
        values = values[~np.isnan(values)]
        if len(values) and not is_truth(result, figure):
            intervals[figure] = {
                name: QuantileInterval(float(np.quantile(values, q)), *quantile_interval(values, q))
                for name, q in QUANTILES.items()
            }
    return intervals
