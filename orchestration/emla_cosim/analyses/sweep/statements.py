"""What random draws of a sweep imply for all possible variants."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..frame.confidence import describe_share, quantile_interval, share_interval
from ..variants.data import DONE
from .columns import figure_values, is_truth, variant_numbers
from .result import SweepResult
from .sensitivity import SALTELLI

_QUANTILES = {"median": 0.5, "95 %": 0.95}

_EVEN_SAMPLINGS = ("latin-hypercube", "sobol", SALTELLI)
"""Samplings that spread their draws more evenly than independent ones."""

_ASSUMPTION = (
    "The confidence is that of independent draws. Draws of the sampling {} are spread more evenly, which "
    "usually makes the interval wider than needed."
)


@dataclass(frozen=True)
class Statements:
    """What a sweep implies for all possible variants.

    Attributes:
        event: What a variant must not be, such as "not held".
        count: Number of variants that are.
        total: Number of variants that count.
        sentences: How probable it is, and the assumption.
        quantiles: Quantiles of the figures over variants that are done, by figure and name of the quantile:
            its value, and low and high end of its interval, which can be infinite.
    """

    event: str
    count: int
    total: int
    sentences: list[str]
    quantiles: Mapping[str, Mapping[str, Mapping[str, float]]]

    def record(self) -> dict[str, Any]:
        """Return the entries for sweep.json."""
        low, high = share_interval(self.count, self.total)
        share = {"count": self.count, "total": self.total, "low": low, "high": high}
        return {"statements": {"texts": self.sentences, self.event: share}, "quantiles": self.quantiles}


def make_statements(result: SweepResult) -> Statements | None:
    """Return the statements of a sweep; None if its variants are not random draws.

    Variants that are finished before an interrupt are not: those that take long may be missing. The rows of
    a Saltelli sample are related to each other. Its statements use the rows of the matrix A only.
    """
    is_random, is_saltelli = result.sampling == "random", result.sampling == SALTELLI
    if not (result.complete and result.variants.height and (is_random or result.sampling in _EVEN_SAMPLINGS)):
        return None
    outcomes = result.outcomes
    if is_saltelli:
        outcomes = outcomes[variant_numbers(result) % (len(result.factors) + 2) == 0]
    event, total, count = f"not {result.good_outcome}", len(outcomes), int((outcomes != DONE).sum())
    noun = "base samples" if is_saltelli else "variants"
    share = describe_share(count, total, f"{noun} {event}")
    sentences = [f"{share[0].upper()}{share[1:]}."]
    if not is_random:
        sentences.append(_ASSUMPTION.format(result.sampling))
    return Statements(event, count, total, sentences, {} if is_saltelli else _compute_intervals(result))


def _compute_intervals(result: SweepResult) -> dict[str, dict[str, dict[str, float]]]:
    intervals = dict[str, dict[str, dict[str, float]]]()
    for figure in result.figures:
        values = figure_values(result, figure)
        values = values[~np.isnan(values)]
        if len(values) and not is_truth(result, figure):
            intervals[figure] = {}
            for name, q in _QUANTILES.items():
                low, high = quantile_interval(values, q)
                intervals[figure][name] = {"value": float(np.quantile(values, q)), "low": low, "high": high}
    return intervals
