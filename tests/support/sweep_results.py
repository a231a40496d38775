"""Results of sweeps made by hand."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import polars

from emla_cosim.analyses.sweep.result import SweepResult

Signal = Callable[[int, np.ndarray], Any]
"""Values of a signal, from the number of a variant and times."""


def swept(
    factors: Mapping[str, Any],
    figures: Mapping[str, Any],
    sampling: str = "random",
    status: Sequence[str] | None = None,
    **fields_of_result: Any,
) -> SweepResult:
    """A result with these columns; all variants are done unless `status` says otherwise."""
    columns = {**factors, **figures}
    count = len(status if status is not None else next(iter(columns.values())))
    statuses = ["done"] * count if status is None else list(status)
    table = polars.DataFrame(
        {
            "variant": range(count),
            **factors,
            "status": polars.Series(statuses, dtype=polars.String),
            "problem": polars.Series(
                [None if s == "done" else f"it {s} at 0.3 s." for s in statuses], dtype=polars.String
            ),
            **figures,
        },
        strict=False,
    )
    verdicts = [name for name in figures if name.rpartition(".")[2] == "held"]
    fields: dict[str, Any] = {"name": "made-up", "seed": 0, "verdicts": verdicts, **fields_of_result}
    return SweepResult(
        sampling=sampling, factors=list(factors), figures=list(figures), variants=table, **fields
    )


def series(signals: Mapping[str, Signal], times: Sequence[np.ndarray]) -> polars.LazyFrame:
    """Signals of variants over the times of each."""
    return polars.concat(
        polars.DataFrame(
            {
                "variant": np.full(len(time), i),
                "time": time,
                **{name: np.broadcast_to(signal(i, time), time.shape) for name, signal in signals.items()},
            }
        )
        for i, time in enumerate(times)
    ).lazy()
