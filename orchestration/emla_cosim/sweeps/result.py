"""What came out of a sweep: one row for every variant, and some signals over time."""

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
    """What came out of a sweep.

    `variants` has a row for each variant, sorted: `variant` (its number, from 0), a column for each of
    `factors` (what varies), `status` (one of the names in `data`), `problem` (a sentence, or null) and a
    column for each of `figures`: numbers or truths, null or NaN where there is none. `series` has
    `variant`, `time` and the `signals` that were kept, a row for each row of each variant; None where
    none were. `units` are those of factors and signals, by name; `shown` says how a person sees a figure,
    where that is known. `sampling` is the name of the method and `seed` its seed. `complete` says whether
    all variants are there, `required` what each had to fulfil, `wall_s` how long they took. `base` is the
    command that runs the scenario as all variants have it, None where there is none, and `targets` where
    values of each factor go. `notes` are sentences, without their stops, to read before the figures.
    `folder` is None where it goes with the result.
    """

    def options(self, variant: int) -> dict[str, Any]:
        """The options that are a variant's own; CommandError where there is no such variant."""
        rows = self.variants.filter(polars.col(VARIANT) == variant)
        if not rows.height:
            raise CommandError(f"there is no variant {variant}.", variant=variant)
        row = rows.row(0, named=True)
        return merge_options(assign_value(self.targets[name], row[name]) for name in self.factors)

    def command(self, variant: int) -> str | None:
        """The command that runs a variant alone; None where its scenario or an option is of Python alone."""
        if self.base is None or (own := format_arguments(self.options(variant))) is None:
            return None
        return shlex.join([*self.base, *own])

    def sobol(self, figure: str) -> SobolIndices:
        """Return the Sobol indices of a figure, such as `lift.held`; needs the sampling `saltelli`.

        Warns (UserWarning) where base samples are left out, as this biases the indices. Raises CommandError
        for another sampling, a figure that the sweep does not have, or too few base samples.
        """
        found = sobol_indices(self, figure)
        if found.warning is not None:
            warnings.warn(found.warning, stacklevel=2)
        return found

    def plot(self, kind: str, *names: str) -> "Figure":
        """Draw `bands` of signals over time, `figures` against factors, `tornado`, `sobol` or `map`.

        `names` are the signals or figures to show; a map shows one figure. Raises CommandError for a name
        that is not there, and where the sweep has nothing for the picture, such as `tornado` of another
        sampling than one-at-a-time.
        """
        return draw_picture(self, kind, names)
