"""The result of a sweep: one row for every variant, and recorded signals over time."""

import shlex
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars

from ...base.errors import CommandError
from ...base.values import convert_value
from ...recorders.metrics import HELD, MetricDisplay
from ..variants.data import VARIANT, SweepData
from ..variants.targets import Target, assign_value, format_arguments, merge_options
from .folder import COMPLETED, SERIES, TABLE, SweepFolder, read_unfinished
from .pictures import draw_picture
from .sensitivity import SobolIndices, sobol_indices

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
        verdicts: names of the metrics that say whether an object, such as a joint, is held.
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


def read_sweep(folder: str | Path) -> SweepResult:
    """Read a sweep from its folder: one that is complete, was interrupted or killed, or still runs.

    Args:
        folder: the `output` of the sweep.

    Returns:
        The same as `sweep` returned, or the variants that are finished.

    Raises:
        CommandError: the folder contains no sweep.

    Examples:
        >>> import emla_cosim as ec
        >>> plan = {"lift.plant.motor.R_s": [0.1, 0.2]}
        >>> found = ec.sweep("lift", plan, stop_time=0.01, output="kept")
        >>> ec.read_sweep("kept").variants.height
        2
    """
    place = convert_value(folder, Path, "the folder of the sweep")
    record = SweepFolder.record_of(place)
    try:
        found = None
        if record["status"] != COMPLETED:
            found = read_unfinished(place, record["figures"])
        if found is None:
            record = SweepFolder.record_of(place)  # it may be complete by now
            found = polars.read_parquet(place / TABLE), sorted((place / SERIES).glob("*.parquet"))
        variants, signals = found
        series = None
        if signals:  # each is sorted by variant, but retried chunks come late
            series = polars.scan_parquet(signals).sort(VARIANT, maintain_order=True)
        former = [name for name in record["figures"] if name.endswith(f".{HELD}")]  # of earlier versions
        return SweepResult(
            name=record["name"],
            sampling=record["sampling"],
            seed=record["seed"],
            factors=list(record["factors"]),
            figures=record["figures"],
            variants=variants,
            signals=record["signals"],
            series=series,
            units=record["units"],
            shown={name: MetricDisplay(**shown) for name, shown in record["shown"].items()},
            verdicts=record.get("verdicts", former),
            folder=place,
            complete=record["status"] == COMPLETED,
            required=record["required"],
            base=record["base"],
            targets={name: [Target(**t) for t in targets] for name, targets in record["factors"].items()},
            wall_s=record.get("wall_s", 0.0),
            notes=record.get("notes", ()),
        )
    except (OSError, KeyError, TypeError, ValueError, polars.exceptions.PolarsError) as error:
        raise CommandError(f"'{place}' has no readable sweep: {error}.") from error
