"""Statistics over seeds: means and spreads, winners seed by seed, and unequal terms."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import NamedTuple

from ...base.errors import join_names
from ...base.wording import format_rounded
from ...recorders.metrics import HELD, MetricDisplay
from ..frame.confidence import describe_share
from ..frame.report import Text
from .result import (
    LABELS,
    OBSERVER,
    RANDOM,
    RESERVES,
    SEED,
    Row,
    choose_position_error,
    group_rows,
    label_variant,
)

LEVEL = 0.05
"""Largest probability of a wrong winner in a row."""

FEWEST_SEEDS = math.ceil(1.0 - math.log2(LEVEL))
"""Smallest number of seeds with which a winner can be significant: winning all of n has 2 / 2^n by chance."""

_EFFORT, _MAX_RATIO = "torque_effort_N_m", 1.05
"""The figure of torque effort, and the ratio from which it is not equal: 5 %, about the spread of tilt."""


@dataclass(frozen=True)
class SeedStatistics:
    """The runs of a joint with one controller in one case, which differ only in their seeds."""

    rows: Sequence[Row]

    @property
    def is_held(self) -> bool:
        """Whether the joint was held in all runs."""
        return all(row[HELD] for row in self.rows)

    @property
    def failures(self) -> list[Row]:
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

    def _values(self, figure: str) -> list[float] | None:
        values = [row[figure] for row in self.rows]
        return values if all(map(_is_known, values)) else None


def group_by_variant(rows: Sequence[Row]) -> dict[str, SeedStatistics]:
    """Return the rows of one joint in one case, grouped by controller and gains, in their order."""
    groups = group_rows(rows, "controller", "gains").values()
    return {label_variant(group[0]): SeedStatistics(group) for group in groups}


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


def rank(variants: Mapping[str, SeedStatistics], figure: MetricDisplay) -> Ranking | None:
    """Compare a figure seed by seed; only joints that were held in all runs count.

    Without random sequences, the smallest figure wins. With them, a win is a seed with which the controller
    is below all others. The winner is the controller with the smallest mean if its number of wins is
    significant in a sign test. Figures that differ by less than the last digit shown are equal.

    Returns:
        The ranking; None if there are not two controllers to compare.
    """
    means = {
        name: mean
        for name, summary in variants.items()
        if summary.is_held and (mean := summary.mean(figure.name)) is not None
    }
    if len(means) < 2:
        return None
    best = min(means, key=lambda name: means[name])
    by_seed = {name: {row[SEED]: float(row[figure.name]) for row in variants[name].rows} for name in means}
    # None alone: no run of these controllers has random sequences
    seeds = {seed for values in by_seed.values() for seed in values} - {None} or {None}
    for values in by_seed.values():
        if None in values:  # a run without random sequences is the same with every seed
            values |= dict.fromkeys(seeds, values[None])
    pairs = [seed for seed in seeds if all(seed in values for values in by_seed.values())]
    best_values = by_seed.pop(best)
    # seed by seed: all controllers meet the same disturbance, which the difference cancels
    wins = sum(
        all(_is_below(best_values[seed], values[seed], figure) for values in by_seed.values())
        for seed in pairs
    )
    if not any(row[RANDOM] for name in means for row in variants[name].rows):
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


def find_fewest_wins(seeds: int) -> int | None:
    """Return the smallest significant number of wins; None if even all seeds are too few."""
    return next((wins for wins in range(seeds // 2, seeds + 1) if is_significant(wins, seeds)), None)


def _is_below(value: float, limit: float, figure: MetricDisplay) -> bool:
    """Return whether a figure is below another one by at least a unit of the last digit that tables show."""
    a, b = figure.factor * value, figure.factor * limit
    last_digit = min(1.0, 10.0 ** (math.floor(math.log10(abs(b))) - 2)) if b else 0.0  # as `format_rounded`
    return b > a and b - a >= (1.0 - 1e-9) * last_digit


def mark_winner(variants: Mapping[str, SeedStatistics], figure: MetricDisplay) -> dict[str, Text]:
    """Return the cells of a row by controller and gains: means, spreads, wins and the winner."""
    cells = dict[str, Text]()
    for name, summary in variants.items():
        spread = figure.factor * summary.spread(figure.name)
        deviation = f" ± {float(f'{spread:.2g}'):g}" if spread > 0.0 else ""
        cells[name] = (
            Text(format_mean(summary, figure) + deviation)
            if summary.is_held
            else Text(format_lost(summary, figure), is_failure=True)
        )
    if ranking := rank(variants, figure):
        text = cells[ranking.best].text
        if ranking.seeds and ranking.wins:
            text = f"{text}, wins {ranking.wins} of {ranking.seeds}"
        cells[ranking.best] = Text(text, is_best=ranking.is_winner)
    return cells


def format_mean(summary: SeedStatistics, figure: MetricDisplay) -> str:
    """Return a mean as text, in the unit of its row."""
    mean = summary.mean(figure.name)
    return "none" if mean is None else format_rounded(figure.factor * mean)


def format_lost(summary: SeedStatistics, figure: MetricDisplay) -> str:
    """Return a text for joints that were not held: in how many runs, and the largest value of a figure."""
    of = "" if len(summary.rows) == 1 else f" in {len(summary.failures)} of {len(summary.rows)}"
    largest = max((row[figure.name] for row in summary.failures if _is_known(row[figure.name])), default=None)
    return f"not held{of}" + ("" if largest is None else f" ({format_rounded(figure.factor * largest)})")


def _is_known(value: float | None) -> bool:
    return value is not None and not math.isnan(value)


def describe_ranking(rows: Sequence[Row]) -> list[str]:
    """Return the remarks that belong beside marked winners."""
    return [*_describe_winners(rows), *describe_inequality(rows)]


def _describe_winners(rows: Sequence[Row]) -> list[str]:
    """Return how cells with means are read, and how many wins make a winner; empty if nothing is random."""
    if not any(row[RANDOM] for row in rows):
        return []
    seeds = len({row[SEED] for row in rows} - {None})
    enough = f"use --seeds {FEWEST_SEEDS} or more."
    if seeds < 2:
        return [f"With random effects, one run shows no winner; {enough}"]
    least = find_fewest_wins(seeds)
    marked = (
        f"It is marked as the winner with at least {least} wins (two-sided sign test at {100.0 * LEVEL:g} %)."
        if least
        else f"{seeds} seeds are too few to mark a winner; {enough}"
    )
    return [
        f"± is the standard deviation over {seeds} seeds that no tuning used. Every controller has the same "
        "seeds. The lowest mean shows its wins, the seeds with which it is below all others. " + marked
    ]


def describe_confidence(rows: Sequence[Row]) -> list[str]:
    """Return what the drawn seeds imply for all seeds; empty if no joint ran with several seeds."""
    drawn = [row for row in rows if row[RANDOM] and row[SEED] is not None]
    groups = group_rows(drawn, *LABELS).values()
    counts = {(sum(not row[HELD] for row in runs), len(runs)) for runs in groups if len(runs) > 1}
    shares = "; ".join(describe_share(count, total, "not held") for count, total in sorted(counts))
    return [f"For a joint with one controller, of all seeds that could be drawn: {shares}."] if shares else []


def describe_inequality(rows: Sequence[Row]) -> list[str]:
    """Return the differences between the controllers beside their gains; empty for equal terms."""
    observers, reserves, effort = dict[str, list[str]](), list[str](), list[str]()
    for (joint,), of_joint in group_rows(rows, "joint").items():
        by_observer = group_rows(of_joint, OBSERVER)
        if len(by_observer) > 1:
            names = {
                text: dict.fromkeys(map(label_variant, of_text)) for (text,), of_text in by_observer.items()
            }
            texts = "; ".join(f"{join_names(variants)} {text}" for text, variants in names.items())
            observers.setdefault(texts, []).append(joint)
        if len({row[RESERVES] for row in of_joint}) > 1:
            reserves.append(joint)
        if len({(row["scenario"], row["case"]) for row in of_joint}) == 1:
            effort += _describe_effort(joint, group_by_variant(of_joint))
    remarks = [f"observers of {join_names(joints)}: {texts}." for texts, joints in observers.items()]
    if reserves:
        limited = all("%" in part for row in rows for part in str(row[RESERVES]).split(" and "))
        hint = "; --reserves CURRENT,VOLTAGE sets equal ones" if limited else ""
        remarks.append(f"reserves of {join_names(reserves)}, listed below{hint}.")
    return [f"Not equal: {remark}" for remark in (*remarks, *effort)]


def _describe_effort(joint: str, variants: Mapping[str, SeedStatistics]) -> Iterator[str]:
    """Return a remark if the winner of the position error needs more torque than others that are held."""
    error = choose_position_error([row for summary in variants.values() for row in summary.rows])
    ranking = rank(variants, error)
    if ranking is None or not ranking.is_winner or not (effort := variants[ranking.best].mean(_EFFORT)):
        return
    efforts = {name: summary.mean(_EFFORT) for name, summary in variants.items() if summary.is_held}
    ratios = {name: effort / reference for name, reference in efforts.items() if reference}
    more = [f"{name} ({100.0 * (ratio - 1.0):.0f} %)" for name, ratio in ratios.items() if ratio > _MAX_RATIO]
    if more:
        yield (
            f"{ranking.best} wins the {error.label} of {joint} with more torque effort than "
            f"{join_names(more)}."
        )


def name_observers(rows: Sequence[Row]) -> dict[str, str]:
    """Return the observers of each controller with its gains; if joints differ, the rules without numbers."""
    observers: dict[str, dict[str, None]] = {}
    for row in rows:
        observers.setdefault(label_variant(row), {})[str(row[OBSERVER])] = None
    return {
        name: join_names(dict.fromkeys(text.partition(" ")[0] for text in texts) if len(texts) > 1 else texts)
        for name, texts in observers.items()
    }
