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
    """The result of a sweep.

    Attributes:
        name: Name of the sweep.
        sampling: Name of the sampling.
        seed: Seed of the sampling.
        factors: Names of the factors.
        figures: Names of the figures.
        variants: One row for each variant, sorted: `variant` (number from 0), a column for each factor,
            `status` (a name in `data`), `problem` (message or null) and a column for each figure (number or
            Boolean; null or NaN if missing).
        signals: Names of the recorded signals.
        series: Columns `variant`, `time` in s and the signals; None without signals.
        units: Units of factors and signals by name.
        shown: Label, factor and unit for displaying figures, by name.
        folder: Folder of the sweep; None if it is temporary.
        complete: Whether all variants ran.
        required: Requirements on each variant.
        base: Command that runs the scenario with the options of all variants; None if there is none.
        targets: Targets of the values of each factor.
        wall_s: Duration in s.
        notes: Warnings without periods, to read before the figures.
    """

    def options(self, variant: int) -> dict[str, Any]:
        """Return the options that are specific to a variant. Raise CommandError if it does not exist."""
        rows = self.variants.filter(polars.col(VARIANT) == variant)
        if not rows.height:
            raise CommandError(f"there is no variant {variant}.", variant=variant)
        row = rows.row(0, named=True)
        return merge_options(assign_value(self.targets[name], row[name]) for name in self.factors)

    def command(self, variant: int) -> str | None:
        """Return the command that runs a variant alone; None if it needs objects that only Python has."""
        if self.base is None or (own := format_arguments(self.options(variant))) is None:
            return None
        return shlex.join([*self.base, *own])

    def sobol(self, figure: str) -> SobolIndices:
        """Return the Sobol indices of a figure, such as `lift.held`. The sampling must be `saltelli`.

        Raises:
            CommandError: The sampling is another, the figure does not exist, or there are too few samples.

        Warns:
            UserWarning: Base samples are left out, which biases the indices.
        """
        found = sobol_indices(self, figure)
        if found.warning is not None:
            warnings.warn(found.warning, stacklevel=2)
        return found

    def plot(self, kind: str, *names: str) -> "Figure":
        """Draw `bands` of signals over time, `figures` against factors, `tornado`, `sobol` or `map`.

        Args:
            kind: Name of the picture.
            names: Signals or figures to show; a map shows one figure.

        Raises:
            CommandError: A name does not exist, or the picture needs another sampling: `tornado` needs
                one-at-a-time.
        """
        return draw_picture(self, kind, names)
