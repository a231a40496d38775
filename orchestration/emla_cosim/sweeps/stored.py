"""Read a sweep from its folder."""

from pathlib import Path

import polars

from ..base.errors import CommandError
from ..base.values import convert_value
from ..recorders.metrics import MetricDisplay
from .data import VARIANT
from .folder import COMPLETED, SERIES, TABLE, SweepFolder, read_unfinished
from .result import SweepResult
from .targets import Target


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
