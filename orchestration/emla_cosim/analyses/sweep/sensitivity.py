"""Compute Sobol indices and local sensitivities of the figures of a sweep."""

import contextlib
import math
import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ..variants.data import SweepData
from .columns import figure_by_variant, figure_values, find_varying_figures, variant_numbers

SALTELLI, ONE_AT_A_TIME = "saltelli", "one-at-a-time"
"""The samplings for Sobol indices and local sensitivities."""


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
        every = self.groups + self.left_out
        return (
            f"{self.left_out} of {every} base samples are left out of the Sobol indices of "
            f"'{self.figure}': one of their variants lacks the figure. This biases the indices if the cause "
            "of the failures also changes the figure. Use a figure that every variant has, or narrow the "
            "ranges."
        )

    def record(self) -> dict[str, Any]:
        """Return the entry for sweep.json."""
        numbers = {
            name: [x if math.isfinite(x) else None for x in getattr(self, name).tolist()] for name in _INDICES
        }
        kept = {"factors": list(self.factors), **numbers, "groups": self.groups, "left_out": self.left_out}
        return {**kept, "warning": self.warning}


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
        known = [value for value in self[1:] if value is not None]
        return max(known) - min(known) if known else 0.0


def sobol_indices(result: SweepData, figure: str) -> SobolIndices:
    """Return the Sobol indices of a figure from a Saltelli sample: N (d + 2) rows for d factors.

    A base sample counts only if all of its d + 2 variants have the figure (see `figure_values`). All indices
    of a constant figure are 0.

    Raises:
        CommandError: The sampling is another, the figure does not exist, or there are too few base samples.
    """
    check_sampling(result, SALTELLI, "Sobol indices")
    rows = len(result.factors) + 2
    count = -(-(int(variant_numbers(result).max(initial=-1)) + 1) // rows)
    values = figure_by_variant(result, figure, count * rows).reshape(count, rows)
    whole = values[~np.isnan(values).any(axis=1)]
    if len(whole) < 2:
        raise CommandError(
            f"{len(whole)} of {count} base samples of the sweep '{result.name}' have the figure '{figure}' "
            f"in all of their {rows} variants; Sobol indices need at least 2, for useful results hundreds.",
            figure=figure,
        )
    indices = _indices(result, figure, whole)
    return SobolIndices(
        figure, tuple(result.factors), *indices, groups=len(whole), left_out=count - len(whole)
    )


def all_sobol_indices(result: SweepData) -> dict[str, SobolIndices]:
    """Return the Sobol indices of every figure that varies and has them, by its name."""
    found = dict[str, SobolIndices]()
    for figure in find_varying_figures(result):
        with contextlib.suppress(CommandError):  # too few variants have it
            found[figure] = sobol_indices(result, figure)
    return found


def _indices(result: SweepData, figure: str, values: Vector) -> list[Vector]:
    """Return first-order indices, their confidence, total indices, and their confidence."""
    largest = float(np.max(np.abs(values)))
    if np.ptp(values) <= 1e-12 * largest:
        return [np.zeros(len(result.factors)) for _ in range(4)]
    if np.ptp(values[:, [0, -1]]) <= 1e-12 * largest:
        raise CommandError(
            f"the figure '{figure}' of the sweep '{result.name}' varies in too few variants for Sobol "
            "indices; use more samples.",
            figure=figure,
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # from SALib's imports, and for constant resamples
        from SALib.analyze import sobol

        found = sobol.analyze(
            {"num_vars": len(result.factors), "names": list(result.factors)},
            values.ravel() / largest,
            calc_second_order=False,
            seed=result.seed + 1,  # SALib treats 0 as no seed
        )
    return [np.asarray(found[key], float) for key in ("S1", "S1_conf", "ST", "ST_conf")]


def local_sensitivities(result: SweepData, figure: str) -> list[LocalSensitivity]:
    """Return a figure with each factor alone low and high, the factor with the largest effect first.

    Variant 0 is the nominal one. Low and high of each factor follow.

    Raises:
        CommandError: The sampling is another, or the figure does not exist.
    """
    check_sampling(result, ONE_AT_A_TIME, "local sensitivities")
    count = 1 + 2 * len(result.factors)
    figure_values(result, figure)  # raises if the figure does not exist
    if int(variant_numbers(result).max(initial=-1)) >= count:
        raise CommandError(
            f"the sweep '{result.name}' has variants beyond the {count} that one-at-a-time has for "
            f"{len(result.factors)} factors: the nominal one, and a low and a high one for each."
        )
    nominal, *others = (
        None if np.isnan(value) else float(value) for value in figure_by_variant(result, figure, count)
    )
    found = [
        LocalSensitivity(name, low, high, nominal)
        for name, low, high in zip(result.factors, others[::2], others[1::2], strict=True)
    ]
    return sorted(found, key=lambda one: -one.effect)


def check_sampling(result: SweepData, sampling: str, what: str) -> None:
    """Raise CommandError if a sweep has another sampling. `what` is what needs it, for the message."""
    if result.sampling != sampling:
        raise CommandError(
            f"the sweep '{result.name}' has the sampling {result.sampling}; {what} need the sampling "
            f"{sampling}.",
            sampling=result.sampling,
        )
