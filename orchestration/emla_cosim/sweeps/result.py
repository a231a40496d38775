"""What came out of a sweep: one row for every variant, and some signals over time."""

import shlex
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars

from ..base.errors import CommandError
from ..recorders.metrics import Shown
from .targets import Target, as_arguments, assigned, merged

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .sensitivity import SobolIndices

DONE, DIVERGED, REFUSED, FAILED, DIED = "done", "diverged", "refused", "failed", "died"
"""How a variant ended: whole; early, in a step; before its first step; by a figure or a requirement; with its
process."""

VARIANT, STATUS, PROBLEM = "variant", "status", "problem"
"""Columns of the table beside those of what varies and of figures."""


@dataclass(frozen=True)
class SweepResult:
    """What came out of a sweep.

    `variants` has a row for each variant, sorted: `variant` (its number, from 0), a column for each of
    `factors` (what varies), `status` (one of the names above), `problem` (a sentence, or null) and a column
    for each of `figures`: numbers or truths, null or NaN where there is none. `series` has `variant`, `time`
    and the `signals` that were kept, a row for each row of each variant; None where none were. `units` are
    those of factors and signals, by name; `shown` says how a person sees a figure, where that is known.
    `sampling` is the name of the method and `seed` its seed. `complete` says whether all variants are
    there, `required` what each had to fulfil, `wall_s` how long they took. `base` is the command that runs
    the scenario as all variants have it, None where there is none, and `targets` where values of each
    factor go. `notes` are sentences, without their stops, to read before the figures. `folder` is
    None where it goes with the result.
    """

    name: str
    sampling: str
    seed: int
    factors: Sequence[str]
    figures: Sequence[str]
    variants: polars.DataFrame
    signals: Sequence[str] = ()
    series: polars.LazyFrame | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    shown: Mapping[str, Shown] = field(default_factory=dict)
    folder: Path | None = None
    complete: bool = True
    required: Sequence[str] = ()
    base: Sequence[str] | None = None
    targets: Mapping[str, Sequence[Target]] = field(default_factory=dict)
    wall_s: float = 0.0
    notes: Sequence[str] = ()
    holds: object = field(default=None, compare=False, repr=False)

    def options(self, variant: int) -> dict[str, Any]:
        """The options that are a variant's own; CommandError where there is no such variant."""
        rows = self.variants.filter(polars.col(VARIANT) == variant)
        if not rows.height:
            raise CommandError(f"there is no variant {variant}.", variant=variant)
        row = rows.row(0, named=True)
        return merged(assigned(self.targets[name], row[name]) for name in self.factors)

    def command(self, variant: int) -> str | None:
        """The command that runs a variant alone; None where its scenario or an option is of Python alone."""
        if self.base is None or (own := as_arguments(self.options(variant))) is None:
            return None
        return shlex.join([*self.base, *own])

    def sobol(self, figure: str) -> "SobolIndices":
        """Return the Sobol indices of a figure, such as `lift.held`; needs the sampling `saltelli`.

        Warns (UserWarning) where base samples are left out, as this biases the indices. Raises CommandError
        for another sampling, a figure that the sweep does not have, or too few base samples.
        """
        from .sensitivity import sobol_indices

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
        from .pictures import picture

        return picture(self, kind, names)
