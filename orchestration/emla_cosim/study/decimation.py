"""The last samples of signals: at the steps of a run, and at an eighth and a 64th of their rate."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..base.arrays import Indices, Vector

_FACTOR = 8
"""Samples of a group that becomes one sample at the next lower rate."""

_LOWEST_RATE = 100.0
"""Samples per second that the lowest rate has at least."""

CHUNK = 16384
"""Samples kept at the rate of the steps, and after how many of them the lower rates get theirs."""

_CAPACITIES = (CHUNK, 4096, 8192)
"""Samples kept at the highest, the middle and the lowest rate: 1.6, 3.3 and 52 s of steps of 0.1 ms."""

_RISING_WEIGHTS = np.arange(0.5, _FACTOR) / _FACTOR**2
"""Weights of the group before the last. A triangle is a box, twice."""

_FALLING_WEIGHTS = _RISING_WEIGHTS[::-1].copy()
"""Weights of the last group."""


class SampleRates:
    """The last samples of some signals at up to three rates, the highest first.

    Attributes:
        rates: Samples per second.
        steps_per_sample: Steps from one sample to the next, by rate.
    """

    def __init__(self, channels: int, step: float) -> None:
        """Prepare for samples of some signals, one each `step` in s."""
        self.steps_per_sample = [1]
        while (
            len(self.steps_per_sample) < len(_CAPACITIES)
            and 1.0 / (step * self.steps_per_sample[-1] * _FACTOR) >= _LOWEST_RATE
        ):
            self.steps_per_sample.append(self.steps_per_sample[-1] * _FACTOR)
        self.rates = [1.0 / (step * steps_per_sample) for steps_per_sample in self.steps_per_sample]
        self.count = 0
        """Number of steps so far."""
        # half of the memory, which is 64 KiB for each signal
        self._chunk = np.empty((channels, CHUNK), dtype=np.float32)
        """A ring: the samples of the last chunk, which new ones replace. Tones need few digits."""
        self._lower = [np.zeros((channels, 0)) for _ in self.steps_per_sample[1:]]
        """Samples of the lower rates from all complete chunks, as far as they are kept."""
        self._last_sums = [np.zeros((channels, 1)) for _ in self.steps_per_sample[1:]]
        """Weighted sums of the last groups, which the next samples need."""

    def add(self, signals: Sequence[Vector]) -> Iterator[list[int]]:
        """Keep samples, and yield after each chunk the numbers of the rates whose kept samples are all new.

        Args:
            signals: Samples of all signals, each part of shape (signals of the part, samples).
        """
        first, samples = 0, signals[0].shape[1]
        while first < samples:
            position = self.count % CHUNK
            last = min(first + CHUNK - position, samples)
            row = 0
            with np.errstate(over="ignore"):  # of a run that diverges
                for part in signals:
                    self._chunk[row : row + len(part), position : position + last - first] = part[
                        :, first:last
                    ]
                    row += len(part)
            self.count += last - first
            first = last
            if self.count % CHUNK == 0:
                decimated = self._decimate(slice(None), CHUNK)
                for i, (new_samples, last_sums) in enumerate(decimated):
                    retained = np.concatenate([self._lower[i], new_samples], axis=1)
                    self._lower[i] = retained[:, -_CAPACITIES[i + 1] :]
                    self._last_sums[i] = last_sums
                chunks = self.count // CHUNK
                # after so many chunks, all samples at a rate are new
                periods = [
                    max(capacity * steps // CHUNK, 1)
                    for capacity, steps in zip(_CAPACITIES, self.steps_per_sample, strict=False)
                ]
                yield [i for i, period in enumerate(periods) if chunks % period == 0]

    def _decimate(self, channels: Any, steps: int) -> list[tuple[Vector, Vector]]:
        """Return for each lower rate the samples from the first steps of the chunk, and their last sums."""
        samples, decimated = self._chunk[channels, :steps].astype(float), list[tuple[Vector, Vector]]()
        for last_sums in self._last_sums:
            groups = samples[:, : samples.shape[1] // _FACTOR * _FACTOR].reshape(len(samples), -1, _FACTOR)
            with np.errstate(invalid="ignore"):  # of a run that diverges
                rising = np.concatenate([last_sums[channels], _sum_groups(groups, _RISING_WEIGHTS)], axis=1)
                samples = rising[:, :-1] + _sum_groups(groups, _FALLING_WEIGHTS)
            decimated.append((samples, rising[:, -1:].copy()))
        return decimated

    def samples(self, number: int, channels: Indices, first: int) -> Vector:
        """Return the kept samples of some signals at rate `number`, from the `first` one of the run on."""
        position = self.count % CHUNK
        if number == 0:
            earlier = (
                self._chunk[channels, position:] if self.count >= CHUNK else np.zeros((len(channels), 0))
            )
            retained = np.concatenate([earlier, self._chunk[channels, :position]], axis=1).astype(float)
        else:
            later = self._decimate(channels, position)[number - 1][0]
            retained = np.concatenate([self._lower[number - 1][channels], later], axis=1)
        return retained[:, max(first - self.available(number) + retained.shape[1], 0) :]

    def available(self, number: int) -> int:
        """Return the number of samples at a rate so far."""
        return self.count // self.steps_per_sample[number]

    def capacity(self, number: int) -> int:
        """Return how many samples at a rate are kept at least, if there were so many."""
        return _CAPACITIES[number]

    def gains(self, number: int, frequencies: Vector) -> Vector:
        """Return the gains of the filters in front of a rate at frequencies in Hz."""
        gains = np.ones(len(frequencies))
        for rate in self.rates[1 : number + 1]:
            gains *= np.square(np.sinc(frequencies / rate) / np.sinc(frequencies / (rate * _FACTOR)))
        return gains

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data."""
        filled = min(self.count, CHUNK)
        arrays = [self._chunk[:, :filled], *self._lower, *self._last_sums]
        # lists of numbers would take many times the room in a checkpoint
        return {"count": self.count, "arrays": [base64.b64encode(x.tobytes()).decode() for x in arrays]}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state; raise ValueError, TypeError or KeyError if it is of another run."""
        channels = len(self._chunk)
        first, *encoded = (base64.b64decode(x) for x in state["arrays"])
        chunk = np.frombuffer(first, dtype=np.float32).reshape(channels, -1)
        arrays = [np.frombuffer(x).reshape(channels, -1) for x in encoded]
        self.count = int(state["count"])
        self._chunk[:, : chunk.shape[1]] = chunk
        self._lower, self._last_sums = arrays[: len(self._lower)], arrays[len(self._lower) :]


def _sum_groups(groups: Vector, weights: Vector) -> Vector:
    """Return the weighted sum of each group.

    Large products start threads of the BLAS library, which wait for more work at the cost of the run.
    """
    signals, count, _ = groups.shape
    divisible = count - count % _GROUPS_PER_PRODUCT
    parts = groups[:, :divisible].reshape(signals, -1, _GROUPS_PER_PRODUCT, _FACTOR) @ weights
    if divisible == count:
        return parts.reshape(signals, count)
    return np.concatenate([parts.reshape(signals, divisible), groups[:, divisible:] @ weights], axis=1)


# below the size from which BLAS libraries use threads
_GROUPS_PER_PRODUCT = 256
"""Groups in a product."""
