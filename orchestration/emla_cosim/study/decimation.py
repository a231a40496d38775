"""The last samples of signals: at the steps of a run, and at an eighth and a 64th of their rate."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..base.arrays import Indices, Vector

_EIGHTH = 8
"""Samples of a group that becomes one sample at the next lower rate."""

_LOWEST_RATE = 100.0
"""Samples per second that the lowest rate has at least."""

CHUNK = 16384
"""Samples kept at the rate of the steps, and after how many of them the lower rates get theirs."""

_KEPT = (CHUNK, 4096, 8192)
"""Samples kept at the highest, the middle and the lowest rate: 1.6, 3.3 and 52 s of steps of 0.1 ms."""

_RISING = np.arange(0.5, _EIGHTH) / _EIGHTH**2
"""Weights of the group before the last. A triangle is a box, twice."""

_FALLING = _RISING[::-1].copy()
"""Weights of the last group."""


class SampleRates:
    """The last samples of some signals at up to three rates, the highest first.

    Attributes:
        rates: Samples per second.
        every: Steps from one sample to the next, by rate.
    """

    def __init__(self, channels: int, step: float) -> None:
        """Prepare for samples of some signals, one each `step` in s."""
        self.every = [1]
        while len(self.every) < len(_KEPT) and 1.0 / (step * self.every[-1] * _EIGHTH) >= _LOWEST_RATE:
            self.every.append(self.every[-1] * _EIGHTH)
        self.rates = [1.0 / (step * every) for every in self.every]
        self.count = 0
        """Number of steps so far."""
        self._chunk = np.empty((channels, CHUNK), dtype=np.float32)
        """A ring: the samples of the last chunk, which new ones replace. Tones need few digits."""
        self._lower = [np.zeros((channels, 0)) for _ in self.every[1:]]
        """Samples of the lower rates from all complete chunks, as far as they are kept."""
        self._before = [np.zeros((channels, 1)) for _ in self.every[1:]]
        """Weighted sums of the last groups, which the next samples need."""

    def add(self, signals: Sequence[Vector]) -> Iterator[list[int]]:
        """Keep samples, and yield after each chunk which rates have new samples only.

        Args:
            signals: Samples of all signals, each part of shape (signals of the part, samples).
        """
        first, samples = 0, signals[0].shape[1]
        while first < samples:
            at = self.count % CHUNK
            last = min(first + CHUNK - at, samples)
            row = 0
            with np.errstate(over="ignore"):  # of a run that diverges
                for part in signals:
                    self._chunk[row : row + len(part), at : at + last - first] = part[:, first:last]
                    row += len(part)
            self.count += last - first
            first = last
            if self.count % CHUNK == 0:
                decimated = self._decimated(slice(None), CHUNK)
                for i, (new, before) in enumerate(decimated):
                    kept = np.concatenate([self._lower[i], new], axis=1)
                    self._lower[i] = kept[:, -_KEPT[i + 1] :]
                    self._before[i] = before
                chunks = self.count // CHUNK
                yield [i for i, each in enumerate(self.every) if chunks % self._period(i, each) == 0]

    def _period(self, number: int, every: int) -> int:
        """Return the number of chunks after which all samples at a rate are new."""
        return max(_KEPT[number] * every // CHUNK, 1)

    def _decimated(self, channels: Any, steps: int) -> list[tuple[Vector, Vector]]:
        """Return the samples of the lower rates in the first steps of the chunk, and their last sums."""
        samples, decimated = self._chunk[channels, :steps].astype(float), list[tuple[Vector, Vector]]()
        for before in self._before:
            groups = samples[:, : samples.shape[1] // _EIGHTH * _EIGHTH].reshape(len(samples), -1, _EIGHTH)
            with np.errstate(invalid="ignore"):  # of a run that diverges
                rising = np.concatenate([before[channels], _weighted(groups, _RISING)], axis=1)
                samples = rising[:, :-1] + _weighted(groups, _FALLING)
            decimated.append((samples, rising[:, -1:].copy()))
        return decimated

    def samples(self, number: int, channels: Indices, first: int) -> Vector:
        """Return the samples of some signals at a rate that are kept, from a number on."""
        at = self.count % CHUNK
        if number == 0:
            old = self._chunk[channels, at:] if self.count >= CHUNK else np.zeros((len(channels), 0))
            kept = np.concatenate([old, self._chunk[channels, :at]], axis=1).astype(float)
        else:
            new = self._decimated(channels, at)[number - 1][0]
            kept = np.concatenate([self._lower[number - 1][channels], new], axis=1)
        return kept[:, max(first - self.available(number) + kept.shape[1], 0) :]

    def available(self, number: int) -> int:
        """Return the number of samples at a rate so far."""
        return self.count // self.every[number]

    def kept(self, number: int) -> int:
        """Return how many samples at a rate are kept at least, if there were so many."""
        return _KEPT[number]

    def gains(self, number: int, frequencies: Vector) -> Vector:
        """Return the gains of the filters in front of a rate at frequencies in Hz."""
        gains = np.ones(len(frequencies))
        for rate in self.rates[1 : number + 1]:
            gains *= np.square(np.sinc(frequencies / rate) / np.sinc(frequencies / (rate * _EIGHTH)))
        return gains

    def memory(self) -> dict[str, Any]:
        """Return the state as plain data."""
        filled = min(self.count, CHUNK)
        arrays = [self._chunk[:, :filled], *self._lower, *self._before]
        return {"count": self.count, "arrays": [base64.b64encode(x.tobytes()).decode() for x in arrays]}

    def remember(self, memory: Mapping[str, Any]) -> None:
        """Continue from `memory`; raise ValueError, TypeError or KeyError if it belongs to another run."""
        channels = len(self._chunk)
        first, *rest = (base64.b64decode(x) for x in memory["arrays"])
        chunk = np.frombuffer(first, dtype=np.float32).reshape(channels, -1)
        others = [np.frombuffer(x).reshape(channels, -1) for x in rest]
        self.count = int(memory["count"])
        self._chunk[:, : chunk.shape[1]] = chunk
        self._lower, self._before = others[: len(self._lower)], others[len(self._lower) :]


def _weighted(groups: Vector, weights: Vector) -> Vector:
    """Return the weighted sum of each group.

    Large products start threads of the BLAS library, which wait for more work at the cost of the run.
    """
    signals, count, _ = groups.shape
    whole = count - count % _PRODUCT
    parts = groups[:, :whole].reshape(signals, -1, _PRODUCT, _EIGHTH) @ weights
    if whole == count:
        return parts.reshape(signals, count)
    return np.concatenate([parts.reshape(signals, whole), groups[:, whole:] @ weights], axis=1)


_PRODUCT = 256
"""Groups in a product."""
