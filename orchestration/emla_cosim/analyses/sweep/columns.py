"""Read columns of a sweep's table as arrays: figures and factors."""

from dataclasses import dataclass

import numpy as np
import polars

from ...base.arrays import Indices, Vector
from ...base.errors import CommandError, suggest_names
from ...recorders.metrics import MetricDisplay
from ..variants.data import VARIANT
from .result import SweepResult

LARGEST = 1e150
"""Numbers beyond this count as missing: their squares overflow."""


@dataclass(frozen=True, eq=False)
class FactorColumn:
    """A factor: `values` for each variant are numbers, or positions in `levels` if there are levels."""

    name: str
    values: Vector
    levels: tuple[str, ...] | None


def read_factor(result: SweepResult, name: str) -> FactorColumn:
    """Return a factor by name. One that is not numeric has levels, in the order of first occurrence."""
    column = result.variants[name]
    # Booleans, too, have levels: an axis with "false" and "true" is easier to read than 0 and 1
    if column.dtype.is_numeric():
        return FactorColumn(name, _to_numbers(column), None)
    texts = ["none" if value is None else _format_level(value) for value in column.to_list()]
    levels = tuple(dict.fromkeys(texts))
    position = {level: float(i) for i, level in enumerate(levels)}
    return FactorColumn(name, np.array([position[text] for text in texts]), levels)


def find_varying_factors(result: SweepResult) -> list[FactorColumn]:
    """Return the factors with at least two values."""
    return [factor for factor in (read_factor(result, n) for n in result.factors) if _varies(factor.values)]


def figure_values(result: SweepResult, figure: str) -> Vector:
    """Return a figure for each row of the table, Booleans as 0 and 1.

    It is NaN if missing, not finite, beyond `LARGEST`, or of a variant that is not done.

    Raises:
        CommandError: The sweep does not have the figure.
    """
    if figure not in result.figures:
        hint = suggest_names(str(figure), result.figures)
        raise CommandError(f"the sweep '{result.name}' has no figure '{figure}'; {hint}", name=figure)
    values = _to_numbers(result.variants[figure])
    values[~result.is_done] = np.nan
    return values


def read_figure_by_variant(result: SweepResult, figure: str, count: int) -> Vector:
    """Return a figure for the variants 0 to `count` - 1; NaN for one without a row. See `figure_values`."""
    values = np.full(count, np.nan)
    values[variant_numbers(result)] = figure_values(result, figure)
    return values


def variant_numbers(result: SweepResult) -> Indices:
    """Return the variant number of each row."""
    return result.variants[VARIANT].to_numpy().astype(np.intp)


def is_truth(result: SweepResult, figure: str) -> bool:
    """Return whether a figure is Boolean."""
    return result.variants[figure].dtype == polars.Boolean


def find_varying_figures(result: SweepResult) -> list[str]:
    """Return the figures that differ between variants that are done: numbers first, labelled ones before."""
    varying = [figure for figure in result.figures if _varies(figure_values(result, figure))]
    return sorted(varying, key=lambda figure: (is_truth(result, figure), figure not in result.displays))


def nothing_varies_error(result: SweepResult, noun: str) -> CommandError:
    """Return the error for a sweep without such a figure or factor to draw."""
    return CommandError(
        f"no {noun} varies between the variants of the sweep '{result.name}' that are done; there is nothing "
        "to draw."
    )


def main_figure(result: SweepResult) -> str | None:
    """Return the default figure: the first that varies, or else the first."""
    return next(iter([*find_varying_figures(result), *result.figures]), None)


def display_of(result: SweepResult, figure: str) -> MetricDisplay:
    """Return label, factor and unit for displaying a figure. The label begins with the subsystem."""
    display = result.displays.get(figure)
    if display is None:
        return MetricDisplay(figure, figure)
    subsystem = figure.removesuffix(display.name).rstrip(".") if figure.endswith(display.name) else ""
    label = display.label if display.label.startswith(subsystem) else f"{subsystem} {display.label}"
    return MetricDisplay(figure, label, display.factor, display.unit, display.large)


def influence(factor: FactorColumn, values: Vector) -> float:
    """Return the absolute rank correlation of a factor with values, from 0 to 1, without NaN.

    For levels it is the root of the share of the ranks' variance that they explain, corrected for chance.
    """
    is_known = ~(np.isnan(factor.values) | np.isnan(values))
    x, y = factor.values[is_known], values[is_known]
    if not (_varies(x) and _varies(y)):
        return 0.0
    ranks = _rank(y)
    if factor.levels is None:
        return float(abs(np.corrcoef(_rank(x), ranks)[0, 1]))
    _, group = np.unique(x, return_inverse=True)
    count = np.bincount(group)
    # a level for each variant explains everything and says nothing
    if len(count) >= len(y):
        return 0.0
    means = np.bincount(group, ranks) / count
    # many levels explain much by chance: adjusted as the R² of a regression
    unexplained = np.var(ranks - means[group]) / np.var(ranks) * (len(y) - 1) / (len(y) - len(count))
    return float(np.sqrt(max(1.0 - unexplained, 0.0)))


def _rank(values: Vector) -> Vector:
    return polars.Series(values).rank("average").to_numpy()


def _varies(values: Vector) -> bool:
    finite = values[~np.isnan(values)]
    return len(finite) > 1 and float(np.ptp(finite)) > 1e-12 * float(np.max(np.abs(finite)))


def _to_numbers(column: polars.Series) -> Vector:
    values = column.cast(polars.Float64, strict=False).to_numpy().astype(float)  # a copy
    values[~(np.abs(values) <= LARGEST)] = np.nan
    return values


def _format_level(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
