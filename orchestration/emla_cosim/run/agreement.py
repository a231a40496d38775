"""Compare a result with a stored run: which signals stay in the tubes around it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.tolerances import Comparison, describe_departure, select_outside

if TYPE_CHECKING:  # importing it loads polars
    from ..inputs.stored_runs import StoredRun

_MOST_NAMES = 3
"""Most signals to name in a message; run.json has all."""


def find_common_signals(names: Sequence[str], stored: "StoredRun") -> list[str]:
    """Return the signals that both have. Raise CommandError if there are none."""
    stored.match_names(names)
    stored_names = set(stored.names)
    common = [name for name in names if name in stored_names]
    if not common:
        raise CommandError(
            f"the reference run '{stored.path}' has none of the recorded signals; it has "
            f"{stored.names[0]} and {len(stored.names) - 1} more."
        )
    return common


def align_values(
    time: Vector, values: Any, reference_time: Vector, reference: Any
) -> tuple[Vector, Vector, Vector]:
    """Return values, times of the reference and its values as doubles.

    Texts become numbers, equal for equal texts. Their reference gets the times of the values.
    """
    if object not in (values.dtype, reference.dtype):
        return values.astype(float), reference_time, reference.astype(float)
    # texts are held until the next row, and a rounded time counts as the same
    last = np.searchsorted(reference_time, time + 1e-9 * np.abs(time), side="right") - 1
    texts = np.concatenate([values.astype(str), reference[np.maximum(last, 0)].astype(str)])
    numbers = np.unique(texts, return_inverse=True)[1].astype(float)
    inside = (last >= 0) & (time <= reference_time[-1])
    return numbers[: len(values)], time[inside], numbers[len(values) :][inside]


def describe_disagreement(comparisons: Sequence[Comparison], stored: "StoredRun") -> str | None:
    """Return a message about the signals that left their tubes, earliest first, or None if all agree."""
    outside = select_outside(comparisons)
    if not outside:
        return None
    departures = "; ".join(describe_departure(c) for c in outside[:_MOST_NAMES])
    more = f"; and {len(outside) - _MOST_NAMES} more" if len(outside) > _MOST_NAMES else ""
    return (
        f"{len(outside)} of {len(comparisons)} signals do not agree with '{stored.path}': {departures}{more}."
    )


def describe_missing_part(end: float, step: float, stored: "StoredRun") -> str | None:
    """Return a message if a stored run continues for more than a step after the end of a run; times in s."""
    last = float(stored.read(["time"])["time"][-1])
    if last <= end + (1.0 + 1e-6) * step:
        return None
    return f"The run ended at {end:.6g} s, but '{stored.path}' continues until {last:.6g} s."


def agreement_record(comparisons: Sequence[Comparison], stored: "StoredRun") -> dict[str, Any]:
    """Return the entry of run.json: the number of signals, and those that left their tubes."""
    return {
        "run": str(stored.path),
        "signals": len(comparisons),
        "left": [
            {
                "signal": c.signal,
                "left_at_s": c.left_at,
                "worst": c.worst,
                "worst_at_s": c.worst_at,
                "tube": c.tube.value,
                "tube_s": c.tube.time,
            }
            for c in select_outside(comparisons)
        ],
    }
