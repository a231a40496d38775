"""Statistics over the seeds of a comparison: mean and spread of each figure, and winners seed by seed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import NamedTuple

from ...base.wording import format_rounded
from ...recorders.metrics import HELD, MetricDisplay
from .rows import RANDOM, SEED, Row, label_variant
from .text_table import Cell, resolution

LEVEL = 0.05
"""Largest probability of a wrong winner in a row."""


@dataclass(frozen=True)
class SeedStatistics:
    """The runs of a joint with one controller in one case, which differ only in their seeds."""

    rows: Sequence[Row]

    @property
    def controller_variant(self) -> str:
        """The controller with its gains."""
        return label_variant(self.rows[0])

    @property
    def controller(self) -> str:
        """The name of the controller."""
        return str(self.rows[0]["controller"])

    @property
    def is_held(self) -> bool:
        """Whether the joint was held in all runs."""
        return all(row[HELD] for row in self.rows)

    @property
    def lost(self) -> list[Row]:
        """The runs in which the joint was not held."""
        return [row for row in self.rows if not row[HELD]]

    def mean(self, figure: str) -> float | None:
        """Return the mean of a figure over all runs, in the unit of metrics.json; None if a run lacks it."""
        values = self._values(figure)
        return None if values is None else fmean(values)

    def spread(self, figure: str) -> float:
        """Return the standard deviation of a figure over the runs (n - 1); 0 for a single run."""
        values = self._values(figure)
        return stdev(values) if values is not None and len(values) > 1 else 0.0

    def largest(self, figure: str) -> float | None:
        """Return the largest value of a figure among the runs in which the joint was not held."""
        return max((row[figure] for row in self.lost if _is_known(row[figure])), default=None)

    def _values(self, figure: str) -> list[float] | None:
        values = [row[figure] for row in self.rows]
        return values if all(map(_is_known, values)) else None


def group_by_variant(rows: Sequence[Row]) -> dict[str, SeedStatistics]:
    """Return the rows of one joint in one case, grouped by controller and gains, in their order."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(label_variant(row), []).append(row)
    return {variant: SeedStatistics(own) for variant, own in found.items()}


class Ranking(NamedTuple):
    """The controller with the smallest mean of a figure, and in how many runs it is below all others.

    Attributes:
        best: The controller with its gains.
        wins: The number of seeds with which it is below every other controller.
        seeds: The number of compared seeds; 0 if nothing is random.
        is_winner: Whether this is more than chance.
    """

    best: str
    wins: int
    seeds: int
    is_winner: bool


def rank(found: Mapping[str, SeedStatistics], figure: MetricDisplay) -> Ranking | None:
    """Compare a figure seed by seed; only joints that were held in all runs count.

    Without random sequences, the smallest figure wins. With them, a win is a seed with which the controller
    is below all others. The winner is the controller with the smallest mean if its number of wins is
    significant in a sign test. Figures that differ by less than the last digit shown are equal.

    Returns:
        The ranking; None if there are not two controllers to compare.
    """
    means = {
        name: mean
        for name, one in found.items()
        if one.is_held and (mean := one.mean(figure.name)) is not None
    }
    if len(means) < 2:
        return None
    best = min(means, key=lambda name: means[name])
    by_seed = {name: {row[SEED]: float(row[figure.name]) for row in found[name].rows} for name in means}
    seeds = {seed for values in by_seed.values() for seed in values} - {None} or {None}
    for values in by_seed.values():
        if None in values:  # a run without random sequences is the same with every seed
            values |= dict.fromkeys(seeds, values[None])
    pairs = [seed for seed in seeds if all(seed in values for values in by_seed.values())]
    best_values = by_seed.pop(best)
    wins = sum(
        all(_is_below(best_values[seed], values[seed], figure) for values in by_seed.values())
        for seed in pairs
    )
    if not any(row[RANDOM] for name in means for row in found[name].rows):
        return Ranking(best, wins, 0, bool(wins))
    return Ranking(best, wins, len(pairs), is_significant(wins, len(pairs)))


def is_significant(wins: int, seeds: int) -> bool:
    """Return whether a number of wins is more than chance in a two-sided sign test.

    The test covers all controllers of a row together. In a seed only one controller is below all others, so
    the probabilities of wrong winners add up to at most that of two equal controllers.

    References:
        Dixon, W. J., and Mood, A. M.: The statistical sign test. J. Am. Stat. Assoc. 41, 1946.
    """
    from scipy.stats import binomtest  # slow to import

    return 2 * wins > seeds and bool(binomtest(wins, seeds).pvalue <= LEVEL)


def fewest_wins(seeds: int) -> int | None:
    """Return the smallest significant number of wins; None if even all seeds are too few."""
    return next((wins for wins in range(seeds // 2, seeds + 1) if is_significant(wins, seeds)), None)


def _is_below(value: float, other: float, figure: MetricDisplay) -> bool:
    """Return whether a figure is below another one by at least a unit of the last digit that tables show."""
    a, b = figure.factor * value, figure.factor * other
    return b > a and b - a >= (1.0 - 1e-9) * resolution(b)


def mark_winner(found: Mapping[str, SeedStatistics], figure: MetricDisplay) -> dict[str, Cell]:
    """Return the cells of a row by controller and gains: means, spreads, wins and the winner."""
    cells = {name: _cell(one, figure) for name, one in found.items()}
    if ranking := rank(found, figure):
        text = cells[ranking.best].text
        if ranking.seeds and ranking.wins:
            text = f"{text}, wins {ranking.wins} of {ranking.seeds}"
        cells[ranking.best] = Cell(text, best=ranking.is_winner)
    return cells


def format_mean(one: SeedStatistics, figure: MetricDisplay) -> str:
    """Return a mean as text, in the unit of its row."""
    mean = one.mean(figure.name)
    return "none" if mean is None else format_rounded(figure.factor * mean)


def format_mean_and_spread(one: SeedStatistics, figure: MetricDisplay) -> str:
    """Return a mean as text in the unit of its row, with its spread if there is one."""
    spread = figure.factor * one.spread(figure.name)
    text = format_mean(one, figure)
    return f"{text} ± {float(f'{spread:.2g}'):g}" if spread > 0.0 else text


def format_lost(one: SeedStatistics, figure: MetricDisplay) -> str:
    """Return a text for joints that were not held: in how many runs, and the largest value of a figure."""
    of = "" if len(one.rows) == 1 else f" in {len(one.lost)} of {len(one.rows)}"
    largest = one.largest(figure.name)
    return f"not held{of}" + ("" if largest is None else f" ({format_rounded(figure.factor * largest)})")


def _cell(one: SeedStatistics, figure: MetricDisplay) -> Cell:
    return (
        Cell(format_mean_and_spread(one, figure))
        if one.is_held
        else Cell(format_lost(one, figure), lost=True)
    )


def _is_known(value: float | None) -> bool:
    return value is not None and not math.isnan(value)
