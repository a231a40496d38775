"""Terminal output of a tuning: gains, their scores, and conditions that do not hold."""

import math
from collections.abc import Iterator, Mapping

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from ...base.wording import format_count, format_number
from .data import Tuned
from .result import TuneResult
from .score import Score, format_figure


def format_summary(result: TuneResult) -> list[RenderableType]:
    """Return gains before and after, the objective on both sets of seeds, and the worst figures."""
    parts: list[RenderableType] = [_gains(result), _objective(result)]
    if any(result.best.training.worst.values()):
        parts.append(_conditions(result))
    return parts


def format_lines(result: TuneResult) -> Iterator[str]:
    """Return the number of runs, and the result on other seeds."""
    yield (
        f"{format_count(result.history.height, 'set')} of gains tried, "
        f"{format_count(result.runs, 'run')} in {result.wall_s:.0f} s; "
        f"{format_count(int((result.history['violation'] == 0.0).sum()), 'set')} meet all conditions"
    )
    if (halved := result.best.half_step) is not None:
        yield f"With half the step the objective is {_number(halved.objective)}{_change(result.best)}."
    yield from (f"Note: {remark}" for remark in result.remarks)
    if result.best.validation is None:
        if result.complete:
            yield "No seeds to validate with."
        return
    seeds = len(result.seeds["validation"])
    worse = 100.0 * (result.best.ratio - 1.0)
    if math.isfinite(worse):
        word = "worse" if worse > 0 else "better"
        yield f"On {seeds} other seeds the objective is {abs(worse):.2g} % {word}."


def _change(best: Tuned) -> str:
    """Return the relative change of the objective by half the step as text; empty if there is none."""
    before, halved = best.training.objective, best.half_step
    if halved is None or not before or not math.isfinite(halved.objective):
        return ""
    return f", a change of {100.0 * (halved.objective / before - 1.0):+.2g} %"


def _gains(result: TuneResult) -> Table:
    table = Table(title=escape(f"Gains of {result.name}"), title_justify="left")
    for head in ("", "start", "best", ""):
        table.add_column(head, justify="left" if not head else "right", overflow="fold")
    for name, value in result.best.values.items():
        started = result.start.values.get(name)
        table.add_row(escape(name), _value(started), _value(value), escape(result.units.get(name, "")))
    return table


def _value(value: object) -> str:
    if value is None:
        return ""
    return format_number(value, 5) if isinstance(value, float) else escape(str(value))


def _objective(result: TuneResult) -> Table:
    table = Table(title=escape(f"{result.objective}, mean over seeds"), title_justify="left")
    for head in ("", "start", "validation", "ratio", "best", "validation", "ratio"):
        table.add_column(head, justify="left" if not head else "right")
    for case in result.best.training.by_case:
        table.add_row(escape(case), *_pair(result.start, case), *_pair(result.best, case))
    table.add_row("all", *_pair(result.start, None), *_pair(result.best, None), style="bold")
    return table


def _pair(gains: Tuned, case: str | None) -> tuple[str, str, str]:
    """Return the objective in training and validation, and their difference, as text."""
    found = [_of(score, case) for score in (gains.training, gains.validation)]
    ratio = found[1] / found[0] if found[0] else math.nan
    return _number(found[0]), _number(found[1]), "" if ratio != ratio else f"{ratio:.2f}"


def _of(score: Score | None, case: str | None) -> float:
    if score is None:
        return math.nan
    return score.objective if case is None else score.by_case.get(case, math.nan)


def _number(value: float) -> str:
    return "" if value != value else f"{value:.4g}"


def _conditions(result: TuneResult) -> Table:
    """Return the worst figures over seeds; those that violate a condition are marked."""
    table = Table(title="Conditions, with the worst figures", title_justify="left")
    for head in ("", "", "start", "best", "validation", "half step"):
        table.add_column(head, justify="left" if not head else "right", overflow="fold")
    for case, conditions in result.best.training.worst.items():
        for condition in conditions:
            best = result.best
            scores = (result.start.training, best.training, best.validation, best.half_step)
            table.add_row(
                escape(case), escape(condition), *(_worst(score, case, condition) for score in scores)
            )
    return table


def _worst(score: Score | None, case: str, condition: str) -> str:
    worst: Mapping[str, object] = {} if score is None else score.worst.get(case, {}).get(condition, {})
    if not worst:
        return ""
    shown = format_figure(worst["figure"])
    return shown if worst["met"] else f"[red]{shown} ✗[/]"
