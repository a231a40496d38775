"""The result of a sweep: one row for every variant, and recorded signals over time."""

import shlex
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import polars

from ..base.errors import CommandError
from .data import VARIANT, SweepData
from .pictures import draw_picture
from .sensitivity import SobolIndices, sobol_indices
from .targets import assign_value, format_arguments, merge_options

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SweepResult(SweepData):
    """Variants of a sweep with their metrics, and the signals that were kept.

    Attributes:
        name: name of the sweep.
        sampling: name of the sampling.
        seed: its seed.
        factors: names of what varies.
        figures: names of the metrics.
        variants: polars data frame with a row for each variant: `variant` (number from 0), a column for each
            factor, `status`, `problem` (error message or null), and a column for each metric.
        signals: names of the signals that were kept.
        series: lazy polars frame with `variant`, `time` in s and the kept signals; None if there are none.
        units: units of factors and signals by name.
        shown: labels and units of the metrics that tables show.
        folder: folder of the sweep; None if it is deleted together with the result.
        complete: whether all variants are done.
        required: conditions of the option `require`.
        base: command that runs the scenario; None if there is none.
        targets: start values and options that each factor sets.
        wall_s: wall time in s.
        notes: notes to read before the metrics, without full stops.
    """

    def options(self, variant: int) -> dict[str, Any]:
        """Return the options of one variant, by name.

        Raises:
            CommandError: the variant does not exist.
        """
        rows = self.variants.filter(polars.col(VARIANT) == variant)
        if not rows.height:
            raise CommandError(f"there is no variant {variant}.", variant=variant)
        row = rows.row(0, named=True)
        return merge_options(assign_value(self.targets[name], row[name]) for name in self.factors)

    def command(self, variant: int) -> str | None:
        """Return the command that runs one variant; None if an object exists in Python only."""
        if self.base is None or (own := format_arguments(self.options(variant))) is None:
            return None
        return shlex.join([*self.base, *own])

    def sobol(self, figure: str) -> SobolIndices:
        """Return the Sobol indices of a metric. The sampling must be `saltelli`.

        Args:
            figure: name of the metric, such as `lift.held`.

        Returns:
            First-order and total indices by factor, with their confidence.

        Raises:
            CommandError: the sampling or the metric is wrong, or there are too few base samples.

        Warns:
            UserWarning: base samples are left out because variants failed, which biases the indices.
        """
        found = sobol_indices(self, figure)
        if found.warning is not None:
            warnings.warn(found.warning, stacklevel=2)
        return found

    def plot(self, kind: str, *names: str) -> "Figure":
        """Draw a picture of the sweep.

        Args:
            kind: `bands` of signals over time, `figures` against factors, `tornado`, `sobol` or `map`.
            *names: signals or metrics to show; a map shows one metric.

        Returns:
            A matplotlib figure.

        Raises:
            CommandError: a name does not exist, or the sampling does not allow this kind.
        """
        return draw_picture(self, kind, names)
