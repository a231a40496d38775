"""Run a comparison: plan it, run it on workers, and collect the result."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from ...base.errors import CommandError, RunError, check_choice, join_names
from ...base.option import COMPARE, SHOWING
from ...base.progress import Progress
from ...base.values import convert_value
from ...run.option_types import CompareOptions
from ...run.options import list_options
from ...run.scenarios.scenario_file import SCENARIOS
from ...study.controllers import COMPLIANT, ROBUSTNESS_SETS
from ...study.loading import load
from ...study.paper import PRINTED
from ..execution.executor import Scheduler
from ..frame.session import Session
from ..variants.measures import REFUSED
from .controller_variants import ALL, Choice, list_other_variants, parse_reserves, select_variants
from .plan import (
    ComparisonCase,
    ComparisonPlan,
    ComparisonTerms,
    plan_runs,
    read_robustness_cases,
    read_stability_maps,
    read_stability_stop_time,
)
from .report import OUTPUTS
from .result import MARGINS, PAPER, ROBUSTNESS, STABILITY, TABLES, CompareResult
from .rows import FIGURES_ONLY, WITH_ERRORS, build_rows, collect_motions
from .stability import add_margins, measure_margins
from .statistics import FEWEST_SEEDS

RESOLUTION = 7
"""Default number of points along an axis of a map."""

SEEDS = FEWEST_SEEDS
"""Default number of held-out seeds, the smallest that can show a winner; maps use none by default."""


def compare(
    scenario: str | Path = "study",
    controllers: Sequence[Choice] | None = None,
    *,
    gains: Sequence[str] | None = None,
    table: str | None = None,
    seeds: int | None = None,
    reserves: Sequence[float] | None = None,
    resolution: int | None = None,
    scheduler: Scheduler = None,
    workers: int | None = None,
    output: str | Path | None = None,
    overwrite: bool = False,
    plots: bool = False,
    report: bool = False,
    progress: Progress | None = None,
    **options: Unpack[CompareOptions],
) -> CompareResult:
    """Run a built-in scenario with several controllers, and put their metrics into tables.

    Joints without connections to each other run separately, so that none of them ends the others. Ctrl-C ends
    the comparison early; the result contains the runs that were done.

    Args:
        scenario: name of a built-in scenario.
        controllers: names, FILE.fmu, FILE.py:BLOCK, or blocks. Default: all of `CONTROLLERS`.
        gains: sets of gains: SET for each controller that has it, CONTROLLER/SET for one, "all" for all.
            Default: the recommended set of each controller, `compliant` if that is the set of the scenario.
        table: "paper" (Tables VI and VIII of the paper beside ours), "robustness" (the scenario in many
            conditions), "stability" (maps over delay and parameters), "margins" (stability margins of each
            joint's loops beside its errors), or None.
        seeds: number of held-out seeds, the same for all controllers; 0 for the seeds of the scenario.
            Default: 6, for maps 0.
        reserves: parts of current and voltage that each controller keeps, such as (0.02, 0.2). Default: those
            of each controller.
        resolution: points on each axis of a map.
        scheduler: as for `sweep`.
        workers: as for `sweep`.
        output: folder for the results. Default: no files.
        overwrite: replace files that emla did not write.
        plots: draw pictures into the folder.
        report: write a page, compare.html, into the folder.
        progress: receives progress and notes.
        **options: values by name, for all runs.

    Returns:
        A row for each joint, controller and case, and the tables.

    Raises:
        CommandError: a controller, a set of gains, the scenario or an option is wrong. Nothing was run.
        RunError: the cluster is lost, all runs are refused, or files cannot be written.

    Examples:
        >>> import emla_cosim as ec
        >>> compared = ec.compare("lift", ["rsba", "foc"], seeds=0, stop_time=0.01)
        >>> compared.rows["controller"].to_list()
        ['rsba', 'foc']
    """
    if not isinstance(scenario, (str, Path)):
        raise CommandError(f"the scenario is {scenario!r}; it must be the name or the file of a scenario.")
    overrides: dict[str, Any] = {**options, "overwrite": True} if overwrite else {**options}
    _check(table, resolution, seeds, overrides)
    if seeds is None:
        seeds = 0 if table == STABILITY else SEEDS
    all_sets = [ALL] if table == PAPER and gains is None else gains
    further = ROBUSTNESS_SETS if table == ROBUSTNESS else ()
    # the set for loads that are not rigid is the recommended one where the scenario uses it
    is_compliant = load(str(scenario), **overrides).options.gains == COMPLIANT
    variants = select_variants(controllers, all_sets, further, COMPLIANT if is_compliant else None)
    session = Session(OUTPUTS, output, overwrite, plots, report, scheduler, workers, progress)
    if table == STABILITY:
        overrides = {"stop_time": read_stability_stop_time(), **overrides}
    terms = ComparisonTerms(seeds, parse_reserves(reserves), overrides, ALL in (all_sets or ()))
    scenarios, cases = _choose_scenarios(str(scenario), table), _choose_cases(table, resolution)
    with session.with_workers():
        plan = plan_runs(scenarios, variants, cases, terms, session.progress)
        session.check_unread([group.read for group in plan.groups])
        result = _run(plan, Path(scenario).stem, table, session)
        session.keep(result)
    return result


def _run(
    plan: ComparisonPlan, name: str, table: str | None, session: Session[CompareResult]
) -> CompareResult:
    """Run all planned runs, or those that end before an interrupt."""
    progress, margins = session.progress, None
    measures = FIGURES_ONLY if table in (ROBUSTNESS, STABILITY) else WITH_ERRORS
    with session.open_runs(plan.groups) as runs:
        for group in {run.scenario: run.group for run in reversed(plan.runs)}.values():
            runs.describe(group)  # raises the error that prevents every run
        progress.begin("comparing", len(plan.runs), "runs")
        start = time.monotonic()
        outcomes = runs.run(plan.jobs, measures, lambda chunk: progress.advance(len(chunk.outcomes)))
        ended, complete = outcomes.by_job, outcomes.complete
        if table == MARGINS:
            margins = measure_margins(plan, ended, runs.interrupted, progress)
            complete = complete and not runs.interrupted()
        wall_s = time.monotonic() - start
    if ended and all(outcome.status == REFUSED for outcome in ended.values()):
        raise RunError(str(next(iter(ended.values())).problem))
    compared = list(dict.fromkeys(run.controller_variant for run in plan.runs))
    further = list_other_variants(compared)
    notes = [f"Further sets of gains: {join_names(further)}; add them with --gains."] if further else []
    return CompareResult(
        name=name,
        table=table,
        rows=add_margins(build_rows(plan, ended), margins),
        entrants=list(map(str, compared)),
        errors=outcomes.series,
        motions=collect_motions(plan, ended),
        notes=[*plan.notes, *notes],
        complete=complete,
        wall_s=wall_s,
        folder=session.path,
        plan=plan,
    )


def _check(table: str | None, resolution: int | None, seeds: int | None, options: Mapping[str, Any]) -> None:
    """Raise CommandError for options that are wrong or do not fit together."""
    if table is not None:
        check_choice("table", table, TABLES)
    if resolution is not None and table != STABILITY:
        raise CommandError(f"only the table {STABILITY} has a resolution; remove the option.")
    for value, noun, low, high in (
        (resolution, "the resolution of the map", 2, 100),
        (seeds, "the number of seeds", 0, 1000),
    ):
        if value is not None and not low <= convert_value(value, int, noun) <= high:
            raise CommandError(f"{noun} is {value}; it must be from {low} to {high}.")
    allowed = {name for name, option in list_options(COMPARE).items() if option.stage != SHOWING}
    if wrong := [name for name in options if name in list_options() and name not in allowed]:
        raise CommandError(f"comparisons do not support the option {wrong[0]}; remove it.")


def _choose_scenarios(scenario: str, table: str | None) -> list[str]:
    """Return the scenarios to run; raise CommandError for a scenario that is not in the paper's tables."""
    if table != PAPER:
        return [scenario]
    printed = [s for t in PRINTED for s in t.scenarios]
    if scenario not in printed:
        needed = f"the paper's tables need the scenarios {join_names(printed)}"
        raise CommandError(f"{needed}; use {printed[0]}, not '{scenario}'.")
    return [s for s in printed if s in SCENARIOS]


def _choose_cases(table: str | None, map_resolution: int | None) -> list[ComparisonCase]:
    """Return the cases of robustness or the points of stability maps; one default case for other tables."""
    if table == ROBUSTNESS:
        return read_robustness_cases()
    if table == STABILITY:
        return [case for m in read_stability_maps() for case in m.cases(map_resolution or RESOLUTION)]
    return [ComparisonCase()]
