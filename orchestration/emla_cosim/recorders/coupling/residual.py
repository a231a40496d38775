"""What consumers of connections used, less what their sources had, and how that adds up in an oscillation."""

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
"""The residuals of a step are multiplied with those of the same step and of the two before."""

ALTERNATING = 0.3
"""Correlation over two steps of residuals that alternate; that of white noise is 0, and 0.05 by chance."""

UNRESOLVED = 0.8
"""Residuals beyond this part of the signal's variation count in any case; pure white noise has 0.69."""

SMALLEST_SHARE = 0.01
"""A signal that varies by less than this part of its size is judged as if it varied by so much."""


@dataclass(frozen=True)
class Residual:
    """What one connection cost.

    `relative` is the rms of the residual over how much the signal varies. `radians` is how far the signal
    oscillates, at its mean frequency, for as long as its motion lasts. `centre` is when it moves, as a part
    of the time: 0.5 for an oscillation that stays as it is, more for one that grows. Of residuals and of
    motion only what lasts from one step to the next counts, which leaves noise out; residuals that change
    their sign from step to step and keep it over two steps count, too: no noise does that, but an unstable
    exchange does. So do residuals nearly as large as the signal's variation, whatever they are.
    """

    relative: float
    radians: float
    centre: float

    @property
    def accumulated(self) -> float:
        """Return the part of its amplitude that an undamped oscillation may gain or lose by the residual."""
        return self.relative * self.radians


class Residuals:
    """Adds up residuals, step by step, and how the signals vary."""

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
        """The columns that are needed of rows with the time first."""
        inside = (x.signal for group in self._groups.values() for x in group)
        return {1 + signal for signal in (*self._signals, *inside)}

    def take(self, lately: Sequence[Steps], place: Mapping[int, int]) -> None:
        """Take the next steps, and the two before each; `place` says where a column is in them."""
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
        """Return what each connection cost so far; see `loop_responses`."""
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
        """Plain data from which another one can go on."""
        return {
            "time": self._time,
            "start": self._start,
            "origin": self._origin.tolist(),
            "moments": self._moments.tolist(),
            "squares": self._squares.tolist(),
            "products": {str(number): products.tolist() for number, products in self._products.items()},
        }

    def remember(self, memory: Any) -> None:
        """Go on from what `memory` gave."""
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
    """The rms of the residuals that count, from the means of their products over 0, 1 and 2 steps."""
    rms = math.sqrt(max(same, 0.0))
    alternates = next_ < 0.0 and next_but_one > ALTERNATING * same
    return rms if alternates or rms > UNRESOLVED * extent else math.sqrt(max(next_, 0.0))


def _kind(x: ContinuousConnection) -> tuple[int, bool, int]:
    return 1 + x.signal, x.is_late, x.mode


def _products(lengths: Vector, first: Vector, second: Vector) -> Vector:
    """The integrals of the products of the same column in both."""
    return np.einsum("k,kai,ab,kbi->i", lengths, first, PRODUCTS, second, optimize=True)
