"""Variants with their outcomes, and the metrics that are evaluated for each."""

import contextlib
import difflib
import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from io import BytesIO
from typing import Any

import polars
from polars.exceptions import PolarsError

from ...base.errors import CommandError
from ...base.wording import select_names
from ...recorders.metrics import HELD, Figure, list_figures
from ...run.half_step import HalfStep
from ...run.result import Result

DONE, DIVERGED, REFUSED, FAILED, DIED = "done", "diverged", "refused", "failed", "died"
TIMED_OUT = "timed out"
"""Statuses of a variant: completed; diverged in a step; refused before the first step; failed in a figure or
requirement; its process died; it took too long."""

VARIANT, STATUS, PROBLEM = "variant", "status", "problem"
"""Columns of the table besides factors and figures."""

RESERVED = (VARIANT, STATUS, PROBLEM, "end_s", "seed", "provenance", "time")
"""Columns of every table of variants. Factors and figures must not have these names."""


@dataclass(frozen=True)
class Variant:
    """One variant: its number, its options, and whether it runs with half the step of them."""

    number: int
    options: Mapping[str, Any]
    is_halved: bool = False


@dataclass(frozen=True)
class VariantOutcome:
    """The outcome of a variant: status, reason, end time in s, and figures.

    Attributes:
        cut_short: Whether an FMU asked to end the run before its stop time; its status is then "done".
        half_step: How a variant with half the step was run.
    """

    number: int
    status: str
    problem: str | None = None
    end_s: float | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)
    cut_short: bool = False
    half_step: HalfStep | None = None

    @property
    def complete(self) -> bool:
        """Whether the variant ran as long as it was asked to, so that its figures compare with others."""
        return self.status == DONE and not self.cut_short


@dataclass(frozen=True)
class Chunk:
    """The outcomes of a chunk, and its signals as a Parquet file."""

    outcomes: Sequence[VariantOutcome]
    series: bytes | None = None


@dataclass(frozen=True)
class SimulationDescription:
    """The signals (with units) and figures of a prepared simulation."""

    units: Mapping[str, str]
    further: Mapping[str, str]
    """Other variables that metrics can name, with units."""
    figures: Mapping[str, Figure]
    """Figures by name, before the first step."""
    rows: int
    """Rows of a table with the options of the scenario."""


def to_parquet(table: polars.DataFrame) -> bytes:
    """Return a table as the content of a Parquet file."""
    stream = BytesIO()
    table.write_parquet(stream)
    return stream.getvalue()


Metric = str | Callable[[Result], Any]
"""A name or pattern of registered figures, an expression over signals, or a function of a result."""

_EXPRESSION = re.compile(r"\s*([^=<>!()]+?)\s*=(?!=)\s*(.+)", re.DOTALL)
_TIME = "time"


@dataclass(frozen=True)
class MetricRequest:
    """The metrics of a plan: `figures` by name or pattern, expressions and functions by their new names."""

    figures: Sequence[str] = ()
    expressions: Mapping[str, str] = field(default_factory=dict)
    functions: Mapping[str, Callable[[Result], Any]] = field(default_factory=dict)

    @classmethod
    def of(cls, metrics: Sequence[Metric] | Mapping[str, Metric], where: str) -> "MetricRequest":
        """Read the metrics of a plan. Raise CommandError for invalid ones.

        In a list, write an expression as "name = expression". A function has its Python name.
        """
        if isinstance(metrics, str) or not isinstance(metrics, (Mapping, Sequence)):
            raise CommandError(f"the metrics of {where} are {metrics!r}; they must be a list or a table.")
        is_table = isinstance(metrics, Mapping)
        entries: Any = metrics.items() if is_table else [(None, metric) for metric in metrics]
        figures, expressions, functions = list[Any](), dict[str, Any](), dict[str, Any]()
        for name, metric in entries:
            if callable(metric):
                name = name or getattr(metric, "__name__", type(metric).__name__)
            elif not isinstance(metric, str) or not metric.strip():
                raise CommandError(
                    f"a metric of {where} is {metric!r}; it must be the name of a figure, "
                    "'name = expression', or in Python a function of a Result."
                )
            elif name is None and (match := _EXPRESSION.fullmatch(metric)):
                name, metric = match.groups()
            if name is None:
                figures.append(metric)
                continue
            _check_name(name, [*expressions, *functions], where)
            (functions if callable(metric) else expressions)[name] = metric
        return cls(figures, expressions, functions)

    def identity(self, signals: Sequence[str]) -> list[Any]:
        """Return everything that determines the figures, as plain data."""
        functions = [(name, _describe_source(function)) for name, function in self.functions.items()]
        return [list(self.figures), list(self.expressions.items()), functions, list(signals), HELD]


def _describe_source(function: Callable[..., Any]) -> str:
    """Return the source of a function, or its name if there is no source; and the plain values it uses."""
    if isinstance(function, partial):
        return f"{_describe_source(function.func)} {function.args!r} {function.keywords!r}"
    try:
        source = inspect.getsource(function)
    except (OSError, TypeError):
        source = getattr(function, "__qualname__", type(function).__name__)
    values = dict(enumerate(getattr(function, "__defaults__", None) or ()))
    with contextlib.suppress(TypeError, ValueError):  # no function of Python, or a value that is not set yet
        used = inspect.getclosurevars(function)
        values |= {**used.nonlocals, **used.globals}
    plain = {name: value for name, value in values.items() if isinstance(value, (int, float, str))}
    return f"{source} {plain!r}" if plain else source


def _check_name(name: str, existing: Sequence[str], where: str) -> None:
    """Raise CommandError for a name of a metric that another column or the verdict has."""
    if name in existing or name in RESERVED:
        raise CommandError(f"{where} has two columns '{name}'; give the metric another name.", name=name)
    if name.rpartition(".")[2] == HELD:
        raise CommandError(
            f"{where} has a metric '{name}', but '{HELD}' is the verdict of registered metrics; "
            "give the metric another name.",
            name=name,
        )


@dataclass(frozen=True)
class Measures:
    """The metrics and signals of every variant, with resolved names.

    Attributes:
        figures: Names of registered figures.
        expressions: SQL expressions of polars by name; signals are columns.
        functions: Functions of a result by name.
        signals: Signals to record over time.
        read: Signals needed for all of these.
        truths: Names of Boolean figures.
        verdicts: Names of the figures that say whether an object is held.
    """

    figures: Sequence[str] = ()
    expressions: Mapping[str, str] = field(default_factory=dict)
    functions: Mapping[str, Callable[[Result], Any]] = field(default_factory=dict)
    signals: Sequence[str] = ()
    read: Sequence[str] = ()
    truths: Sequence[str] = ()
    verdicts: Sequence[str] = ()

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [*self.figures, *self.expressions, *self.functions]

    def select_signals(self, names: Sequence[str]) -> Sequence[str]:
        """Return the signals to record, of all that exist."""
        return self.read

    def of(self, result: Result) -> dict[str, Any]:
        """Return the figures of a result: numbers, Booleans or None by name.

        Raises:
            MeasureError: An expression or function fails.
        """
        figures = list_figures(result.metrics)
        values: dict[str, Any] = {n: figures[n].value if n in figures else None for n in self.figures}
        if self.expressions:
            values |= _evaluate_expressions(
                self.expressions, polars.DataFrame(result.read([_TIME, *self.read]))
            )
        for name, function in self.functions.items():
            try:
                values[name] = _to_number(function(result))
            except BaseException as error:  # also SystemExit, which would end the worker's thread
                raise MeasureError(f"the metric '{name}' raised {error!r}.") from error
        return values

    def series(self, result: Result) -> polars.DataFrame:
        """Return the signals to keep over time."""
        return polars.DataFrame(result.read([_TIME, *self.signals]))


class MeasureError(Exception):
    """A figure cannot be computed. The message names it and the reason."""


def resolve_measures(
    request: MetricRequest,
    figures: Mapping[str, Figure],
    signals: Sequence[str],
    further: Sequence[str],
    recorded: Sequence[str],
    where: str,
) -> Measures:
    """Resolve the patterns of metrics. Without metrics, keep all figures.

    Args:
        request: The metrics of the plan.
        figures: All figures of the scenario by name.
        signals: All signals of the scenario, which functions can read.
        further: Other variables that expressions can name.
        recorded: Signals to keep over time.
        where: Name of the plan in messages.

    Raises:
        CommandError: A figure does not exist, or an expression cannot be computed.
    """
    names = list(figures)
    if request.figures or request.expressions or request.functions:
        try:
            names = select_names(request.figures, names, "metric")
        except CommandError as error:
            hint = "" if figures else " Use an expression."
            raise CommandError(f"{where}: {error}{hint}", **error.fields) from error
    for name in (*request.expressions, *request.functions):
        _check_name(name, names, where)
    expressions, used, allowed = dict[str, str](), set[str](), [*signals, *further]
    for name, text in request.expressions.items():
        expressions[name], inside = _quote_signals(text, allowed)
        used |= inside
    # a function of the user may read any signal
    read = sorted({*recorded, *used, *(signals if request.functions else ())})
    measures = Measures(names, expressions, request.functions, list(recorded), read)
    trial = _try_expressions(measures, request.expressions, allowed, where)
    truths = [name for name in names if figures[name].is_boolean]
    return replace(measures, truths=[*truths, *(n for n, value in trial.items() if isinstance(value, bool))])


def add_verdicts(measures: Measures, figures: Mapping[str, Figure]) -> Measures:
    """Return measures with all verdicts among the figures, since outcomes depend on them."""
    verdicts = [name for name, figure in figures.items() if figure.is_verdict]
    missing = [name for name in verdicts if name not in measures.figures]
    names, truths = [*measures.figures, *missing], [*measures.truths, *missing]
    return replace(measures, figures=names, truths=truths, verdicts=verdicts)


def _quote_signals(text: str, signals: Sequence[str]) -> tuple[str, set[str]]:
    """Quote the signals in an expression for SQL. Return it with the set of its signals."""
    # the longest first: one name can be the start of another
    names = sorted((s for s in signals if s in text), key=len, reverse=True)
    used = set[str]()

    def quote(match: re.Match[str]) -> str:
        name = match[1] or match[0][1:-1]
        if name in names:
            used.add(name)
        return match[0] if match[1] is None else '"' + name.replace('"', '""') + '"'

    if not names:
        return text, used
    either = "|".join(map(re.escape, names))
    pattern = rf"""'[^']*'|"[^"]*"|(?<![\w.])({either})(?![\w.\[])"""
    return re.sub(pattern, quote, text), used


def _try_expressions(
    measures: Measures, as_written: Mapping[str, str], signals: Sequence[str], where: str
) -> dict[str, float | bool | None]:
    """Return the values of all expressions for two rows of zeros; raise CommandError if one fails."""
    values: dict[str, float | bool | None] = {}
    # two rows: an expression that does not reduce them to one value shows itself before the first run
    frame = polars.DataFrame({name: [0.0, 0.0] for name in (_TIME, *measures.read)})
    for name, expression in measures.expressions.items():
        try:
            values |= _evaluate_expressions({name: expression}, frame)
        except MeasureError as error:
            text = as_written[name]
            words = {w for w in re.findall(r"[A-Za-z_][\w.\[\],]*", text) if "." in w and w not in signals}
            similar = [n for word in sorted(words) for n in difflib.get_close_matches(word, signals, 2, 0.6)]
            hint = f" Did you mean {' or '.join(similar)}?" if similar else ""
            raise CommandError(f"the metric of {where}: {error}{hint}", name=name, near=similar) from error
    return values


def _evaluate_expressions(
    expressions: Mapping[str, str], frame: polars.DataFrame
) -> dict[str, float | bool | None]:
    """Return the values of SQL expressions over columns; raise MeasureError if one cannot be computed."""
    results = {}
    for name, expression in expressions.items():
        try:
            values = frame.select(polars.sql_expr(expression).alias(name))[name]
            if len(values) != 1:
                raise MeasureError(
                    f"'{name} = {expression}' gives a value for each row; apply max, min, avg or last to it."
                )
            results[name] = _to_number(values[0])
        except (PolarsError, TypeError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise MeasureError(f"'{name} = {expression}' cannot be computed: {reason}.") from error
    return results


def _to_number(value: Any) -> float | bool | None:
    """Return a number, Boolean or None. Raise TypeError for anything else."""
    if hasattr(value, "item") and getattr(value, "size", 1) == 1:
        value = value.item()
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, (int, float)):
        try:
            return float(value)
        except OverflowError:
            return math.inf
    raise TypeError(f"it gave {value!r:.80}, which is neither a number nor a Boolean")
