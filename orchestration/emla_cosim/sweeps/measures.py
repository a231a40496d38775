"""What is kept of a variant: registered figures, expressions over signals, and anybody's functions."""

import difflib
import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import polars
from polars.exceptions import PolarsError

from ..base.errors import CommandError
from ..base.patterns import matches_pattern
from ..recorders.metrics import HELD, is_verdict
from ..run.requirements import flatten_figures, suggest_figure
from ..run.result import Result
from .reserved import RESERVED

Metric = str | Callable[[Result], Any]
"""A name or pattern of registered figures, an expression over signals, or a function of a result."""

_NAMED = re.compile(r"\s*([^=<>!()]+?)\s*=(?!=)\s*(.+)", re.DOTALL)
_TIME = "time"


@dataclass(frozen=True)
class MetricRequest:
    """What a plan asks to keep: `figures` by name or pattern, the others by the names they get."""

    figures: Sequence[str] = ()
    expressions: Mapping[str, str] = field(default_factory=dict)
    functions: Mapping[str, Callable[[Result], Any]] = field(default_factory=dict)

    @classmethod
    def of(cls, metrics: Sequence[Metric] | Mapping[str, Metric], where: str) -> "MetricRequest":
        """Read what a plan says; CommandError for what is none of these.

        In a list an expression is written as "name = expression", and a function has the name that it
        has in Python.
        """
        figures, expressions, functions = list[str](), dict[str, str](), dict[str, Any]()
        for name, metric in _check_names(metrics, where):
            if name is not None:
                _check_name(name, [*expressions, *functions], where)
            if callable(metric):
                functions[name or metric.__name__] = metric
            elif name is None:
                figures.append(metric)
            else:
                expressions[name] = metric
        return cls(figures, expressions, functions)

    def identity(self, signals: Sequence[str]) -> list[Any]:
        """What decides which figures come out, as plain data."""
        functions = [(name, _source(function)) for name, function in self.functions.items()]
        return [list(self.figures), list(self.expressions.items()), functions, list(signals), HELD]


def _source(function: Callable[..., Any]) -> str:
    """What a function is, as far as that can be told."""
    try:
        return inspect.getsource(function)
    except (OSError, TypeError):
        return getattr(function, "__qualname__", type(function).__name__)


def _check_names(
    metrics: Sequence[Metric] | Mapping[str, Metric], where: str
) -> list[tuple[str | None, Metric]]:
    if isinstance(metrics, Mapping):
        given: list[tuple[Any, Any]] = list(metrics.items())
    elif isinstance(metrics, str) or not isinstance(metrics, Sequence):
        raise CommandError(f"the metrics of {where} are {metrics!r}; they must be a list or a table.")
    else:
        given = [(None, metric) for metric in metrics]
    found = list[tuple[str | None, Metric]]()
    for name, metric in given:
        if callable(metric):
            found.append((name or getattr(metric, "__name__", type(metric).__name__), metric))
        elif not isinstance(metric, str) or not metric.strip():
            raise CommandError(
                f"a metric of {where} is {metric!r}; it must be the name of a figure, "
                "'name = expression', or in Python a function of a Result."
            )
        elif name is None and (match := _NAMED.fullmatch(metric)):
            found.append((match[1], match[2]))
        else:
            found.append((name, metric))
    return found


def _check_name(name: str, taken: Sequence[str], where: str) -> None:
    if name in taken or name in RESERVED:
        raise CommandError(f"{where} has two columns '{name}'; give the metric another name.", name=name)
    if is_verdict(name):
        raise CommandError(
            f"{where} has a metric '{name}', but '{HELD}' is the verdict of registered metrics; "
            "give the metric another name.",
            name=name,
        )


@dataclass(frozen=True)
class Measures:
    """What is kept of every variant, with all names resolved.

    `signals` are kept over time; `read` are those that a table needs for that and for the rest.
    Expressions are those of SQL as polars reads them, with signals as their columns. `truths` are the
    names of figures that are true or false.
    """

    figures: Sequence[str] = ()
    expressions: Mapping[str, str] = field(default_factory=dict)
    functions: Mapping[str, Callable[[Result], Any]] = field(default_factory=dict)
    signals: Sequence[str] = ()
    read: Sequence[str] = ()
    truths: Sequence[str] = ()

    @property
    def names(self) -> list[str]:
        """The columns that come of it."""
        return [*self.figures, *self.expressions, *self.functions]

    def reading(self, names: Sequence[str]) -> Sequence[str]:
        """The signals that a table needs, of all that there are."""
        return self.read

    def of(self, result: Result) -> dict[str, Any]:
        """The figures of a result: numbers, truths or None by name.

        Raises MeasureError where an expression or a function fails.
        """
        known = flatten_figures(result.metrics, {})
        found: dict[str, float | bool | None] = {name: known.get(name) for name in self.figures}
        if self.expressions:
            found |= _evaluate(self.expressions, self._frame(result))
        for name, function in self.functions.items():
            try:
                found[name] = _number(function(result))
            except BaseException as error:  # also SystemExit, which would end the worker's thread
                raise MeasureError(f"the metric '{name}' raised {error!r}.") from error
        return found

    def series(self, result: Result) -> polars.DataFrame:
        """The signals that are kept over time."""
        return polars.DataFrame(result.read([_TIME, *self.signals]))

    def _frame(self, result: Result) -> polars.DataFrame:
        return polars.DataFrame(result.read([_TIME, *self.read]))


class MeasureError(Exception):
    """A figure that could not be computed; the sentence says which one, and why."""


def resolve_measures(
    asked: MetricRequest, figures: Mapping[str, bool], signals: Sequence[str], kept: Sequence[str], where: str
) -> Measures:
    """What is kept, with names instead of patterns; without any metric, all figures are.

    `figures` says of all that there are whether they are truths; `signals` are all that there are,
    `kept` those to keep over time. Raises CommandError for a figure that is not there, and for an
    expression that cannot be computed.
    """
    chosen = (
        list(figures)
        if not (asked.figures or asked.expressions or asked.functions)
        else _matching(asked.figures, list(figures), where)
    )
    for name in (*asked.expressions, *asked.functions):
        _check_name(name, chosen, where)
    quoted, used = dict[str, str](), set[str]()
    for name, text in asked.expressions.items():
        quoted[name], inside = _quote_signals(text, signals)
        used |= inside
    read = sorted({*kept, *used} if not asked.functions else {*kept, *used, *signals})
    measures = Measures(chosen, quoted, asked.functions, list(kept), read)
    tried = _check_expressions(measures, asked.expressions, signals, where)
    truths = [name for name in chosen if figures[name]]
    return replace(measures, truths=[*truths, *(n for n, value in tried.items() if isinstance(value, bool))])


def with_verdicts(measures: Measures, figures: Mapping[str, bool]) -> Measures:
    """Return measures that keep every verdict, named or not: a map cannot say `held` without it.

    `figures` are as in `resolve_measures`.
    """
    missing = [n for n, truth in figures.items() if truth and is_verdict(n) and n not in measures.figures]
    return replace(measures, figures=[*measures.figures, *missing], truths=[*measures.truths, *missing])


def reason_not_held(result: Result) -> str | None:
    """Return why a run is not held, a sentence for each verdict that is false; None where none is."""
    found = list[str]()
    for kind in result.metrics.values():
        for of, figures in kind.items():
            if figures.get(HELD) is False:
                reason = str(figures.get("reason") or f"{of} is not held").rstrip(".")
                found.append(f"{reason}." if reason.startswith(f"{of} ") else f"{of}: {reason}.")
    return " ".join(found) or None


def _matching(patterns: Sequence[str], figures: Sequence[str], where: str) -> list[str]:
    found = list[str]()
    for pattern in patterns:
        matching = [name for name in figures if matches_pattern(name, pattern)]
        if not matching:
            meant = suggest_figure(pattern, figures) if figures else "there is none; name an expression."
            raise CommandError(
                f"{where} wants the metric '{pattern}', which does not exist; {meant}", name=pattern
            )
        found += [name for name in matching if name not in found]
    return found


def _quote_signals(text: str, signals: Sequence[str]) -> tuple[str, set[str]]:
    """An expression with signals as SQL quotes them, and those in it."""
    names = sorted((s for s in signals if s in text), key=len, reverse=True)
    used = set[str]()

    def quote(match: re.Match[str]) -> str:
        if match[1] is not None:
            used.add(match[1])
            return '"' + match[1].replace('"', '""') + '"'
        if match[0][1:-1] in names:
            used.add(match[0][1:-1])
        return match[0]

    if not names:
        return text, used
    either = "|".join(map(re.escape, names))
    pattern = rf"""'[^']*'|"[^"]*"|(?<![\w.])({either})(?![\w.\[])"""
    return re.sub(pattern, quote, text), used


def _check_expressions(
    measures: Measures, as_written: Mapping[str, str], signals: Sequence[str], where: str
) -> dict[str, float | bool | None]:
    """All expressions of two rows of zeros; CommandError for one that fails."""
    found: dict[str, float | bool | None] = {}
    frame = polars.DataFrame({name: [0.0, 0.0] for name in (_TIME, *measures.read)})
    for name, expression in measures.expressions.items():
        try:
            found |= _evaluate({name: expression}, frame)
        except MeasureError as error:
            text = as_written[name]
            words = {w for w in re.findall(r"[A-Za-z_][\w.\[\],]*", text) if "." in w and w not in signals}
            near = [n for word in sorted(words) for n in difflib.get_close_matches(word, signals, 2, 0.6)]
            meant = f" Did you mean {' or '.join(near)}?" if near else ""
            raise CommandError(f"the metric of {where}: {error}{meant}", name=name, near=near) from error
    return found


def _evaluate(expressions: Mapping[str, str], frame: polars.DataFrame) -> dict[str, float | bool | None]:
    found = {}
    for name, expression in expressions.items():
        try:
            values = frame.select(polars.sql_expr(expression).alias(name))[name]
            if len(values) != 1:
                raise MeasureError(
                    f"'{name} = {expression}' gives a value for each row; take max, min, avg, last ... of it."
                )
            found[name] = _number(values[0])
        except (PolarsError, TypeError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise MeasureError(f"'{name} = {expression}' cannot be computed: {reason}.") from error
    return found


def _number(value: Any) -> float | bool | None:
    """A number, a truth, or nothing; TypeError for anything else."""
    if hasattr(value, "item") and getattr(value, "size", 1) == 1:
        value = value.item()
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, (int, float)):
        try:
            return float(value)
        except OverflowError:
            return math.inf
    raise TypeError(f"it gave {value!r:.80}, which is neither a number nor a truth")
