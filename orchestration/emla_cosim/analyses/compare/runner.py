"""Run a comparison: plan it, run it on the workers of a sweep, and collect the result."""

import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, Unpack

import polars

from ...base.errors import CommandError, RunError, check_choice, join_names
from ...base.interruption import catch_interrupts
from ...base.option import COMPARE, SHOWING
from ...base.progress import Progress
from ...base.values import convert_value
from ...run.option_types import CompareOptions
from ...run.options import list_options as options_table
from ...run.scenarios.built_in import SCENARIOS
from ...study.controllers import ROBUSTNESS_SETS
from ...study.paper import PRINTED
from ..execution.executor import Scheduler, check_cluster, open_executor
from ..execution.worker_payload import WorkerPayload
from ..variants.data import REFUSED, VARIANT, Chunk, VariantOutcome
from .cases import ComparisonCase, check_resolution, robustness_cases, stability_maps, stability_stop_time
from .controller_variants import ALL, Choice, ControllerVariant, list_other_variants, select_variants
from .data import MARGINS, PAPER, ROBUSTNESS, STABILITY, TABLES
from .folder import CompareFolder, build_record
from .margins import add_margins, measure_margins
from .measures import FIGURES_ALONE, WITH_ERRORS, WITH_MOTION
from .plan import ComparisonPlan, ComparisonTerms, plan_runs
from .remarks import FEWEST_SEEDS
from .reserves import parse_reserves
from .result import CompareResult
from .rows import build_rows as rows_of

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
            Default: the recommended set of each controller.
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
    reporter, name = progress or Progress(), _name_of(scenario)
    overrides: dict[str, Any] = {**options, "overwrite": True} if overwrite else {**options}
    _check(table, resolution, overrides)
    check_cluster(scheduler, workers)
    all_sets = [ALL] if table == PAPER and gains is None else gains
    chosen = select_variants(controllers, all_sets, ROBUSTNESS_SETS if table == ROBUSTNESS else ())
    terms = ComparisonTerms(
        _check_seeds(seeds, table), parse_reserves(reserves), overrides, ALL in (all_sets or ())
    )
    folder = None
    if output is not None:
        folder = CompareFolder(convert_value(output, Path, "the output folder"), overwrite)
    if table == STABILITY:
        terms = replace(terms, options={"stop_time": stability_stop_time(), **overrides})
    plan = plan_runs(_scenarios(str(scenario), table), chosen, _cases(table, resolution), terms, reporter)
    if folder is None:
        return _result(plan, name, table, _run(plan, table, (scheduler, workers), reporter), None)
    folder.check_unread(group.read for group in plan.groups)
    with folder.alone():
        ran = _run(plan, table, (scheduler, workers), reporter)
        result = _result(plan, name, table, ran, folder.path)
        folder.keep(result, build_record(plan, result))
    return result


class _CollectedOutcomes:
    """The outcomes of the runs that have ended so far."""

    def __init__(self) -> None:
        self.outcomes: dict[int, VariantOutcome] = {}
        self.errors: dict[int, polars.DataFrame] = {}
        self.margins: polars.DataFrame | None = None
        self.complete = False
        self.wall_s = 0.0

    def keep(self, chunk: Chunk) -> None:
        """Take the outcomes of a chunk."""
        self.outcomes |= {outcome.number: outcome for outcome in chunk.outcomes}
        if chunk.series is not None:
            series = polars.read_parquet(BytesIO(chunk.series))
            for (number,), part in series.group_by(VARIANT, maintain_order=True):
                self.errors[int(str(number))] = part.drop(VARIANT)


def _run(
    plan: ComparisonPlan, table: str | None, cluster: tuple[Scheduler, int | None], reporter: Progress
) -> _CollectedOutcomes:
    """Run all planned runs, or those that end before an interrupt."""
    ran = _CollectedOutcomes()
    measures = FIGURES_ALONE if table in (ROBUSTNESS, STABILITY) else WITH_ERRORS
    if table == MARGINS:
        measures = WITH_MOTION
    shipment = WorkerPayload.of(f"emla-compare-{time.time_ns()}", plan.groups)

    def keep(chunk: Chunk) -> None:
        ran.keep(chunk)
        reporter.advance(len(chunk.outcomes))

    with catch_interrupts() as interrupted, open_executor(shipment, *cluster, reporter.note) as found:
        for group in {run.scenario: run.group for run in reversed(plan.runs)}.values():
            found.describe(group)  # raises the error that prevents every run
        reporter.begin("comparing", len(plan.runs), "runs")
        began = time.monotonic()
        ran.complete = found.run(plan.work(), plan.variant, measures, 0, keep, interrupted)
        if table == MARGINS:
            ran.margins = measure_margins(plan, ran.outcomes, interrupted, reporter)
            ran.complete = ran.complete and not interrupted()
        ran.wall_s = time.monotonic() - began
    if ran.outcomes and all(outcome.status == REFUSED for outcome in ran.outcomes.values()):
        raise RunError(str(next(iter(ran.outcomes.values())).problem))
    return ran


def _result(
    plan: ComparisonPlan, name: str, table: str | None, ran: _CollectedOutcomes, folder: Path | None
) -> CompareResult:
    commands = {number: plan.command(number) for number in ran.outcomes}
    compared = list(dict.fromkeys(run.controller_variant for run in plan.runs))
    return CompareResult(
        name=name,
        table=table,
        rows=add_margins(rows_of(plan, ran.outcomes), ran.margins),
        entrants=list(map(str, compared)),
        errors=ran.errors,
        commands={number: shlex.join(words) for number, words in commands.items() if words},
        notes=[*plan.notes, *_describe_other_sets(compared)],
        complete=ran.complete,
        wall_s=ran.wall_s,
        folder=folder,
    )


def _describe_other_sets(compared: Sequence[ControllerVariant]) -> list[str]:
    """Return a remark that names the existing sets of gains that are not compared."""
    left = list_other_variants(compared)
    return [f"Further sets of gains: {join_names(left)}; add them with --gains."] if left else []


def _name_of(scenario: str | Path) -> str:
    if not isinstance(scenario, (str, Path)):
        raise CommandError(f"the scenario is {scenario!r}; it must be the name or the file of a scenario.")
    path = Path(scenario)
    return path.stem if path.suffix else path.name


def _check(table: str | None, resolution: int | None, options: Mapping[str, Any]) -> None:
    """Raise CommandError for options that are wrong or do not fit together."""
    if table is not None:
        check_choice("table", table, TABLES)
    if resolution is not None and table != STABILITY:
        raise CommandError(f"only the table {STABILITY} has a resolution; remove the option.")
    if resolution is not None:
        check_resolution(resolution)
    known = {name for name, one in options_table(COMPARE).items() if one.stage != SHOWING}
    if wrong := [n for n in options if n in options_table() and n not in known]:
        raise CommandError(f"comparisons do not support the option {wrong[0]}; remove it.")


def _check_seeds(seeds: int | None, table: str | None) -> int:
    """Return the number of held-out seeds; raise CommandError if it is out of range."""
    if seeds is None:
        return 0 if table == STABILITY else SEEDS
    if not 0 <= convert_value(seeds, int, "the number of seeds") <= 1000:
        raise CommandError(f"the number of seeds is {seeds}; it must be from 0 to 1000.")
    return seeds


def _scenarios(scenario: str, table: str | None) -> list[str]:
    """Return the scenarios to run; raise CommandError for a scenario that is not in the paper's tables."""
    if table != PAPER:
        return [scenario]
    printed = [s for t in PRINTED for s in t.scenarios]
    if scenario not in printed:
        raise CommandError(
            f"the paper's tables need the scenarios {join_names(printed)}; use {printed[0]}, not "
            f"'{scenario}'."
        )
    return [s for s in printed if s in SCENARIOS]


def _cases(table: str | None, resolution: int | None) -> list[ComparisonCase]:
    if table == ROBUSTNESS:
        return robustness_cases()
    if table == STABILITY:
        return [case for m in stability_maps() for case in m.cases(resolution or RESOLUTION)]
    return [ComparisonCase()]
