"""Sobol indices and local sensitivities of a sweep, and what its draws imply for all variants."""

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ..frame.confidence import describe_share, quantile_interval, share_interval
from ..variants.measures import DONE
from .columns import figure_values, find_varying_figures, is_truth, read_figure_by_variant, variant_numbers
from .result import SweepResult

SALTELLI, ONE_AT_A_TIME = "saltelli", "one-at-a-time"
"""The samplings for Sobol indices and local sensitivities."""

_RESAMPLE_COUNT = 100
"""Resamples of a bootstrap."""


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """The shares of a figure's variance that factors explain, in the order of `factors`.

    Attributes:
        figure: Name of the figure.
        factors: Names of the factors.
        first: Share that each factor explains alone.
        first_confidence: Half width of the 95 % confidence interval of `first`.
        total: Share that each factor explains together with others.
        total_confidence: Half width of the 95 % confidence interval of `total`.
        groups: Number of base samples used.
        left_out: Number of base samples left out: one of their variants lacks the figure.
    """

    figure: str
    factors: tuple[str, ...]
    first: Vector
    first_confidence: Vector
    total: Vector
    total_confidence: Vector
    groups: int
    left_out: int

    @property
    def warning(self) -> str | None:
        """The warning that the indices are biased; None if no base sample is left out."""
        if not self.left_out:
            return None
        total = self.groups + self.left_out
        return (
            f"{self.left_out} of {total} base samples are left out of the Sobol indices of "
            f"'{self.figure}': one of their variants lacks the figure. This biases the indices if the cause "
            "of the failures also changes the figure. Use a figure that every variant has, or narrow the "
            "ranges."
        )

    def record(self) -> dict[str, Any]:
        """Return the entry for sweep.json."""
        numbers = {
            name: [x if math.isfinite(x) else None for x in getattr(self, name).tolist()] for name in _INDICES
        }
        rest = {"groups": self.groups, "left_out": self.left_out, "warning": self.warning}
        return {"factors": list(self.factors), **numbers, **rest}


_INDICES = ("first", "first_confidence", "total", "total_confidence")


class LocalSensitivity(NamedTuple):
    """A figure with one factor low or high, and with all nominal; None if missing."""

    factor: str
    low: float | None
    high: float | None
    nominal: float | None

    @property
    def effect(self) -> float:
        """The difference between the largest and the smallest of the three values."""
        values = [value for value in self[1:] if value is not None]
        return max(values) - min(values) if values else 0.0


def sobol_indices(result: SweepResult, figure: str) -> SobolIndices:
    """Return the Sobol indices of a figure from a Saltelli sample: N (d + 2) rows for d factors.

    A base sample counts only if all of its d + 2 variants have the figure (see `figure_values`). All indices
    of a constant figure are 0.

    Raises:
        CommandError: The sampling is another, the figure does not exist, or there are too few base samples.
    """
    check_sampling(result, SALTELLI, "Sobol indices")
    rows = len(result.factors) + 2
    # rounded up: an interrupted sweep ends within a base sample
    count = -(-(int(variant_numbers(result).max(initial=-1)) + 1) // rows)
    values = read_figure_by_variant(result, figure, count * rows).reshape(count, rows)
    complete = values[~np.isnan(values).any(axis=1)]
    if len(complete) < 2:
        raise CommandError(
            f"{len(complete)} of {count} base samples of the sweep '{result.name}' have the figure "
            f"'{figure}' in all of their {rows} variants; Sobol indices need at least 2, for useful results "
            "hundreds.",
            figure=figure,
        )
    indices = [np.zeros(len(result.factors)) for _ in _INDICES]
    largest = float(np.max(np.abs(complete)))
    if np.ptp(complete) > 1e-12 * largest:
        if np.ptp(complete[:, [0, -1]]) <= 1e-12 * largest:
            raise CommandError(
                f"the figure '{figure}' of the sweep '{result.name}' varies in too few variants for Sobol "
                "indices; use more samples.",
                figure=figure,
            )
        # scaled, so that squares do not overflow
        # not the seed of the sample itself: resamples must not repeat its random numbers
        indices = _compute_indices(complete / largest, result.seed + 1)
    left_out = count - len(complete)
    return SobolIndices(figure, tuple(result.factors), *indices, groups=len(complete), left_out=left_out)


def all_sobol_indices(result: SweepResult) -> dict[str, SobolIndices]:
    """Return the Sobol indices of every figure that varies and has them, by its name."""
    indices = dict[str, SobolIndices]()
    for figure in find_varying_figures(result):
        with contextlib.suppress(CommandError):  # too few variants have it
            indices[figure] = sobol_indices(result, figure)
    return indices


def _compute_indices(values: Vector, seed: int) -> list[Vector]:
    """Return `_INDICES` from a figure for A, A with each factor of B, and B, shape (base samples, d + 2).

    SciPy's `sobol_indices` takes powers of two only, but base samples can be left out.
    """
    from scipy.special import ndtri

    values = (values - values.mean()) / values.std()
    drawn = np.random.default_rng(seed).integers(len(values), size=(len(values), _RESAMPLE_COUNT))
    a, b = values[:, 0], values[:, -1]
    rows = list[list[Any]]()
    for ab in values.T[1:-1]:
        indices = _estimate_indices(a, ab, b)
        # a bootstrap over base samples: the rows of one base sample are not independent
        resampled = _estimate_indices(a[drawn], ab[drawn], b[drawn])
        rows.append([x for y, z in zip(indices, resampled, strict=True) for x in (y, z.std(ddof=1))])
    width = ndtri(0.975)
    return list(np.array(rows).T * [[1.0], [width], [1.0], [width]])


def _estimate_indices(a: Vector, ab: Vector, b: Vector) -> tuple[Vector, Vector]:
    """Return first-order and total index of a factor from values for A, A with the factor of B, and B.

    References:
        A. Saltelli et al., Computer Physics Communications 181 (2010), p. 259, table 2, (b) and (f).
    """
    variance = np.var(np.concatenate([a, b]), axis=0)
    varies = variance > np.finfo(float).eps

    def share(parts: Vector) -> Vector:
        return np.divide(parts.mean(axis=0), variance, out=np.zeros_like(variance), where=varies)

    return share(b * (ab - a)), share(0.5 * (a - ab) ** 2)


def local_sensitivities(result: SweepResult, figure: str) -> list[LocalSensitivity]:
    """Return a figure with each factor alone low and high, the factor with the largest effect first.

    Variant 0 is the nominal one. Low and high of each factor follow.

    Raises:
        CommandError: The sampling is another, or the figure does not exist.
    """
    check_sampling(result, ONE_AT_A_TIME, "local sensitivities")
    figures = read_figure_by_variant(result, figure, 1 + 2 * len(result.factors))
    nominal, *values = (None if np.isnan(value) else float(value) for value in figures)
    rows = [
        LocalSensitivity(name, low, high, nominal)
        for name, low, high in zip(result.factors, values[::2], values[1::2], strict=True)
    ]
    return sorted(rows, key=lambda row: -row.effect)


def check_sampling(result: SweepResult, sampling: str, subject: str) -> None:
    """Raise CommandError if a sweep has another sampling. `subject` is what needs it, for the message."""
    if result.sampling != sampling:
        raise CommandError(
            f"the sweep '{result.name}' has the sampling {result.sampling}; {subject} need the sampling "
            f"{sampling}.",
            sampling=result.sampling,
        )


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
    """Return the quantiles of all numeric figures with their intervals, over variants that are done."""
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
