"""Find tones in signals that last or grow: by the spectrum, and by the trend of its amplitudes.

Short-time spectra show a tone as a peak. The logarithm of its amplitude over time is a straight line if the
tone lasts, grows or decays exponentially, as a linear system does. Noise, also in a narrow band, scatters
around any line. What known inputs cause, such as a sine in the disturbance, is removed by least squares.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ..base.arrays import Vector

# enough to tell what four inputs cause
FEWEST_WINDOWS = 12
"""Least number of windows for a trend."""

FEWEST_CYCLES = 12.0
"""Least number of cycles of a tone."""

# 13 dB; of the lower quartile, as bins around a tone may have other tones
_MIN_PROMINENCE = 20.0
"""Least power of a tone relative to the lower quartile of the bins around it."""

# a quick test, which noise without tones fails
_MIN_STEEPNESS = 4.0
"""Least power of a tone relative to a bin beside its main lobe."""

_SHORTEST_PART = 32
"""Parts down to this fraction of the time are searched."""

_BINS_BESIDE = 5
"""Bins beside a peak that are compared with it."""

# narrow-band noise has 0.6 (Rayleigh distribution)
_MAX_SCATTER = 0.15
"""Largest standard deviation of the log amplitude from its trend."""

# noise reaches 3
_MIN_CONTRAST = 4.0
"""Least power of a tone that comes and goes relative to that at other times."""

_MIN_NOISE_SCATTER = 0.2
"""Least scatter of the log amplitude of noise around a smooth curve over three times such a part."""

_ENDED_RATIO = 25.0
"""A tone that has ended must be this much larger than one that continues."""

# a tone that decays faster ends by itself
_MIN_LASTING_GROWTH = -0.06
"""Least growth in 1/s of a tone that lasts."""

_TREND_ERROR = 0.25
"""Largest uncertainty of the log amplitude's change over a segment of a tone that lasts."""

# beyond three standard errors
_MIN_GROWTH = 0.03
"""Least growth in 1/s that is certain."""

_MIN_CHANGE = 0.12
"""Least change of the log amplitude of a tone that grows."""

# noise in a narrow band seems to grow for a while, too
_MIN_LATE_CHANGE = 3.0
"""The same for a tone that grows in less than half of the time."""

_MIN_EXPLAINED = 0.8
"""Least part of the log amplitude's variance that the trend of a growing tone explains."""

_MAX_PHASE_SCATTER = 0.5
"""Largest standard deviation in rad of the phase of a growing tone from a parabola over time."""

_MIN_PEAK_SHARE = 0.75
"""Least part of the power in one peak of a tone."""

# narrow-band noise has about 1
_MAX_JUMP = 0.7
"""Largest change of the log power of a tone from window to window."""

_FORCED_SHARE = 0.5
"""A tone is caused by the inputs if they explain at least this part of its amplitude."""

# a steady input leaves more of a tone that grows
_FORCED_SHARE_GROWING = 0.4
"""Largest part of a growing tone that inputs leave unexplained which cause it."""

Spectra = NDArray[np.complex128]
"""Amplitudes by signal, window and frequency."""


@dataclass(frozen=True)
class Tone:
    """A tone that lasts or grows.

    Attributes:
        signal: Number of the signal.
        frequency: In Hz.
        growth: Growth of the amplitude in 1/s.
        amplitude: Mean amplitude in the second half of the time, in the unit of the signal.
        amplitudes_of_signals: Amplitudes of all signals at this frequency.
        start, end: Samples at which the time begins and ends.
        is_growing: Whether the growth is certain.
        bin: Frequency bin.
        windows: First window and the one after the last.
    """

    signal: int
    frequency: float
    growth: float
    amplitude: float
    amplitudes_of_signals: Vector
    start: int
    end: int
    is_growing: bool
    bin: int
    windows: tuple[int, int]


class Grid(NamedTuple):
    """How signals are cut into windows.

    Attributes:
        rate: Samples per second.
        length: Samples of a window.
        hop: Samples from a window to the next.
        bins: First frequency bin and the one after the last.
        is_flat: Whether to remove a parabola from each window: what is slower than the window.
    """

    rate: float
    length: int
    hop: int
    bins: tuple[int, int]
    is_flat: bool = True


class _Trend(NamedTuple):
    """The straight line through log amplitudes over time, for any number of signals and frequencies."""

    growth: Any
    error: Any
    scatter: Any
    explained: Any


def cut_windows(samples: Vector, grid: Grid) -> Vector:
    """Return windows of signals, shape (signals, windows, length), without copying."""
    return sliding_window_view(samples, grid.length, axis=1)[:, :: grid.hop]


def compute_spectra(samples: Vector, grid: Grid) -> Spectra:
    """Return short-time spectra, scaled so that a sine has its amplitude, of Hann windows."""
    windows = cut_windows(samples, grid)
    taper, trend = _compute_taper(grid.length)
    if grid.is_flat:
        windows = windows - (windows @ trend) @ trend.T
    return np.fft.rfft(windows * taper, axis=-1)


@lru_cache(maxsize=64)
def _compute_taper(length: int) -> tuple[Vector, Vector]:
    """Return the window, and orthonormal polynomials up to the second degree, shape (length, 3)."""
    hann = np.hanning(length + 1)[:length]
    return hann * 2.0 / hann.sum(), _compute_polynomials(length, 2)


def _compute_polynomials(length: int, degree: int) -> Vector:
    """Return orthonormal polynomials up to a degree at equal distances, shape (length, degree + 1)."""
    t = np.linspace(-1.0, 1.0, length)
    basis = list[Vector]()
    for power in range(degree + 1):
        remainder = t**power
        for _ in range(2):  # once more, for the sake of rounding
            for earlier in basis:
                remainder = remainder - np.dot(earlier, remainder) * earlier
        basis.append(remainder / np.sqrt(np.dot(remainder, remainder)))
    return np.stack(basis, axis=1)


class ToneSearch:
    """Searches the samples of some signals for tones.

    Args:
        signals: Samples, shape (signals, samples).
        inputs: Returns samples of what may cause tones, shape (inputs, samples).
        grid: How they are cut into windows.
        gains: Amplitude of what is in the samples relative to the signal, by frequency bin.
    """

    def __init__(self, signals: Vector, inputs: Callable[[], Vector], grid: Grid, gains: Vector) -> None:
        self._inputs, self._grid, self._gains = inputs, grid, gains
        self._spectra = compute_spectra(signals, grid)
        self._power = self._spectra.real**2 + self._spectra.imag**2
        self._cumulative: dict[int, Vector] = {}

    @property
    def count(self) -> int:
        """Number of windows."""
        return self._power.shape[1]

    def squares_above(self, bin_: int) -> Vector:
        """Return the mean square of the first signal in each window, from a frequency bin on."""
        return self._power[0, :, bin_:].sum(axis=1) / 3.0  # a sine has 3/2 of its squared amplitude

    def is_tone_above(self, bin_: int) -> bool:
        """Return whether the first signal is a tone rather than noise from a frequency bin on.

        One peak has most of its power, and this changes little from window to window.
        """
        mean = self._power[0, :, bin_:].mean(axis=0)
        lobe = np.convolve(mean, np.ones(3), "same").max() / max(float(mean.sum()), 1e-300)
        jumps = np.diff(np.log(np.maximum(self.squares_above(bin_), 1e-300)))
        return bool(lobe > _MIN_PEAK_SHARE and np.median(np.abs(jumps)) < _MAX_JUMP)

    def lasting(self, floors: Sequence[float]) -> Iterator[Tone]:
        """Yield tones that last and are larger than these amplitudes, the largest of each signal.

        Searches all time, then halves, quarters and so on: a tone may have begun late, or ended early.
        """
        for signal, floor in enumerate(floors):
            limits = (floor * self._gains) ** 2
            if not self._is_loud(signal, limits):
                continue
            decaying, tones = list[tuple[int, int, int]](), list[Tone]()
            segments = list(_cut_segments(self.count))
            for number, q in self._find_peaks(signal, limits, segments):
                first, last = segments[number]
                trend = self._find_trend(signal, q, first, last)
                if trend is None:
                    continue
                if trend.growth + 2.0 * trend.error < _MIN_LASTING_GROWTH:
                    decaying.append((q, first, last))
                    continue
                # a part of what decays over a longer time must be certain not to decay
                is_part = any(abs(q - p) < 2 and a <= first and last <= b for p, a, b in decaying)
                certain = trend.growth - (2.0 * trend.error if is_part else 0.0) > _MIN_LASTING_GROWTH
                if last - first < self.count and self._is_intermittent(signal, q, first, last):
                    continue
                power = float(self._power[signal, first:last, q].mean())
                if last < self.count and power < _ENDED_RATIO**2 * limits[q]:
                    continue
                if certain and trend.error * self._get_duration(first, last) < _TREND_ERROR:
                    tones.append(self._build_tone(signal, q, first, last, trend.growth))
            forced: set[int] = set()
            for tone in sorted(tones, key=lambda tone: -tone.amplitude):
                if tone.bin in forced:
                    continue
                if not self._is_forced(tone):
                    # the longest of similar tones
                    yield next(t for t in tones if t.bin not in forced and t.amplitude > 0.5 * tone.amplitude)
                    break
                forced.add(tone.bin)

    def growing(self, floors: Sequence[float]) -> Iterator[Tone]:
        """Yield tones that grow until the end and have become larger than these amplitudes, by signal."""
        count = self.count
        parts = [count >> i for i in range(count.bit_length()) if count >> i >= FEWEST_WINDOWS]
        for signal, floor in enumerate(floors) if parts else ():
            limits = (floor * self._gains) ** 2
            for number, q in self._find_peaks(signal, limits, [(count - part // 2, count) for part in parts]):
                first = count - parts[number]
                trend = self._find_trend(signal, q, first, count)
                if trend is None or trend.explained < _MIN_EXPLAINED:
                    continue
                change = trend.growth * self._get_duration(first, count)
                least = _MIN_CHANGE if 2 * first <= count + 1 else _MIN_LATE_CHANGE
                if trend.growth - 3.0 * trend.error < _MIN_GROWTH or change < least:
                    continue
                tone = self._build_tone(signal, q, first, count, trend.growth, True)
                if self._is_steady(tone) and not self._is_forced(tone):
                    yield tone

    def _is_loud(self, signal: int, limits: Vector) -> bool:
        """Return whether a tone above limits may be in an eighth of the windows or more."""
        low, high = self._grid.bins
        length = -(-self.count // 8)
        means = (
            np.add.reduceat(self._power[signal, :, low:high], np.arange(0, self.count, length), axis=0)
            / length
        )
        return bool((means > 0.25 * limits[low:high]).any())

    def _find_peaks(
        self, signal: int, limits: Vector, segments: Sequence[tuple[int, int]]
    ) -> Iterator[tuple[int, int]]:
        """Yield prominent peaks above limits in segments of windows: number of the segment, frequency bin."""
        first, last = np.array(segments, dtype=int).reshape(-1, 2).T
        sums = self._accumulate_power(signal)
        power = (sums[last] - sums[first]) / (last - first)[:, np.newaxis]
        low, high = self._grid.bins[0], min(self._grid.bins[1], len(limits))
        inner_power = power[:, low:high]
        is_peak = (inner_power >= power[:, low - 1 : high - 1]) & (inner_power > power[:, low + 1 : high + 1])
        rows, bins = np.nonzero(is_peak & (inner_power > limits[low:high]))
        bins = bins + low
        power_beside = np.minimum.reduce([power[rows, np.maximum(bins + i, 0)] for i in (-4, -3, 3, 4, 5)])
        is_steep = power[rows, bins] > _MIN_STEEPNESS * power_beside
        for number, q in zip(rows[is_steep].tolist(), bins[is_steep].tolist(), strict=True):
            bins_of_segment = power[number, :-_BINS_BESIDE].tolist()
            around = sorted([*bins_of_segment[max(q - 8, 2) : q - 2], *bins_of_segment[q + 3 : q + 9]])
            if not around or bins_of_segment[q] > _MIN_PROMINENCE * around[len(around) // 4]:
                yield number, q

    def _accumulate_power(self, signal: int) -> Vector:
        """Return the sums of the power of all windows before each, with bins of no power beyond the last."""
        if signal not in self._cumulative:
            sums = np.zeros((self.count + 1, self._power.shape[2] + _BINS_BESIDE))
            np.cumsum(self._power[signal], axis=0, out=sums[1:, :-_BINS_BESIDE])
            self._cumulative[signal] = sums
        return self._cumulative[signal]

    def _compute_amplitudes(self, signals: Any, bins: slice, first: int, last: int) -> Vector:
        """Return amplitudes of tones: three bins contain the main lobe of the window."""
        width = bins.stop - bins.start
        power = np.concatenate(
            [self._power[signals, first:last], self._power[signals, first:last, -2:-1]], axis=-1
        )
        lobes = sum(power[..., bins.start + i : bins.start + i + width] for i in (-1, 0, 1))
        return np.sqrt(lobes / 1.5)

    def _fit_trend(self, logs: Vector) -> _Trend:
        """Return the trend of log amplitudes along the axis of windows, which is the second last."""
        count, hop = logs.shape[-2], self._grid.hop / self._grid.rate
        t = (np.arange(count) - 0.5 * (count - 1)) * hop
        squares = float(t @ t)
        growth = np.einsum("...kq,k->...q", logs, t) / squares
        total = logs.var(axis=-2) * count
        residual = np.maximum(total - growth**2 * squares, 0.0)
        scatter = np.sqrt(residual / (count - 2))
        overlap = max(self._grid.length / self._grid.hop / 2.0, 1.0)  # such windows are not independent
        explained = 1.0 - residual / np.maximum(total, 1e-300)
        return _Trend(growth, scatter * np.sqrt(overlap / squares), scatter, explained)

    def _find_trend(self, signal: int, q: int, first: int, last: int) -> _Trend | None:
        """Return the trend of a tone; None if it is too short, or noise."""
        if self._get_duration(first, last) * q * self._grid.rate / self._grid.length < FEWEST_CYCLES:
            return None
        amplitudes = self._compute_amplitudes(signal, slice(q, q + 1), first, last)
        trend = self._fit_trend(np.log(np.maximum(amplitudes, 1e-300)))
        return None if trend.scatter[0] > _MAX_SCATTER else _Trend(*(float(x[0]) for x in trend))

    def _is_intermittent(self, signal: int, q: int, first: int, last: int) -> bool:
        """Return whether a tone is as large just before or after, and changes there as only noise does."""
        length = last - first
        start, end = max(first - length, 0), min(last + length, self.count)
        amplitudes = self._compute_amplitudes(signal, slice(q, q + 1), start, end)[:, 0]
        logs, smooth = np.log(np.maximum(amplitudes, 1e-300)), _compute_polynomials(end - start, 4)
        if np.std(logs - smooth @ (smooth.T @ logs)) < _MIN_NOISE_SCATTER:
            return False
        squares = amplitudes * amplitudes
        inside = float(squares[first - start : last - start].sum())
        outside = float(squares.sum()) - inside
        return inside / length < _MIN_CONTRAST * outside / (end - start - length)

    def _is_steady(self, tone: Tone) -> bool:
        """Return whether the phase of a tone is that of a sine."""
        signal, q, (first, last) = tone.signal, tone.bin, tone.windows
        # factors that let the phase of a tone in the middle of a bin stand still
        rotation = np.exp(-2j * np.pi * q * self._grid.hop / self._grid.length * np.arange(first, last))
        phase = np.unwrap(np.angle(self._spectra[signal, first:last, q] * rotation))
        curve = _compute_polynomials(last - first, 2)  # the frequency may change with the amplitude
        return bool(np.std(phase - curve @ (curve.T @ phase)) < _MAX_PHASE_SCATTER)

    def _is_forced(self, tone: Tone) -> bool:
        """Return whether the inputs cause a tone: whether their tones of this frequency explain it."""
        inputs = self._inputs()
        if not len(inputs):
            return False
        q, (first, last) = tone.bin, tone.windows
        taper, trend = _compute_taper(self._grid.length)
        windows = cut_windows(inputs, self._grid)[:, first:last]
        angle = 2.0 * np.pi * q / self._grid.length * np.arange(self._grid.length)
        waves = taper[:, np.newaxis] * np.stack([np.cos(angle), -np.sin(angle)], axis=1)
        parts = windows @ (waves - trend @ (trend.T @ waves))
        causes = (parts[..., 0] + 1j * parts[..., 1]).T
        sizes = np.sqrt(np.mean(np.abs(causes) ** 2, axis=0))
        audible = sizes > 1e-9 * np.maximum(np.ptp(inputs, axis=1), 1e-300)
        residual, basis = self._spectra[tone.signal, first:last, q], list[Spectra]()
        norm_before = np.linalg.norm(residual)
        for cause in (causes[:, audible] / sizes[audible]).T:  # least squares by orthogonal causes
            for earlier in basis:
                cause = cause - np.vdot(earlier, cause) * earlier
            if (norm := float(np.linalg.norm(cause))) > 1e-6:
                basis.append(cause / norm)
                residual = residual - np.vdot(basis[-1], residual) * basis[-1]
        limit = _FORCED_SHARE_GROWING if tone.is_growing else 1.0 - _FORCED_SHARE
        return bool(np.linalg.norm(residual) < limit * norm_before)

    def _get_duration(self, first: int, last: int) -> float:
        """Return the time in s that windows cover."""
        return ((last - first - 1) * self._grid.hop + self._grid.length) / self._grid.rate

    def _build_tone(
        self, signal: int, q: int, first: int, last: int, growth: float, is_growing: bool = False
    ) -> Tone:
        """Return the tone at frequency bin `q` in the windows from `first` to before `last`."""
        middle = (first + last) // 2
        amplitudes = (
            self._compute_amplitudes(slice(None), slice(q, q + 1), middle, last)[..., 0].mean(axis=1)
            / self._gains[q]
        )
        lobe = np.sqrt(self._power[signal, first:last, q - 1 : q + 2].mean(axis=0))
        side = 1 if len(lobe) > 2 and lobe[2] > lobe[0] else -1
        ratio = float(lobe[1 + side] / lobe[1])
        offset = side * (2.0 * ratio - 1.0) / (1.0 + ratio)  # from the main lobe of a Hann window
        return Tone(
            signal=signal,
            frequency=(q + offset) * self._grid.rate / self._grid.length,
            growth=growth,
            amplitude=float(amplitudes[signal]),
            amplitudes_of_signals=amplitudes,
            start=first * self._grid.hop,
            end=(last - 1) * self._grid.hop + self._grid.length,
            is_growing=is_growing,
            bin=q,
            windows=(first, last),
        )


def _cut_segments(count: int) -> Iterator[tuple[int, int]]:
    """Yield all windows, then halves, quarters and so on, which overlap by half: first, and last plus one."""
    length = count
    while length >= max(FEWEST_WINDOWS, count // _SHORTEST_PART):
        for last in range(count, length - 1, -max(length // 2, 1)):
            yield last - length, last
        length //= 2
