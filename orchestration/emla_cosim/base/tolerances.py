"""Compare signals with references, within tubes in time and value."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from .arrays import Vector
from .errors import CommandError
from .wording import matches_pattern


@dataclass(frozen=True)
class Tube:
    """Size of the tube around a reference signal.

    Attributes:
        value: half height, in the unit of the signal.
        time: half width, in s.
    """

    value: float
    time: float

    def edges(self, time: Vector, reference_time: Vector, reference: Vector) -> tuple[Vector, Vector]:
        """Return the smallest and the largest value of the reference within the tube's `time`.

        The reference is linear between its points, and constant before the first and after the last.
        Two points at the same time are a jump.

        Args:
            time: Times in s at which to compute the edges, shape (n,).
            reference_time: Times of the reference in s, shape (m,).
            reference: The reference, shape (m,).

        Returns:
            Lower and upper edge without `value`, each of shape (n,).
        """
        low, high = time - self.time, time + self.time
        at_low, at_high = (np.interp(ends, reference_time, reference) for ends in (low, high))
        first = np.searchsorted(reference_time, low, side="left")
        last = np.searchsorted(reference_time, high, side="right")
        lower, upper = np.minimum(at_low, at_high), np.maximum(at_low, at_high)
        has_points = last > first  # the reference has points within the tube's time
        pairs = np.column_stack([first[has_points], last[has_points]]).ravel()
        padded = np.append(reference, np.nan)  # so that `last` is a valid index
        if has_points.any():
            lower[has_points] = np.minimum(lower[has_points], np.fmin.reduceat(padded, pairs)[::2])
            upper[has_points] = np.maximum(upper[has_points], np.fmax.reduceat(padded, pairs)[::2])
        return lower, upper


RELATIVE = 1e-3
"""Default tolerance, as a fraction of a signal's range."""

_LEAST = 1e-12
"""Smallest tolerance of a signal that is always 0, in its unit."""


@dataclass(frozen=True)
class Tolerance:
    """Allowed deviation of a signal from its reference.

    None leaves a part to the tolerance of a more general pattern, or to the default: 1e-3 of the range, no
    absolute part, half an interval of the reference.

    Args:
        relative: part of the range of the signal; of a constant signal, part of its value.
        absolute: deviation in the unit of the signal, added to the relative one.
        time: shift in time, in s.

    Raises:
        CommandError: a part is negative, infinite or not a number.
    """

    relative: float | None = None
    absolute: float | None = None
    time: float | None = None

    def __post_init__(self) -> None:
        """Raise CommandError for values that are negative, infinite or NaN."""
        for part in fields(self):
            value = getattr(self, part.name)
            if value is not None and not 0.0 <= value < np.inf:
                raise CommandError(
                    f"the {part.name} tolerance {value:g} must be 0 or a positive number, not infinite."
                )

    def tube(self, time: Vector, reference: Vector) -> Tube:
        """Return the tube around a reference with finite values at these times in s."""
        scale = float(np.ptp(reference)) or float(np.abs(reference).max())
        relative = RELATIVE if self.relative is None else self.relative
        value = relative * scale + (self.absolute or 0.0)
        intervals = np.diff(np.unique(time))
        half = 0.5 * float(np.median(intervals)) if len(intervals) else 0.0
        return Tube(value if scale > 0.0 else max(value, _LEAST), half if self.time is None else self.time)


def find_tolerance(signal: str, tolerances: Mapping[str, Tolerance]) -> Tolerance:
    """Return the tolerance of a signal.

    Args:
        signal: Name of the signal.
        tolerances: Tolerances by name or pattern. Later entries override earlier ones, except for None.
    """
    parts: dict[str, float] = {}
    for pattern, tolerance in tolerances.items():
        if matches_pattern(signal, pattern):
            parts |= {name: value for name, value in vars(tolerance).items() if value is not None}
    return Tolerance(**parts)


def read_tolerances(texts: Sequence[str]) -> dict[str, Tolerance]:
    """Read tolerances from the command line.

    Args:
        texts: For example `1e-4`, `x=1e-6` or `a.*=relative:1e-5,absolute:1e-9,time:0`. Without a name, the
            tolerance applies to all signals.

    Returns:
        Tolerances by name or pattern.

    Raises:
        CommandError: A text has another form.
    """
    return dict(map(_read_tolerance, texts))


def _read_tolerance(text: str) -> tuple[str, Tolerance]:
    """Return the pattern of signals, `*` without one, and their tolerance."""
    pattern, equals, value = text.rpartition("=")
    allowed = [part.name for part in fields(Tolerance)]
    parts: dict[str, float] = {}
    for part in value.split(","):
        name, colon, number = part.rpartition(":")
        try:
            parts[name.strip() if colon else allowed[0]] = float(number)
        except ValueError:
            parts[""] = 0.0
    if (equals and not pattern) or not parts.keys() <= set(allowed):
        raise CommandError(
            f"--tolerance {text} cannot be read. Write NUMBER, SIGNAL=NUMBER or "
            "SIGNAL=relative:NUMBER,absolute:NUMBER,time:NUMBER."
        )
    return pattern.strip() or "*", Tolerance(**parts)


@dataclass(frozen=True)
class Comparison:
    """One signal with its reference and the tube around it.

    Attributes:
        signal: full name.
        unit: unit of the values.
        time: times of the signal in s, shape (n,).
        values: values of the signal, shape (n,).
        reference_time: times of the reference in s, shape (m,).
        reference: values of the reference, shape (m,).
        lower: lower edge of the tube at `time`, shape (n,).
        upper: upper edge of the tube at `time`, shape (n,).
        worst: largest difference that no shift in time within the tube explains.
        worst_at: its time in s.
        left_at: first time outside of the tube in s; None if the signal stays inside.
        tube: size of the tube.
    """

    signal: str
    unit: str
    time: Vector
    values: Vector
    reference_time: Vector
    reference: Vector
    lower: Vector
    upper: Vector
    tube: Tube
    worst: float
    worst_at: float
    left_at: float | None

    @property
    def inside(self) -> bool:
        """Whether the signal stays in its tube."""
        return self.left_at is None


def compare_signal(
    signal: str,
    unit: str,
    time: Vector,
    values: Vector,
    reference_time: Vector,
    reference: Vector,
    tolerance: Tolerance,
    is_held: bool = False,
) -> Comparison:
    """Compare a signal with its reference, over the time that both cover.

    Values of the reference that are not finite are ignored; such values of the signal are outside the tube.

    Args:
        signal: Name of the signal.
        unit: Unit of both.
        time: Times of the signal in s, shape (n,) with n > 0.
        values: The signal, shape (n,).
        reference_time: Times of the reference in s, shape (m,) with m > 0.
        reference: The reference, shape (m,).
        tolerance: Allowed deviations.
        is_held: Whether the reference holds between its points, as that of discrete variables does; otherwise
            it is linear.
    """
    finite = np.isfinite(reference)
    if not finite.any():
        finite, reference = np.ones_like(finite), np.zeros_like(reference)
    reference_time, reference = reference_time[finite], reference[finite]
    if is_held:  # two points at each time but the first
        reference_time, reference = np.repeat(reference_time, 2)[1:], np.repeat(reference, 2)[:-1]
    tube = tolerance.tube(reference_time, reference)
    low, high = reference_time[0] - tube.time, reference_time[-1] + tube.time
    common = (time >= low) & (time <= high)
    time, values = time[common], values[common]
    lower, upper = tube.edges(time, reference_time, reference)
    off: Vector = np.fmax(np.fmax(lower - values, values - upper), 0.0)
    off[~np.isfinite(values)] = np.inf
    outside = off > tube.value
    k = int(np.argmax(off)) if len(off) else 0
    return Comparison(
        signal=signal,
        unit=unit,
        time=time,
        values=values,
        reference_time=reference_time,
        reference=reference,
        lower=lower - tube.value,
        upper=upper + tube.value,
        tube=tube,
        worst=float(off[k]) if len(off) else 0.0,
        worst_at=float(time[k]) if len(off) else float(reference_time[0]),
        left_at=float(time[np.argmax(outside)]) if outside.any() else None,
    )


def select_outside(comparisons: Iterable[Comparison]) -> list[Comparison]:
    """Return the signals that leave their tubes, in the order of time."""
    return sorted((c for c in comparisons if c.left_at is not None), key=lambda c: c.left_at or 0.0)


def describe_departure(comparison: Comparison) -> str:
    """Return when a signal left its tube, and its largest deviation, as part of a message."""
    unit = f" {comparison.unit}" if comparison.unit else ""
    return (
        f"{comparison.signal} left its tube at t = {comparison.left_at:.9g} s; it is off by up to "
        f"{comparison.worst:.3g}{unit}, at t = {comparison.worst_at:.9g} s, where "
        f"{comparison.tube.value:.3g}{unit} are allowed"
    )
