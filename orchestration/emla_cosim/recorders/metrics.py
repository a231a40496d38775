"""Compute metrics during a run, and statistics of all signals, from every communication point."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Vector, read_stored_array
from ..base.wording import format_count
from ..stepper.library import reduce_rows
from .recorder import Recorder, RunLayout

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
            block = np.stack((*_compute_figures(selected), selected[-1]))
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


def _compute_figures(rows: Vector) -> tuple[Vector, Vector, Vector]:
    """Return minimum, maximum and root mean square of every column."""
    low, high, squares = reduce_rows(rows)
    rms = np.sqrt(squares / len(rows))
    peak = np.maximum(np.abs(low), np.abs(high))
    unsquared = np.isfinite(peak) & (peak > 0) & ((peak > _SQUARED) | (peak < 1 / _SQUARED))
    if unsquared.any():
        largest = peak[unsquared]
        rms[unsquared] = largest * np.sqrt(np.mean((rows[:, unsquared] / largest) ** 2, axis=0))
    return low, high, rms


def _merge_figures(before: Vector, count: int, after: Vector, added_count: int) -> Vector:
    """Return the figures of `count` rows and `added_count` later ones together, in the order of `NAMES`."""
    total = count + added_count
    return np.stack(
        (
            np.minimum(before[0], after[0]),
            np.maximum(before[1], after[1]),
            # hypot: the squares themselves could overflow
            np.hypot(before[2] * np.sqrt(count / total), after[2] * np.sqrt(added_count / total)),
            after[3],
        )
    )


Figures = Mapping[str, Mapping[str, Any]]
"""Figures by object, such as a joint, and by name."""


@dataclass(frozen=True)
class MetricDisplay:
    """How tables show a metric.

    Args:
        name: name of the metric.
        label: label in tables.
        factor: factor from the value to the displayed number.
        unit: unit of the displayed number.
        large: unit for values without the factor, if the number becomes too long.
    """

    name: str
    label: str
    factor: float = 1.0
    unit: str = ""
    large: str = ""


class Metrics(ABC):
    """Base class of metrics: computes metrics of one kind during a run.

    Attributes:
        displays: metrics that tables show, in order.
    """

    displays: Sequence[MetricDisplay] = ()

    @abstractmethod
    def write(self, rows: Vector) -> None:
        """Receive rows.

        Args:
            rows: array of shape (n, 1 + signals): time in s, then all signals.
        """

    @abstractmethod
    def figures(self) -> Figures:
        """Return the metrics of all rows so far; NaN for one that does not exist."""

    def remarks(self) -> Sequence[str]:
        """Return warnings to read before the metrics."""
        return ()

    def ended_early(self, problem: str) -> None:  # noqa: B027
        """Receive the error message of a run that ended before its stop time."""

    @abstractmethod
    def state_dict(self) -> Any:
        """Return plain data from which `load_state_dict` can continue."""

    @abstractmethod
    def load_state_dict(self, state: Any) -> None:
        """Continue from what `state_dict` returned."""


METRICS: dict[str, Callable[[RunLayout], Metrics | None]] = {}
"""Functions that return the metrics of a run, or None, by the name of their part in metrics.json."""


HELD = "held"
"""Name of the figure that is a verdict: whether a joint, or another object of a metric, is held."""

IDEALISED = "idealised"
"""Name of the figure that lists what a joint, or another object of a metric, idealises.

Each entry has a `name`, a `label` of a few words, a `sentence`, the `option` that removes it, and the
`source` of typical values.
"""


@dataclass(frozen=True)
class Figure:
    """A number or Boolean that a run has for an object.

    Attributes:
        subject: the object, such as a joint.
        metric: name in metrics.json.
        value: NaN if it does not exist.
        display: how tables show it; None if they do not.
    """

    subject: str
    metric: str
    value: float | bool
    display: MetricDisplay | None = None

    @property
    def is_boolean(self) -> bool:
        """Whether the value is true or false."""
        return isinstance(self.value, bool)

    @property
    def is_verdict(self) -> bool:
        """Whether it says that the object is held."""
        return self.metric == HELD and self.is_boolean


def list_figures(
    metrics: Mapping[str, Figures], displays: Mapping[str, Sequence[MetricDisplay]] | None = None
) -> dict[str, Figure]:
    """Return the numbers and Booleans among metrics, by their names in requirements and sweeps.

    Args:
        metrics: metrics by kind, by object and by name.
        displays: metrics that tables show, by kind.
    """
    figures = dict[str, Figure]()
    for kind, subjects in metrics.items():
        display_by_name = {display.name: display for display in (displays or {}).get(kind, ())}
        for subject, values in subjects.items():
            for metric, value in values.items():
                if isinstance(value, (bool, int, float)):
                    figures[f"{subject}.{metric}"] = Figure(
                        subject, metric, value, display_by_name.get(metric)
                    )
    return figures


def explain_verdicts(metrics: Mapping[str, Figures]) -> str | None:
    """Return why objects are not held, one message for each; None if all are."""
    messages = list[str]()
    for subjects in metrics.values():
        for subject, values in subjects.items():
            if values.get(HELD) is False:
                reason = str(values.get("reason") or f"{subject} is not held").rstrip(".")
                messages.append(f"{reason}." if reason.startswith(f"{subject} ") else f"{subject}: {reason}.")
    return " ".join(messages) or None


TRACKED: dict[str, Callable[[Collection[str], Mapping[str, str]], Mapping[str, tuple[str, str]]]] = {}
"""Functions that find signals and their references, by kind.

Each takes the names of all signals, and the roles. It returns pairs of names by object, such as a joint.
"""


ROLES: list[Callable[[Iterable[str]], Mapping[str, str]]] = []
"""Registered functions that return roles, as in the option of this name, from connections as texts."""


def default_roles(connections: Iterable[str]) -> dict[str, str]:
    """Return the roles that follow from the connections of a system; options override them."""
    texts = list(connections)
    return {role: name for find in ROLES for role, name in find(texts).items()}


SIGNALS = "signals"
"""Name of the part of metrics.json with the figures of signals, which every run has."""


UNBOUNDED = 1e100
"""Size in any SI unit that no signal of a machine reaches; FMUs use up to 1e60 for infinity."""


def describe_divergence(signals: Mapping[str, Mapping[str, float]]) -> str | None:
    """Return the message on signals that grew beyond `UNBOUNDED`, from their figures; None if none did."""
    sizes = {name: max(abs(x[MINIMUM]), abs(x[MAXIMUM])) for name, x in signals.items()}
    beyond = {name: size for name, size in sizes.items() if size > UNBOUNDED}
    if not beyond:
        return None
    name, rest = next(iter(beyond)), len(beyond) - 1
    more = f", and {format_count(rest, 'more signal')} grew as far" if rest else ""
    return f"Diverged: {name} reached {beyond[name]:.2g}{more}."


class MetricsRecorder(Recorder):
    """Compute all registered metrics that apply to a run, and the figures of every signal."""

    key = "metrics"

    def __init__(self) -> None:
        self.kinds: dict[str, Metrics] = {}
        self._signals: SignalFigures | None = None

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Begin all metrics, or continue from a `state`."""
        kinds = {name: make(layout) for name, make in METRICS.items()}
        self.kinds = {name: metrics for name, metrics in kinds.items() if metrics is not None}
        for name, metrics in self.kinds.items():
            if state is not None:
                metrics.load_state_dict(state["kinds"][name])
        self._signals = SignalFigures(layout, None if state is None else state[SIGNALS])

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        for metrics in self.kinds.values():
            metrics.write(rows)
        assert self._signals is not None
        self._signals.write(rows)

    def state_dict(self) -> Any:
        """Return the state of all metrics."""
        assert self._signals is not None
        kinds = {name: metrics.state_dict() for name, metrics in self.kinds.items()}
        return {"kinds": kinds, SIGNALS: self._signals.state_dict()}

    @property
    def displays(self) -> dict[str, Sequence[MetricDisplay]]:
        """Metrics that tables show, by kind."""
        return {name: metrics.displays for name, metrics in self.kinds.items()}

    def ended_early(self, problem: str) -> None:
        """Pass the error message of a run that ended before its stop time to all metrics."""
        for metrics in self.kinds.values():
            metrics.ended_early(problem)

    def remarks(self) -> list[str]:
        """Return remarks for users to read before the figures."""
        remarks = [remark for metrics in self.kinds.values() for remark in metrics.remarks()]
        if (diverged := describe_divergence(self.signals())) is not None:
            remarks.insert(0, diverged)
        return remarks

    def figures(self) -> dict[str, Figures]:
        """Return the figures of all rows so far, by the name of their kind."""
        return {name: metrics.figures() for name, metrics in self.kinds.items()}

    def signals(self) -> dict[str, dict[str, float]]:
        """Return the figures of every recorded signal, of all rows so far; see `SignalFigures`."""
        return self._signals.figures() if self._signals is not None else {}
