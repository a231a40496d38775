"""What a tuning writes and shows: gains before and after, their scores, conditions, and the search."""

import math
import shlex
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.wording import format_count, format_number
from ...views.plots.style import BLUE, GREEN, GREY, ORANGE, new_figure, tidy_axes
from ..frame.outputs import Outputs
from ..frame.plan_files import format_scenario
from ..frame.report import Report, ReportTable, Section, Text
from .result import Tuned, TuneResult
from .score import Score, format_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEST = "best.toml"
"""Scenario with the best gains."""

_PICTURE = "tuning.png"


def build_report(result: TuneResult) -> Report:
    """Return the report of a tuning."""
    pictures = {_PICTURE: "Tried sets of gains, and start and best on the seeds of training and validation"}
    problem = result.problem()
    verdict = (
        "The best gains meet all conditions."
        if problem is None
        else Text(f"{problem[0].upper()}{problem[1:]}", is_failure=True)
    )
    sections = [
        Section(lines=[verdict], is_detail=True),
        Section("Gains", tables=[_tabulate_gains(result), _tabulate_objective(result)], pictures=pictures),
        Section(
            "Conditions",
            tables=[_tabulate_conditions(result)] if any(result.best.training.worst.values()) else [],
            under=list(_list_sentences(result)),
        ),
        Section("Plan", tables=[_tabulate_plan(result.plan)], is_detail=True),
    ]
    facts = [format_count(result.history.height, "set") + " of gains", format_count(result.runs, "run")]
    if not result.complete:
        facts.append("interrupted")
    return Report("Tuning", result.name, facts, sections)


def _list_sentences(result: TuneResult) -> Iterator[str]:
    """Yield how many gains were tried, what half the step changes, and the result on other seeds."""
    yield (
        f"{format_count(result.history.height, 'set')} of gains tried, "
        f"{format_count(result.runs, 'run')} in {result.wall_s:.0f} s; "
        f"{format_count(int((result.history['violation'] == 0.0).sum()), 'set')} meet all conditions"
    )
    if (halved := result.best.half_step) is not None:
        before, change = result.best.training.objective, ""
        if before and math.isfinite(halved.objective):
            change = f", a change of {100.0 * (halved.objective / before - 1.0):+.2g} %"
        yield f"With half the step the objective is {_format(halved.objective)}{change}."
    yield from (f"Note: {remark}" for remark in result.remarks)
    if result.best.validation is not None:
        worse = 100.0 * (result.best.ratio - 1.0)
        if math.isfinite(worse):
            word = "worse" if worse > 0 else "better"
            seeds = len(result.seeds["validation"])
            yield f"On {seeds} other seeds the objective is {abs(worse):.2g} % {word}."
        if result.statement is not None:
            yield result.statement
    elif result.complete:
        yield "No seeds to validate with."
    if result.folder is not None:
        yield shlex.join(["emla", "run", str(result.folder / BEST)])


def _format(value: float) -> str:
    return "" if value != value else f"{value:.4g}"


def _tabulate_gains(result: TuneResult) -> ReportTable:
    start, units = result.start.values, result.units
    rows = [
        [name, _format_value(start.get(name)), _format_value(value), units.get(name, "")]
        for name, value in result.best.values.items()
    ]
    return ReportTable(f"Gains of {result.name}", ("", "start", "best", ""), rows, texts=(0, 3))


def _format_value(value: object) -> str:
    if value is None:
        return ""
    return format_number(value, 5) if isinstance(value, float) else str(value)


def _tabulate_objective(result: TuneResult) -> ReportTable:
    """Return the objective by case, in training and validation, before and after."""
    cases = [*result.best.training.by_case]
    rows = [
        ["all" if case is None else case, *_format_pair(result.start, case), *_format_pair(result.best, case)]
        for case in (*cases, None)
    ]
    header = ("", "start", "validation", "ratio", "best", "validation", "ratio")
    return ReportTable(f"{result.objective}, mean over seeds", header, rows, lines=(len(cases),))


def _format_pair(gains: Tuned, case: str | None) -> tuple[str, str, str]:
    """Return the objective in training and validation, and their ratio; `case` None is the sum."""
    training, validation = (
        math.nan if score is None else score.objective if case is None else score.by_case.get(case, math.nan)
        for score in (gains.training, gains.validation)
    )
    ratio = validation / training if training else math.nan
    return _format(training), _format(validation), "" if ratio != ratio else f"{ratio:.2f}"


def _tabulate_conditions(result: TuneResult) -> ReportTable:
    """Return the worst figures over seeds; those that violate a condition are marked."""
    best = result.best
    scores = (result.start.training, best.training, best.validation, best.half_step)
    rows = [
        [case, condition, *(_format_worst(score, case, condition) for score in scores)]
        for case, conditions in best.training.worst.items()
        for condition in conditions
    ]
    header = ("", "", "start", "best", "validation", "half step")
    return ReportTable("Conditions, with the worst figures", header, rows, texts=(0, 1))


def _format_worst(score: Score | None, case: str, condition: str) -> Text | str:
    """Return the worst figure of a condition, marked if it violates it; empty if it was not judged."""
    worst: Mapping[str, Any] = {} if score is None else score.worst.get(case, {}).get(condition, {})
    if not worst:
        return ""
    figure = format_figure(worst["figure"])
    return figure if worst["met"] else Text(f"{figure} ✗", is_failure=True)


def _tabulate_plan(plan: Mapping[str, Any]) -> ReportTable:
    rows = list[list[str]]()
    for key, value in plan.items():
        if isinstance(value, Mapping):
            rows += [[key, f"{name} = {entry}"] for name, entry in value.items()]
        elif isinstance(value, (list, tuple)):
            rows += [[key, _format_entry(entry)] for entry in value]
        elif value not in ("", None):
            rows.append([key, _format_entry(value)])
    return ReportTable("Values of the plan", ("entry", "value"), rows, texts=(0, 1))


def _format_entry(value: Any) -> str:
    """Return an entry of a list as text; of a table, such as a case, what is not empty."""
    if not isinstance(value, Mapping):
        return str(value)
    return ", ".join(f"{name} = {entry}" for name, entry in value.items() if entry not in ({}, (), [], None))


def draw_picture(result: TuneResult) -> "Figure":
    """Draw all tried sets on the left, and on the right start and best on both sets of seeds, by case."""
    figure, axes = new_figure(1, 2, 4.6, 3.0, sharex="none")
    _draw_search(axes[0, 0], result)
    _draw_cases(axes[0, 1], result)
    return figure


def _draw_search(axes: "Axes", result: TuneResult) -> None:
    """Draw the objective of all tried sets, and the best so far."""
    history = result.history
    number = history["evaluation"].to_numpy()
    objective = history["objective"].cast(float).to_numpy()
    holds = (history["violation"] == 0.0).to_numpy()
    axes.plot(number[~holds], objective[~holds], "x", color=GREY, markersize=3, label="not as required")
    axes.plot(number[holds], objective[holds], ".", color=BLUE, markersize=4, label="as required")
    axes.step(number, history["best"].cast(float).to_numpy(), where="post", color=ORANGE, label="best so far")
    _use_log_scale(axes, objective)
    axes.set_xlabel("sets of gains tried", fontsize=9)
    axes.set_ylabel("objective", fontsize=9)
    axes.set_title(result.objective, fontsize=8, parse_math=False)
    tidy_axes(axes, ["not as required", "as required", "best so far"])


def _draw_cases(axes: "Axes", result: TuneResult) -> None:
    """Draw the objective of each case for start and best, on both sets of seeds."""
    cases = list(result.best.training.by_case)
    scores = {
        "start, training": (result.start.training, GREY, "o"),
        "start, validation": (result.start.validation, GREY, "_"),
        "best, training": (result.best.training, GREEN, "o"),
        "best, validation": (result.best.validation, GREEN, "_"),
    }
    labels, values = list[str](), list[float]()
    for label, (score, color, marker) in scores.items():
        if score is not None:
            by_case = [score.by_case.get(case, np.nan) for case in cases]
            axes.plot(
                range(len(cases)), by_case, marker, color=color, markersize=9 if marker == "_" else 5, mew=2
            )
            labels.append(label)
            values += by_case
    _use_log_scale(axes, np.array(values))
    axes.set_xticks(range(len(cases)), cases, rotation=30, ha="right", parse_math=False)
    axes.set_xlim(-0.5, max(len(cases), 1) - 0.5)
    tidy_axes(axes, labels)
    axes.margins(x=0.1)


def _use_log_scale(axes: "Axes", values: np.ndarray) -> None:
    """Use a logarithmic scale if all values are positive."""
    finite = values[np.isfinite(values)]
    if finite.size and (finite > 0).all():
        axes.set_yscale("log")
        axes.tick_params(which="both", labelsize=8)


OUTPUTS = Outputs[TuneResult](
    subject="tuning",
    name="tune",
    tables={
        BEST: lambda r: format_scenario(f"Gains found by the tuning {r.name}", r.scenario, r.best.set),
        "history.csv": lambda r: r.history.write_csv(),
    },
    report=build_report,
    draw=lambda result: [(_PICTURE, draw_picture(result))],
    pictures=(_PICTURE,),
)
