"""The result of a sweep: one row for every variant, and recorded signals over time."""

import json
import shlex
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars

from ...base.arrays import Mask
from ...base.errors import CommandError, check_choice
from ...base.files import read_text
from ...base.values import convert_value
from ...recorders.metrics import HELD, MetricDisplay
from ..frame.report import ReportedResult
from ..variants.factors import Target, assign_value, format_arguments, merge_options
from ..variants.measures import DONE, PROBLEM, STATUS, VARIANT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .sensitivity import SobolIndices

NOT_HELD = "not held"
"""Outcome of a variant that is done but has a verdict `held` that is not true."""

TABLE, RECORD, SERIES, PARTS = "variants.parquet", "sweep.json", "series", "parts"
DESIGN = "design.parquet"
"""In `PARTS`: the columns of all variants that are known before they run."""

NUMBERED = "[0-9]*.parquet"
"""Pattern of parts."""

COMPLETED, UNFINISHED_SWEEP = "completed", "unfinished"

ENDS = {VARIANT: polars.Int64, STATUS: polars.String, PROBLEM: polars.String, "end_s": polars.Float64}
"""Columns of every part, before those of the figures."""


@dataclass(frozen=True, repr=False)
class SweepResult(ReportedResult):
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
        displays: labels and units of the metrics that tables show.
        verdicts: names of the metrics that say whether an object, such as a joint, is held.
        folder: folder of the sweep; None if it is deleted together with the result.
        complete: whether all variants are done.
        required: conditions of the option `require`.
        base: command that runs the scenario; None if there is none.
        targets: start values and options that each factor sets.
        wall_s: wall time in s.
        notes: notes to read before the metrics, without full stops.
        record: content of `sweep.json`.
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
    displays: Mapping[str, MetricDisplay] = field(default_factory=dict)
    verdicts: Sequence[str] = ()
    folder: Path | None = None
    complete: bool = True
    required: Sequence[str] = ()
    base: Sequence[str] | None = None
    targets: Mapping[str, Sequence[Target]] = field(default_factory=dict)
    wall_s: float = 0.0
    notes: Sequence[str] = ()
    record: Mapping[str, Any] = field(default_factory=dict)
    resources: object = field(default=None, compare=False)

    @property
    def is_done(self) -> Mask:
        """Whether the variant of each row is done."""
        return (self.variants[STATUS] == DONE).to_numpy()

    @property
    def good_outcome(self) -> str:
        """The name of the good outcome: held, or done if the sweep has no verdict."""
        return HELD if self.verdicts else DONE

    @property
    def outcomes(self) -> "np.ndarray[Any, Any]":
        """The outcome of the variant of each row: its status; "not held" if done but not held.

        A variant is not held if one of its verdicts is false or missing.
        """
        outcomes = np.array(self.variants[STATUS].to_list(), dtype=object)
        for figure in self.verdicts:
            is_held = (self.variants[figure].cast(polars.Float64) == 1.0).fill_null(False).to_numpy()
            outcomes[self.is_done & ~is_held] = NOT_HELD
        return outcomes

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
        if self.base is None or (arguments := format_arguments(self.options(variant))) is None:
            return None
        return shlex.join([*self.base, *arguments])

    def sobol(self, figure: str) -> "SobolIndices":
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
        from .sensitivity import sobol_indices

        indices = sobol_indices(self, figure)
        if indices.warning is not None:
            warnings.warn(indices.warning, stacklevel=2)
        return indices

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
        from .report import PICTURES

        check_choice("picture", kind, PICTURES)
        return PICTURES[kind][0](self, names)


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
        >>> result = ec.sweep("lift", plan, stop_time=0.01, output="kept")
        >>> ec.read_sweep("kept").variants.height
        2
    """
    path = convert_value(folder, Path, "the folder of the sweep")
    record = read_record(path)
    try:
        parts = None if record["status"] == COMPLETED else read_parts(path, record["figures"])
        if parts is None:
            record = read_record(path)  # it may be complete by now
            parts = polars.read_parquet(path / TABLE), sorted((path / SERIES).glob("*.parquet"))
        return make_result(path, record, *parts)
    except (OSError, KeyError, TypeError, ValueError, polars.exceptions.PolarsError) as error:
        raise CommandError(f"'{path}' has no readable sweep: {error}.") from error


def make_result(
    folder: Path, record: Mapping[str, Any], variants: polars.DataFrame, signals: list[Path]
) -> SweepResult:
    """Return the result with this record, these variants and the files of their signals."""
    series = None
    if signals:  # each is sorted by variant, but retried chunks come late
        series = polars.scan_parquet(signals).sort(VARIANT, maintain_order=True)
    held_figures = [name for name in record["figures"] if name.endswith(f".{HELD}")]  # of earlier versions
    fields = ("name", "sampling", "seed", "figures", "signals", "units", "required", "base")
    return SweepResult(
        **{name: record[name] for name in fields},
        factors=list(record["factors"]),
        variants=variants,
        series=series,
        displays={name: MetricDisplay(**display) for name, display in record["shown"].items()},
        verdicts=record.get("verdicts", held_figures),
        folder=folder,
        complete=record["status"] == COMPLETED,
        targets={name: [Target(**t) for t in targets] for name, targets in record["factors"].items()},
        wall_s=record.get("wall_s", 0.0),
        notes=record.get("notes", ()),
        record=record,
    )


def read_record(folder: Path) -> dict[str, Any]:
    """Read sweep.json in a folder. Raise CommandError if it cannot be read."""
    try:
        record = json.loads(read_text(folder / RECORD, "the record of the sweep"))
    except ValueError as error:
        raise CommandError(f"'{folder / RECORD}' cannot be read: {error}.") from error
    if not isinstance(record, dict):
        raise CommandError(f"'{folder / RECORD}' is not the record of a sweep.")
    return record


def read_parts(folder: Path, figures: Sequence[str]) -> tuple[polars.DataFrame, list[Path]] | None:
    """Return the finished variants of a sweep that is not complete, and the files of its signals.

    The result is None if the parts are gone: the sweep is complete.
    """
    parts = sorted((folder / PARTS).glob(NUMBERED))
    empty = polars.DataFrame(schema=ENDS | dict.fromkeys(figures, polars.Float64))
    try:
        tables = [polars.read_parquet(file) for file in parts] or [empty]
        about = polars.read_parquet(folder / PARTS / DESIGN)
    except FileNotFoundError:
        return None
    signals = [file for part in parts if (file := folder / SERIES / part.name).exists()]
    return about.join(polars.concat(tables), on=VARIANT, how="inner").sort(VARIANT), signals
