"""Measured signals, and statistics of residuals: how well a prediction fits them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, join_names
from ...base.units import SiUnit
from ...base.wording import format_count, list_few
from ...inputs.column_bindings import find_column, match_columns
from ...inputs.input import Column, Input
from ...inputs.loaded_input import LoadedInput

FindSignal = Callable[[str], tuple[str, SiUnit | None]]
"""Function that returns full name and unit of a signal, or raises CommandError."""

EXACT = 1e-6
"""Residuals, as a part of the spread of the measurement, below which a prediction is exact."""

_GAP = 5.0
"""Multiple of the median sample time from which a gap is reported."""


@dataclass(frozen=True)
class MeasuredSignal:
    """A measured signal of an experiment.

    Attributes:
        signal: full name of the signal.
        time: times of the samples in s, shape (n,).
        values: values in `unit`, shape (n,).
        unit: unit of the signal.
        label: the column and its file.
    """

    signal: str
    time: Vector
    values: Vector
    unit: str
    label: str

    def between(self, start: float, stop: float) -> "MeasuredSignal":
        """Return the samples from start to stop, in s."""
        # times of files are rounded
        inside = (self.time >= start - 1e-9 * abs(start)) & (self.time <= stop + 1e-9 * abs(stop))
        return replace(self, time=self.time[inside], values=self.values[inside])


def read_measurements(
    sources: Sequence[Input], find_signal: FindSignal, label: str, start: float = 0.0
) -> tuple[list[MeasuredSignal], list[str]]:
    """Return the measured signals of an experiment, and notes on how they were read.

    Args:
        sources: the measured data.
        find_signal: returns full name and unit of a signal, or raises CommandError for an unknown one.
        label: what messages call the experiment.
        start: start of the run in s.

    Raises:
        CommandError: A file cannot be read, a column is missing, does not vary, or has another quantity.
    """
    measured, notes = list[MeasuredSignal](), list[str]()
    for source in sources:
        for name in ("interpolation", "end"):
            if (value := getattr(source, name)) != getattr(Input(data={}), name):
                raise CommandError(
                    f"{source.label} has {name}={value}, which only data for inputs have; remove it."
                )
        data = LoadedInput.of(source, start)
        notes += [f"{source.label} {note}." for note in data.data.notes]
        steps = np.diff(data.times)
        if (gaps := int(np.sum(steps > _GAP * np.median(steps)))) > 0:
            notes.append(f"{source.label} has {format_count(gaps, 'gap')} in its times.")
        columns, idle = _find_columns(source, data, find_signal)
        if idle:
            notes.append(f"{source.label} has columns that were not compared: {list_few(idle)}.")
        for name, column in columns.items():
            signal, unit = find_signal(name)
            position, column = find_column(source, data.data, column)
            if column.derivative:
                raise CommandError(
                    f"{source.label} has a derivative for {signal}; compare the column itself.", signal=signal
                )
            values, is_assumed = data.data.in_unit(position, signal, unit, column.unit)
            text = f"the column '{data.data.headers[position].text}' of {source.label}"
            if is_assumed:
                notes.append(f"{text} has no unit and is read in {unit}.")
            # the spread of a measurement is the scale of its residuals
            if np.ptp(values) == 0.0:
                raise CommandError(f"{text} does not vary: it has no information on {signal}.", signal=signal)
            if any(earlier.signal == signal for earlier in measured):
                raise CommandError(f"{label} has two columns for {signal}; remove one.", signal=signal)
            measured.append(MeasuredSignal(signal, data.times, values, str(unit or ""), text))
    return measured, notes


def _find_columns(
    source: Input, data: LoadedInput, find_signal: FindSignal
) -> tuple[dict[str, Column], list[str]]:
    """Return the columns by signal, and the names of columns that are not signals.

    Raises:
        CommandError: No column belongs to a signal.
    """
    columns, idle = dict(source.signals), list[str]()
    for name, column in match_columns(source, data.data, data.time).items():
        if name in columns:
            continue
        try:
            find_signal(name)
        except CommandError:
            idle.append(name)
        else:
            columns[name] = column
    if not columns:
        raise CommandError(
            f"{source.label} has no column with the name of a signal; write "
            f"FILE:SIGNAL=COLUMN. Its columns are called {join_names(idle[:8])}."
        )
    return columns, idle


def read_drivers(sources: Sequence[Input], start: float = 0.0) -> dict[str, tuple[Vector, Vector]]:
    """Return times and values of the columns of numbers that drive inputs; runs begin at `start` in s."""
    drivers = dict[str, tuple[Vector, Vector]]()
    for source in sources:
        data = LoadedInput.of(source, start)
        columns = match_columns(source, data.data, data.time)
        for signal, column in {**columns, **source.signals}.items():
            with suppress(CommandError):  # it drives nothing and may have texts
                position, _ = find_column(source, data.data, column)
                drivers[signal] = data.times, data.data.numbers(position)
    return drivers


LINEAR = "linear"

_DEVIATION_PER_MEDIAN = 1.4826
"""Standard deviation of a normal distribution, divided by the median of its absolute values."""

_LAGS = 20
"""Lags of the tests of residuals."""

_PROBABILITY = 0.01
"""Probability with which the tests call residuals of a perfect model correlated."""

_OUTLIER = 6.0
"""Distance from the median of residuals in robust standard deviations from which a sample is an outlier."""

_LossFunction = Callable[[Vector], Sequence[Vector]]

_LOSS_FUNCTIONS: dict[str, _LossFunction] = {
    LINEAR: lambda z: (z, np.ones_like(z), np.zeros_like(z)),
    "soft_l1": lambda z: (2.0 * (np.sqrt(1.0 + z) - 1.0), (1.0 + z) ** -0.5, -0.5 * (1.0 + z) ** -1.5),
    "huber": lambda z: (
        np.where(z <= 1.0, z, 2.0 * np.sqrt(np.maximum(z, 1.0)) - 1.0),
        np.maximum(z, 1.0) ** -0.5,
        np.where(z <= 1.0, 0.0, -0.5 * np.maximum(z, 1.0) ** -1.5),
    ),
    "cauchy": lambda z: (np.log1p(z), 1.0 / (1.0 + z), -1.0 / (1.0 + z) ** 2),
    "arctan": lambda z: (np.arctan(z), 1.0 / (1.0 + z**2), -2.0 * z / (1.0 + z**2) ** 2),
}
"""Losses of squares, and their first and second derivatives."""

LOSSES = tuple(_LOSS_FUNCTIONS)
"""Loss functions; all but the first reduce the weight of outliers."""


def find_cost(loss: str, residuals: Vector) -> float:
    """Return half the sum of the losses of residuals in standard deviations, shape (n,)."""
    return 0.5 * float(_LOSS_FUNCTIONS[loss](residuals**2)[0].sum())


def scale_for_loss(loss: str, residuals: Vector) -> tuple[Vector, Vector]:
    """Return the derivatives of the cost by the residuals, and factors for those of the residuals.

    With these factors, a linear problem has about the curvature of this one at its minimum.

    Args:
        loss: A name of `LOSSES`.
        residuals: Residuals in standard deviations, shape (n,).
    """
    _, first, second = _LOSS_FUNCTIONS[loss](residuals**2)
    factors = np.sqrt(np.maximum(first + 2.0 * second * residuals**2, np.finfo(float).eps))
    return residuals * first, factors


def find_robust_deviation(values: Vector) -> float:
    """Return the standard deviation about 0 of normal values from their median: outliers do not move it."""
    return _DEVIATION_PER_MEDIAN * float(np.median(np.abs(values)))


def autocorrelation(values: Vector) -> Vector:
    """Return the autocorrelation of values about their mean, shape (n,), for lags from 0."""
    centred = values - values.mean()
    # zeros behind the values, so that the end does not correlate with the start
    size = 2 ** int(np.ceil(np.log2(2 * len(values))))
    spectrum = np.fft.rfft(centred, size)
    correlation = np.fft.irfft(spectrum * np.conj(spectrum), size)[: len(values)]
    return correlation / correlation[0] if correlation[0] > 0.0 else np.zeros_like(correlation)


def count_correlated_lags(values: Vector) -> int:
    """Return up to which lag residuals count as correlated: three times the first lag without correlation."""
    if len(values) < 4:
        return 0
    correlation = autocorrelation(values)
    band = 1.96 / np.sqrt(len(values))
    small = np.flatnonzero(np.abs(correlation) < band)
    first = int(small[0]) if len(small) else len(values)
    return 0 if first <= 1 else min(3 * first, len(values) // 4)


@dataclass(frozen=True)
class Fit:
    """The fit of a signal in an experiment.

    Attributes:
        experiment: the experiment.
        signal: the signal.
        unit: its unit.
        held_out: whether the experiment serves to validate only.
        samples: number of samples.
        rms: root mean square of prediction minus measurement.
        fit: 1 - norm(prediction - measurement) / norm(measurement - its mean); 1 is perfect.
        r2: coefficient of determination.
        autocorrelation: autocorrelation of the residuals at a lag of one sample.
        is_white: whether a Ljung-Box test over 20 lags finds no autocorrelation (at 1 %).
        related_input: the input with which residuals are correlated most, if significantly (at 1 %).
        outliers: number of samples further than 6 robust standard deviations from the median.
    """

    experiment: str
    signal: str
    unit: str
    held_out: bool
    samples: int
    rms: float
    fit: float
    r2: float
    autocorrelation: float
    is_white: bool
    related_input: str | None
    outliers: int


def assess_fit(
    experiment: str,
    held_out: bool,
    measured: MeasuredSignal,
    differences: Vector,
    inputs: Mapping[str, tuple[Vector, Vector]],
) -> Fit:
    """Return the fit of a signal.

    Args:
        experiment: its experiment.
        held_out: whether that serves to validate only.
        measured: the measured signal.
        differences: prediction minus measurement, shape (n,).
        inputs: times and values of the data that drive inputs, by column.
    """
    from scipy.stats import chi2  # slow to import, and plans need the names of losses only

    count = len(differences)
    spread = float(np.sum((measured.values - measured.values.mean()) ** 2))
    squares = float(differences @ differences)
    exact = squares <= EXACT**2 * spread
    correlation = autocorrelation(differences)
    # products at long lags have too few terms
    lags = min(_LAGS, max(count // 4, 1))
    tested = correlation[1 : lags + 1]
    statistic = count * (count + 2.0) * float(np.sum(tested**2 / (count - np.arange(1, lags + 1))))
    centred = differences - np.median(differences)
    deviation = find_robust_deviation(centred)
    beyond = np.abs(centred) > _OUTLIER * deviation
    return Fit(
        experiment,
        measured.signal,
        measured.unit,
        held_out,
        count,
        float(np.sqrt(squares / count)),
        1.0 - float(np.sqrt(squares / spread)),
        1.0 - squares / spread,
        float(correlation[1]) if count > 1 else 0.0,
        exact or bool(statistic <= chi2.ppf(1.0 - _PROBABILITY, lags)),
        None if exact else _find_related_input(measured.time, differences, correlation, inputs),
        int(beyond.sum()) if deviation > 0.0 and not exact else 0,
    )


def _find_related_input(
    time: Vector, differences: Vector, correlation: Vector, inputs: Mapping[str, tuple[Vector, Vector]]
) -> str | None:
    """Return the input with the largest significant cross-correlation at lags up to 20 samples.

    The band widens with the autocorrelations of both (Bartlett's formula).
    """
    best, worst, count = None, 1.0, len(differences)
    for name, (input_times, values) in inputs.items():
        driven = np.interp(time, input_times, values)
        if np.ptp(driven) == 0.0 or np.ptp(differences) == 0.0 or count < 4 * _LAGS:
            continue
        input_correlation = autocorrelation(driven)
        last_lag = min(count // 4, 1000)
        # both are correlated in time: without this the band is too narrow
        weight = max(1.0 + 2.0 * float(np.sum(correlation[1:last_lag] * input_correlation[1:last_lag])), 1.0)
        band = 2.576 * np.sqrt(weight / count) * np.sqrt(np.log(2 * _LAGS + 1.0))
        a = (differences - differences.mean()) / differences.std()
        b = (driven - driven.mean()) / driven.std()
        largest = max(abs(float(a[lag:] @ b[: count - lag])) / count for lag in range(_LAGS + 1))
        if largest / band > worst:
            best, worst = name, largest / band
    return best
