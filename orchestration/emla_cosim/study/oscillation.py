"""Detect oscillations of joints: tones in torque, screw or load that last or grow, and loud torque noise.

Samples are kept at up to three rates, and each is searched for the frequencies that suit it. A tone counts
whatever its phase: a drive that works against the spring of its load oscillates as well as one that shakes
its inertia. Where the load force is not known, torque that does not accelerate the joint may reject a force,
and does not count.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from ..base.arrays import Mask, Vector, read_stored_array
from .decimation import SampleRates
from .tones import FEWEST_WINDOWS, Grid, Tone, ToneSearch

TORQUE, ERROR, LOAD, SPEED_REFERENCE, FORCE, DISTURBANCE = range(6)
"""Signals of a joint; the first three are searched, the others may cause tones."""

_SIGNALS, _SEARCHED = 6, 3

NAMES = ("torque", "screw", "load")
"""Names of the signals that are searched."""

_WINDOWS = (128, 64)
"""Samples of a window at the highest and at the middle rate."""

# fewer short steps come before events, and end soon
_MIN_STEPS = 32
"""Steps that tell that steps have become shorter."""

# those below contain the motion; with steps of 0.1 ms it is 230 Hz
_NOISE_BIN = 3
"""First frequency bin of torque noise."""

_NOISE_TIME = 0.05
"""Length in s of the parts of which torque noise has an rms."""

# an impact fills one or two
_NOISE_PARTS = 3
"""Successive loud parts that make noise sustained."""

# ripple of drives is smaller
_MIN_TORQUE_AMPLITUDE = 0.01
"""Amplitude of a lasting tone in the torque relative to its limit."""

_MIN_POSITION_AMPLITUDE = 0.005
"""Amplitude of a lasting tone in a position relative to its window."""

# rounding errors grow, too
_MIN_GROWING_AMPLITUDE = 1e-5
"""Amplitude of a growing tone relative to torque limit or position window."""

_SAME_FREQUENCY = 0.1
"""Largest relative difference between frequencies of one oscillation."""

# a sawtooth with steps from one limit to the other
_MAX_LINE_AMPLITUDE = 2.0 / math.pi
"""Largest amplitude of a line that the steps of a sampled controller make, relative to the limit."""

_MAX_TORQUE_MISMATCH = 0.5
"""Largest part of the torque that may be missing or too much for the acceleration of the joint."""


@dataclass(frozen=True)
class Oscillation:
    """An oscillation of a joint.

    Attributes:
        kind: "lasting", "growing", or "noise".
        signal: Where it is largest relative to what is allowed: torque, screw or load.
        time_s, until_s: Time in which it was examined; it may have begun earlier, and may continue.
        frequency_Hz: Its frequency; NaN for noise.
        growth_1_s: Growth of its amplitude in 1/s; NaN for noise.
        torque_ripple: `torque_rms_N_m` as a fraction of the torque limit.
        torque_rms_N_m: Rms of the torque.
        torque_swing_N_m: Torque from peak to peak.
        position_swing_m: Position of the screw from peak to peak.
        load_swing_m: Position of the load from peak to peak; NaN for a rigid load.
    """

    kind: str
    signal: str
    time_s: float
    until_s: float
    torque_ripple: float
    torque_rms_N_m: float
    torque_swing_N_m: float
    frequency_Hz: float = math.nan
    growth_1_s: float = math.nan
    position_swing_m: float = math.nan
    load_swing_m: float = math.nan

    def sentence(self, joint: str) -> str:
        """Return a message that describes the oscillation."""
        if self.kind == "noise":
            return (
                f"{joint} has torque noise of {self.torque_rms_N_m:.4g} N m rms from t = "
                f"{self.time_s:.4g} s on, {100.0 * self.torque_ripple:.3g} % of its limit."
            )
        swings = [
            f"{name} by {text}"
            for name, value, text in (
                ("torque", self.torque_swing_N_m, f"{self.torque_swing_N_m:.4g} N m"),
                ("screw", self.position_swing_m, f"{1e6 * self.position_swing_m:.4g} µm"),
                ("load", self.load_swing_m, f"{1e6 * self.load_swing_m:.4g} µm"),
            )
            if value > 0.0
        ]
        grows = f" and grows by {self.growth_1_s:.2g} 1/s" if self.kind == "growing" else ""
        return (
            f"{joint} oscillates at {self.frequency_Hz:.3g} Hz{grows}, seen from t = {self.time_s:.4g} s to "
            f"{self.until_s:.4g} s, from peak to peak: {', '.join(swings)}."
        )


@dataclass(frozen=True)
class WatchedJoint:
    """Data of a joint for the search.

    Attributes:
        has: Whether the joint has each of its six signals.
        inertia: Torque per acceleration of the screw in N m / (m/s^2), NaN if unknown.
        torque_limit: In N m; NaN if unknown, then the largest torque so far is used.
        window: Position window in m.
        ripple: Fraction of the torque limit from which on noise is an oscillation.
        is_force_known: Whether the load force is known, or a part of the system.
        sample_times: Sample times in s of its components that do several steps at once.
    """

    has: Sequence[bool]
    inertia: float
    torque_limit: float
    window: float
    ripple: float
    is_force_known: bool
    sample_times: Sequence[float] = ()


class OscillationWatch:
    """Keeps samples of all joints, and searches them for oscillations."""

    def __init__(self, joints: Sequence[WatchedJoint]) -> None:
        self._joints = joints
        self._joints_with = [
            np.flatnonzero([joint.has[signal] for joint in joints]) for signal in range(_SIGNALS)
        ]
        """Joints that have each signal."""
        self._channel = np.full((_SIGNALS, len(joints)), -1)
        """Numbers of the signals that exist, with the torque of all joints first."""
        for signal, joint_numbers in enumerate(self._joints_with):
            self._channel[signal, joint_numbers] = (
                1 + self._channel.max(initial=-1) + np.arange(len(joint_numbers))
            )
        self._channels = 1 + int(self._channel.max(initial=-1))
        self._since = np.full(len(joints), np.inf)
        self._needs_largest = any(math.isnan(joint.torque_limit) for joint in joints)
        self._largest = np.zeros(len(joints))
        """Largest torque in N m."""
        self._start = self._step = self._last_time = np.nan
        self._last = np.zeros((self._channels, 1))
        """The last row."""
        self._rates: SampleRates | None = None
        self._worst: dict[int, Oscillation] = {}
        self._at_end: dict[int, Oscillation | None] = {}
        """The worst oscillations if the run ended now."""

    def write(self, time: Vector, signals: Sequence[Vector], since: Vector) -> None:
        """Take the next rows.

        Args:
            time: Times in s, shape (rows,).
            signals: The six signals, each of shape (joints, rows). Those that do not exist have any value.
            since: Time in s from which on each joint is evaluated; infinite while it is unknown.
        """
        if not self._channels:
            return
        self._since, self._at_end = since, {}
        if self._needs_largest:
            with np.errstate(invalid="ignore"):
                self._largest = np.fmax(self._largest, np.abs(signals[TORQUE]).max(axis=1))
        self._restart_if_steps_change(time)
        # copies only where some joints lack a signal
        parts = [
            signals[signal] if len(joint_numbers) == len(self._joints) else signals[signal][joint_numbers]
            for signal, joint_numbers in enumerate(self._joints_with)
            if len(joint_numbers)
        ]
        if self._rates is not None:
            for numbers in self._rates.add(self._resample(self._rates.count, time, parts)):
                for number in numbers:
                    for joint in range(len(self._joints)):
                        self._search(joint, number, is_end=False)
        self._last_time, self._last = float(time[-1]), np.concatenate([part[:, -1:] for part in parts])

    def _restart_if_steps_change(self, time: Vector) -> None:
        """Start with the length of the first steps; on another length, search what is there and restart."""
        is_first = math.isnan(self._last_time)
        count = len(time) - is_first
        step = float(time[-1] - (time[0] if is_first else self._last_time)) / max(count, 1)
        # a few short steps, such as those before an event, do not change the rates
        is_shorter = count >= _MIN_STEPS and 4.0 * step < self._step
        if step > 0.0 and (math.isnan(self._step) or step > 4.0 * self._step or is_shorter):
            for joint, number in itertools.product(range(len(self._joints)), range(self._count_rates())):
                self._search(joint, number, is_end=False)
            self._restart(float(time[0]), step)

    def _count_rates(self) -> int:
        """Return the number of rates; none before the second row."""
        return len(self._rates.steps_per_sample) if self._rates is not None else 0

    def _restart(self, start: float, step: float) -> None:
        """Forget all samples, because steps have another length now."""
        self._start, self._step = start, step
        self._rates = SampleRates(self._channels, step) if step > 0.0 else None

    def _resample(self, count_before: int, time: Vector, parts: Sequence[Vector]) -> Sequence[Vector]:
        """Return the rows as samples at equal steps, interpolated only if they are not so already."""
        expected = self._start + self._step * count_before
        count = round((float(time[-1]) - expected) / self._step) + 1
        if count == len(time) and abs(float(time[0]) - expected) < 0.1 * self._step:
            return parts
        times = expected + self._step * np.arange(max(count, 0))
        known_times = np.concatenate([[self._last_time], time]) if self._last_time < time[0] else time
        rows = np.concatenate(parts)
        values = np.concatenate([self._last, rows], axis=1) if self._last_time < time[0] else rows
        samples = np.array([np.interp(times, known_times, row) for row in values]).reshape(len(rows), -1)
        return np.split(samples, np.cumsum([len(part) for part in parts])[:-1])

    def oscillation(self, joint: int) -> Oscillation | None:
        """Return the worst oscillation of a joint so far; None if there was none."""
        if joint not in self._at_end:
            # the search changes the worst oscillation, which must stay that of complete parts
            worst = dict(self._worst)
            for number in range(self._count_rates()):
                self._search(joint, number, is_end=True)
            self._at_end[joint] = self._worst.get(joint)
            self._worst = worst  # what grows until now may not do so until the end
        return self._at_end[joint]

    def _search(self, joint: int, number: int, is_end: bool) -> None:
        """Search the samples at a rate for oscillations of a joint, which may be the worst so far.

        Args:
            joint: Number of the joint.
            number: Number of the rate.
            is_end: Whether to search for growth until now, too.
        """
        rates, watched = self._rates, self._joints[joint]
        if rates is None or not math.isfinite(self._since[joint]):
            return
        last, rate = len(rates.steps_per_sample) - 1, rates.rates[number]
        is_highest = number == 0 and last > 0  # which has the torque only
        # positions hardly move at frequencies that only the highest rate has
        signals = [i for i in range(_SEARCHED) if watched.has[i] and (i == TORQUE or not is_highest)]
        first = math.ceil((float(self._since[joint]) - self._start) * rate - 1e-6) + number
        first = max(first, rates.available(number) - rates.capacity(number))
        grids = _choose_grids(rate, rates.available(number) - first, is_highest, number == last)
        if not signals or not grids:
            return
        samples = rates.samples(number, self._channel[signals, joint], first)
        # a run that diverges is not held for that reason
        if not np.isfinite(samples).all():
            return
        causes = [i for i in range(_SEARCHED, _SIGNALS) if watched.has[i] and not is_highest]
        limit = float(self._largest[joint]) if math.isnan(watched.torque_limit) else watched.torque_limit
        scales = [limit if i == TORQUE else watched.window for i in signals]
        floors = [
            (_MIN_TORQUE_AMPLITUDE if i == TORQUE else _MIN_POSITION_AMPLITUDE) * scale
            for i, scale in zip(signals, scales, strict=True)
        ]
        growing_floors = [_MIN_GROWING_AMPLITUDE * scale for scale in scales]
        start = self._start + first / rate
        inputs = cache(partial(self._collect_inputs, number, joint, causes, first))
        for grid in grids:
            gains = rates.gains(number, np.arange(grid.length // 2 + 1) * rate / grid.length)
            search = ToneSearch(samples, inputs, grid, gains)
            tones = [*search.lasting(floors), *(search.growing(growing_floors) if is_end else ())]
            oscillations = [
                _build_oscillation(tone, signals, limit, start, rate)
                for tone in tones
                if (watched.is_force_known or _is_joint_acceleration(tone, signals, watched))
                and not _is_sampling_line(tone, scales, grid, watched, rates)
            ]
            # noise is what is left when no tone explains the torque
            if number == 0 and grid is grids[0] and TORQUE in signals and not oscillations:
                oscillations = _find_noise(search, grid, watched.ripple, limit, start)
            for oscillation in oscillations:
                self._update_worst(joint, oscillation, limit)

    def _collect_inputs(self, number: int, joint: int, causes: Sequence[int], first: int) -> Vector:
        """Return what may cause tones: inputs, and friction, which changes its sign with the speed."""
        assert self._rates is not None
        samples = self._rates.samples(number, self._channel[causes, joint], first)
        if SPEED_REFERENCE in causes:
            samples = np.vstack([samples, np.sign(samples[causes.index(SPEED_REFERENCE)])])
        return samples

    def _update_worst(self, joint: int, oscillation: Oscillation, limit: float) -> None:
        """Keep the worse of this oscillation and the worst so far, with the times of both if they are one."""
        window = self._joints[joint].window
        worst = self._worst.get(joint, oscillation)
        if _compute_severity(worst, window, limit) > _compute_severity(oscillation, window, limit):
            worst, oscillation = oscillation, worst
        self._worst[joint] = _merge(oscillation, worst)

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data."""
        return {
            **{name: np.asarray(getattr(self, f"_{name}")).tolist() for name in _STATE},
            "rates": None if self._rates is None else self._rates.state_dict(),
            "worst": {str(joint): vars(oscillation) for joint, oscillation in self._worst.items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a stored state; raise ValueError or KeyError if it belongs to another run."""
        self._restart(float(state["start"]), float(state["step"]))
        self._last_time = float(state["last_time"])
        self._last = read_stored_array(state["last"], (self._channels, 1))
        for name in ("since", "largest"):
            setattr(self, f"_{name}", read_stored_array(state[name], (len(self._joints),)))
        if self._rates is not None:
            self._rates.load_state_dict(state["rates"])
        self._worst = {int(joint): Oscillation(**values) for joint, values in state["worst"].items()}


_STATE = ("start", "step", "last_time", "last", "since", "largest")


def _choose_grids(rate: float, samples: int, is_highest: bool, is_lowest: bool) -> list[Grid]:
    """Return how to cut samples into windows, each with the frequencies that suit it."""
    if is_highest:  # the next lower rate has the frequencies below the sixth bin
        length = _WINDOWS[0]
        # every second window is enough at such frequencies
        grids = [Grid(rate, length, 2 * length, (6, length // 2 + 1), is_flat=False)]
    elif not is_lowest:
        length = _WINDOWS[1]
        grids = [Grid(rate, length, length, (3, int(0.41 * length)))]
    else:
        # constant relative bandwidth: at least four cycles in a window
        longest = int(samples / 2.4) // 8 * 8  # which leaves twelve windows
        lengths = [16 * 2**i for i in range(20) if 16 * 2**i < 0.9 * longest]
        lengths += [longest] if longest >= 16 else []
        grids = [
            Grid(
                rate,
                length,
                length // 8,
                (4, 8 if length > 32 else int(0.45 * length)),
            )
            for length in lengths
        ]
    return [g for g in grids if (samples - g.length) // g.hop + 1 >= FEWEST_WINDOWS]


def _find_noise(
    search: ToneSearch, grid: Grid, ripple: float, limit: float, start: float
) -> list[Oscillation]:
    """Return noise of the torque whose rms exceeds a fraction of its limit for some time."""
    windows = search.squares_above(_NOISE_BIN)
    windows_per_part = max(round(_NOISE_TIME * grid.rate / grid.hop), 1)
    parts = len(windows) // windows_per_part
    # parts of the same length, so that an impact fills only one or two of them
    squares = windows[: parts * windows_per_part].reshape(parts, windows_per_part).mean(axis=1)
    first, last = _find_longest_run(squares > (ripple * limit) ** 2)
    if last - first < _NOISE_PARTS or search.is_tone_above(_NOISE_BIN):
        return []
    rms, duration = float(np.sqrt(squares[first:last].mean())), windows_per_part * grid.hop / grid.rate
    return [
        Oscillation(
            kind="noise",
            signal=NAMES[TORQUE],
            time_s=start + first * duration,
            until_s=start + last * duration,
            torque_ripple=rms / limit,
            torque_rms_N_m=rms,
            torque_swing_N_m=2.0 * math.sqrt(2.0) * rms,
        )
    ]


def _is_sampling_line(
    tone: Tone, scales: Sequence[float], grid: Grid, watched: WatchedJoint, rates: SampleRates
) -> bool:
    """Return whether a tone is made by the steps of a sampled controller, which grow with what it follows.

    A lower rate shows their lines at folded frequencies, where true tones may be: what is larger than the
    filters in front of that rate leave of the largest steps is not one of their lines.

    Args:
        tone: The tone.
        scales: Torque limit or position window, by signal.
        grid: Windows in which it is found.
        watched: Data of the joint.
        rates: All rates; the first is that of the run.
    """
    number, nyquist = rates.rates.index(grid.rate), 0.5 * rates.rates[0]
    lines = np.array([m / t for t in watched.sample_times for m in range(1, int(nyquist * t) + 2)])
    folded = np.abs(lines - grid.rate * np.rint(lines / grid.rate))  # where this rate shows them
    gains = rates.gains(number, lines) / rates.gains(number, folded)  # tones are divided by the latter
    largest = gains[np.abs(folded - tone.frequency) < grid.rate / grid.length].max(initial=0.0)
    return bool(
        largest > 0.0
        and (tone.amplitudes_of_signals <= _MAX_LINE_AMPLITUDE * largest * np.array(scales)).all()
    )


def _is_joint_acceleration(tone: Tone, signals: Sequence[int], watched: WatchedJoint) -> bool:
    """Return whether a tone's torque is that of the joint's acceleration, not of a force; True if unknown."""
    amplitudes = dict(zip(signals, tone.amplitudes_of_signals, strict=True))
    if TORQUE not in amplitudes or ERROR not in amplitudes or math.isnan(watched.inertia):
        return True  # at the highest rate, no drive rejects a force
    expected = watched.inertia * (2.0 * math.pi * tone.frequency) ** 2 * amplitudes[ERROR]
    return bool(abs(amplitudes[TORQUE] - expected) < _MAX_TORQUE_MISMATCH * amplitudes[TORQUE])


def _build_oscillation(
    tone: Tone, signals: Sequence[int], limit: float, start: float, rate: float
) -> Oscillation:
    """Return the oscillation that a tone is; `start` is the time of the first sample in s."""
    amplitudes = dict(zip(signals, tone.amplitudes_of_signals.tolist(), strict=True))
    nan = float("nan")
    torque = amplitudes.get(TORQUE, nan)
    return Oscillation(
        kind="growing" if tone.is_growing else "lasting",
        signal=NAMES[signals[tone.signal]],
        time_s=start + tone.start / rate,
        until_s=start + tone.end / rate,
        frequency_Hz=tone.frequency,
        growth_1_s=tone.growth,
        torque_ripple=torque / math.sqrt(2.0) / limit if limit > 0.0 else nan,
        torque_rms_N_m=torque / math.sqrt(2.0),
        torque_swing_N_m=2.0 * torque,
        position_swing_m=2.0 * amplitudes.get(ERROR, nan),
        load_swing_m=2.0 * amplitudes.get(LOAD, nan),
    )


def _compute_severity(oscillation: Oscillation, window: float, limit: float) -> float:
    """Return the largest amplitude relative to what is allowed; noise counts least."""
    if oscillation.kind == "noise":
        return -1.0 / oscillation.torque_ripple
    relative = (
        oscillation.torque_swing_N_m / limit if limit > 0.0 else 0.0,
        oscillation.position_swing_m / window,
        oscillation.load_swing_m / window,
    )
    return max((x for x in relative if not math.isnan(x)), default=0.0)


def _merge(worse: Oscillation, milder: Oscillation) -> Oscillation:
    """Return the worse oscillation, with the times of both if they have the same frequency."""
    are_same = worse.kind == milder.kind == "noise" or (
        abs(worse.frequency_Hz - milder.frequency_Hz) < _SAME_FREQUENCY * worse.frequency_Hz
    )
    if not are_same:
        return worse
    return replace(worse, time_s=min(worse.time_s, milder.time_s), until_s=max(worse.until_s, milder.until_s))


def _find_longest_run(values: Mask) -> tuple[int, int]:
    """Return the longest run of true values: its first position, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], values, [False]]).astype(int)))
    runs = [(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]
    return max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
