"""Compute minimum, maximum, root mean square and final value of every signal."""

from typing import Any

import numpy as np

from ..base.arrays import Vector, read_stored_array
from ..stepper.library import reduce_rows
from .recorder import RunLayout

MINIMUM, MAXIMUM, RMS, FINAL = NAMES = ("minimum", "maximum", "rms", "final")
"""Names of the figures in metrics.json; each is in the signal's unit."""

_SQUARED = 1e150
"""Squares of numbers above this, or below its inverse, can overflow or underflow."""


class SignalFigures:
    """Compute the figures of the recorded signals from rows, time first.

    All points have the same weight in the root mean square. A figure is NaN without rows, or if a value is
    NaN, and may be infinite if a value is. Strings have none.
    """

    def __init__(self, layout: RunLayout, state: Any = None) -> None:
        """Begin, or continue from a `state`; ValueError or KeyError if it is from another run."""
        texts = set(layout.text_columns)
        columns = [1 + i for i in layout.recorded if 1 + i not in texts]
        self._names = [layout.names[i - 1] for i in columns]
        has_all_columns = columns == list(range(1, 1 + len(layout.names)))
        self._columns = None if has_all_columns else np.array(columns, dtype=int)
        self._rows = 0
        self._values = np.full((len(NAMES), len(self._names)), np.nan)
        if state is not None:
            self._rows = int(state["rows"])
            self._values = read_stored_array([state[name] for name in NAMES], self._values.shape)

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        if not self._names:  # only texts are recorded
            self._rows += len(rows)
            return
        selected = np.ascontiguousarray(rows if self._columns is None else rows[:, self._columns])
        with np.errstate(all="ignore"):
            block = np.stack((*_reduce_rows(selected), selected[-1]))
            if self._columns is None:
                block = block[:, 1:]
            self._values = _merge_figures(self._values, self._rows, block, len(rows)) if self._rows else block
        self._rows += len(rows)

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data, from which another object can continue."""
        values = dict(zip(NAMES, self._values.tolist(), strict=True))
        return {"rows": self._rows, **values}

    def figures(self) -> dict[str, dict[str, float]]:
        """Return the figures of all rows so far, by the full name of the signal."""
        columns = self._values.T.tolist()
        return {
            name: dict(zip(NAMES, values, strict=True))
            for name, values in zip(self._names, columns, strict=True)
        }


def _reduce_rows(rows: Vector) -> tuple[Vector, Vector, Vector]:
    """Return minimum, maximum and root mean square of every column."""
    low, high, squares = reduce_rows(rows)
    rms = np.sqrt(squares / len(rows))
    peak = np.maximum(np.abs(low), np.abs(high))
    unsquared = np.isfinite(peak) & (peak > 0) & ((peak > _SQUARED) | (peak < 1 / _SQUARED))
    if unsquared.any():
        largest = peak[unsquared]
        rms[unsquared] = largest * np.sqrt(np.mean((rows[:, unsquared] / largest) ** 2, axis=0))
    return low, high, rms


def _merge_figures(before: Vector, rows: int, after: Vector, more: int) -> Vector:
    """Return the figures of `rows` rows and `more` later ones together, in the order of `NAMES`."""
    total_rows = rows + more
    return np.stack(
        (
            np.minimum(before[0], after[0]),
            np.maximum(before[1], after[1]),
            # hypot: the squares themselves could overflow
            np.hypot(before[2] * np.sqrt(rows / total_rows), after[2] * np.sqrt(more / total_rows)),
            after[3],
        )
    )
