"""Compute the residuals of connections (used value minus source), and their effect on oscillations."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Vector, read_stored_array
from ...master.algorithms.continuous_connections import ContinuousConnection
from .members import members
from .steps import PRODUCTS, Steps, Use, integral

LAGS = 3
"""Residuals of a step are multiplied with those of the same step and of the two previous steps."""

ALTERNATING = 0.3
"""Smallest correlation over two steps of alternating residuals; white noise has 0, and 0.05 by chance."""

UNRESOLVED = 0.8
"""Residuals above this fraction of the signal's variation always count; pure white noise has 0.69."""

SMALLEST_SHARE = 0.01
"""Smallest variation of a signal, as a fraction of its size, to which residuals are compared."""


@dataclass(frozen=True)
class Residual:
    """The coupling error of one connection.

    Only the part of residuals and motion that lasts from one step to the next counts, which excludes noise.
    Two other kinds of residuals count, too: those that alternate in sign, as in an unstable exchange but not
    in noise, and those nearly as large as the signal's variation.

    Args:
        relative: Rms of the residual, divided by the signal's standard deviation.
        radians: Phase in rad through which the signal oscillates, at its mean frequency.
        centre: Mean time of the motion, as a fraction of the run: 0.5 for a steady oscillation, more for a
            growing one.
    """

    relative: float
    radians: float
    centre: float

    @property
    def accumulated(self) -> float:
        """Fraction of its amplitude that an undamped oscillation may gain or lose by the residual."""
        return self.relative * self.radians


class Residuals:
    """Sum up residuals and the variation of signals, step by step."""

    def __init__(self, connections: Sequence[ContinuousConnection]) -> None:
        self.connections = list(connections)
        own = [members(x, self.connections) for x in self.connections]
        groups = {x.group: m.connections for x, m in zip(self.connections, own, strict=True) if x.group >= 0}
        single = [x for x in self.connections if x.group < 0]
        self._kinds: dict[tuple[int, bool, int], int] = {}
        for x in single:
            self._kinds.setdefault(_kind(x), len(self._kinds))
        self._members = dict(zip((x.name for x in self.connections), own, strict=True))
        self._groups = groups
        self._squares = np.zeros((LAGS, len(self._kinds)))
        self._products = {
            number: np.zeros((LAGS, len(inside), len(inside))) for number, inside in groups.items()
        }
        self._signals = sorted({x.signal for x in self.connections})
        self._origin: Vector = np.zeros(len(self._signals))
        self._moments = np.zeros((5, len(self._signals)))
        self._time, self._start = 0.0, np.nan

    @property
    def columns(self) -> set[int]:
        """Required columns of rows, time first."""
        inside = (x.signal for group in self._groups.values() for x in group)
        return {1 + signal for signal in (*self._signals, *inside)}

    def take(self, lately: Sequence[Steps], place: Mapping[int, int]) -> None:
        """Take the next steps, and the two steps before each.

        Args:
            lately: The steps, the previous steps, and the steps before those.
            place: Position of each column of rows in the steps.
        """
        steps = lately[0]
        lengths, weights = steps.weighted, steps.counts
        columns = [place[1 + signal] for signal in self._signals]
        values = steps.end[:, columns]
        change = values - steps.begin[:, columns]
        if not self._time:
            self._origin, self._start = values[0].copy(), float(steps.begin[0, 0])
        values = values - self._origin
        before = (steps.begin[:, columns] - steps.before[:, columns]) * steps.ratio
        squares, since = change * before / steps.lengths[:, None], weights * (steps.end[:, 0] - self._start)
        self._moments += (
            lengths @ values,
            lengths @ values**2,
            weights @ np.abs(change),
            weights @ squares,
            since @ squares,
        )
        self._time += float(lengths.sum())
        if self._kinds:
            uses = [Use(place[c], late, mode) for c, late, mode in self._kinds]
            now, *before = (steps.residuals(uses) for steps in lately)
            self._squares += [_products(lengths, now, then) for then in (now, *before)]
        for number, inside in self._groups.items():
            uses = [Use(place[1 + x.signal], x.is_late, x.mode) for x in inside]
            now, *before = (steps.residuals(uses) for steps in lately)
            self._products[number] += [integral(lengths, now, then) for then in (now, *before)]

    def figures(self, responses: Mapping[int, Vector]) -> dict[str, Residual]:
        """Return the coupling error of each connection so far; see `loop_responses`."""
        if not self._time:
            return dict.fromkeys((x.name for x in self.connections), Residual(np.nan, np.nan, np.nan))
        mean, square, path, speeds, late = self._moments / self._time
        variance = np.maximum(square - mean**2, 0.0)
        size = np.sqrt(square + 2.0 * mean * self._origin + self._origin**2)
        varied = np.maximum(np.sqrt(variance), SMALLEST_SHARE * size)
        moves = speeds > 0.0
        lasts = np.divide(path**2, speeds, out=np.zeros_like(path), where=moves)
        frequency = np.sqrt(np.maximum(speeds, 0.0))
        radians = np.divide(frequency, varied, out=np.zeros_like(path), where=varied > 0.0)
        radians *= np.minimum(lasts, 1.0) * self._time
        centre = np.divide(late, speeds, out=np.zeros_like(path), where=moves) / self._time
        by_signal = dict(
            zip(
                self._signals, zip(*(x.tolist() for x in (varied, radians, centre)), strict=True), strict=True
            )
        )
        found = {}
        for x in self.connections:
            if x.group < 0:
                products = self._squares[:, self._kinds[_kind(x)]]
            else:
                row = self._members[x.name].row(responses)
                products = row @ self._products[x.group] @ row
            extent, *motion = by_signal[x.signal]
            same, next_, next_but_one = (products / self._time).tolist()
            rms = _lasting_residual(same, next_, next_but_one, extent)
            found[x.name] = Residual(rms / extent if rms else rms, *motion)
        return found

    def memory(self) -> dict[str, Any]:
        """Return the state as plain data, from which another object can continue."""
        return {
            "time": self._time,
            "start": self._start,
            "origin": self._origin.tolist(),
            "moments": self._moments.tolist(),
            "squares": self._squares.tolist(),
            "products": {str(number): products.tolist() for number, products in self._products.items()},
        }

    def remember(self, memory: Any) -> None:
        """Restore the state from `memory`."""
        self._time, self._start = float(memory["time"]), float(memory["start"])
        for name, values in (
            ("origin", self._origin),
            ("moments", self._moments),
            ("squares", self._squares),
        ):
            values[:] = read_stored_array(memory[name], values.shape)
        for number, products in self._products.items():
            products[:] = read_stored_array(memory["products"][str(number)], products.shape)


def _lasting_residual(same: float, next_: float, next_but_one: float, extent: float) -> float:
    """Return the rms of the residuals that count, from the means of their products over 0, 1 and 2 steps."""
    rms = math.sqrt(max(same, 0.0))
    alternates = next_ < 0.0 and next_but_one > ALTERNATING * same
    return rms if alternates or rms > UNRESOLVED * extent else math.sqrt(max(next_, 0.0))


def _kind(x: ContinuousConnection) -> tuple[int, bool, int]:
    return 1 + x.signal, x.is_late, x.mode


def _products(lengths: Vector, first: Vector, second: Vector) -> Vector:
    """Return the integrals of the products of the same column in both."""
    return np.einsum("k,kai,ab,kbi->i", lengths, first, PRODUCTS, second, optimize=True)
