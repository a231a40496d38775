"""Statistics over the seeds of a comparison: mean and spread of each figure, and clear winners."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

from ..base.wording import format_rounded
from ..recorders.metrics import MetricDisplay
from .rows import HELD, Row, label_variant
from .text_table import Cell


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


def find_winner(found: Mapping[str, SeedStatistics], figure: MetricDisplay) -> str | None:
    """Return the controller with the clearly smallest mean of a figure.

    Only joints that were held in all runs count. The smallest mean must be below the next one by more than
    both standard deviations together, and differ from it in the digits that tables show.

    Returns:
        The controller with its gains; None if there is no clear winner or no other controller.
    """
    means = {
        name: mean
        for name, one in found.items()
        if one.is_held and (mean := one.mean(figure.name)) is not None
    }
    if len(means) < 2:
        return None
    best, *others = sorted(means, key=lambda name: means[name])

    def is_clear(other: str) -> bool:
        both = found[best].spread(figure.name) + found[other].spread(figure.name)
        shown = [format_rounded(figure.factor * means[name]) for name in (best, other)]
        return means[other] - means[best] > both and shown[0] != shown[1]

    return best if all(map(is_clear, others)) else None


def mark_winner(found: Mapping[str, SeedStatistics], figure: MetricDisplay) -> dict[str, Cell]:
    """Return the cells of a row of a table by controller and gains, with means, spreads and the winner."""
    best = find_winner(found, figure)
    return {name: _cell(one, figure)._replace(best=name == best) for name, one in found.items()}


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
