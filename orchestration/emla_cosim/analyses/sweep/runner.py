"""Run a sweep: design its variants, run them on workers, and store the results."""

import contextlib
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Unpack

import polars

from ...base.errors import CommandError
from ...base.files import temporary_folder
from ...base.progress import Progress
from ...base.values import convert_value
from ...run.option_types import SweepOptions
from ...run.run_setup import select_signals
from ..execution.executor import Scheduler
from ..execution.worker_payload import check_portable
from ..frame.session import Runs, Session
from ..variants.factors import format_arguments, merge_options, needs_preparation
from ..variants.measures import (
    Chunk,
    Measures,
    Metric,
    MetricRequest,
    SimulationDescription,
    add_verdicts,
    resolve_measures,
)
from .folder import SweepFolder
from .plan import Design, Plan, Source, VariantGroup, design_variants, load_plan
from .report import OUTPUTS
from .result import SweepResult, read_sweep

_NUMBER = re.compile(r"[-+]?[0-9][0-9.,]*(e[-+]?[0-9]+)?")


def sweep(
    source: Source | Plan,
    vary: Mapping[str, Any] | None = None,
    *,
    runs: int | None = None,
    seed: int | None = None,
    sampling: str | None = None,
    metrics: Sequence[Metric] | Mapping[str, Metric] | None = None,
    signals: Sequence[str] | None = None,
    scheduler: Scheduler = None,
    workers: int | None = None,
    output: str | Path | None = None,
    overwrite: bool = False,
    resume: bool = False,
    plots: bool = False,
    report: bool = False,
    progress: Progress | None = None,
    **options: Unpack[SweepOptions],
) -> SweepResult:
    """Run many variants of a scenario on all cores or on a cluster.

    Ctrl-C ends the sweep early; the result contains the variants that were done.

    Args:
        source: a plan, its name or its file; or a scenario as for `load`, with `vary`.
        vary: what varies, and how. A name is that of a start value (`component.variable`, or a pattern), of
            an option, or of a component, whose FMU varies. A value is a `Distribution`, a list of values, or
            a text such as "0.05:0.3:20", "normal(0.14, 0.01)" or "±10%".
        runs: number of variants to draw.
        seed: seed of all random draws.
        sampling: how variants are chosen, such as "grid" or "random". Default: "grid", or "random" with
            `runs`.
        metrics: metrics to keep of each variant: names or patterns, "name = expression" over signals, or
            functions of a `Result`. Default: all registered metrics.
        signals: names or patterns of signals to keep over time.
        scheduler: address of a Dask scheduler, or a `distributed.Client`, which stays open.
            Default: processes on this machine.
        workers: number of processes on this machine. Default: one for each core.
        output: folder for the results. Default: a temporary one, deleted together with the result.
        overwrite: replace files that emla did not write.
        resume: continue the unfinished sweep in `output`.
        plots: draw plots into `output`.
        report: write a page, sweep.html, into `output`.
        progress: receives progress and notes.
        **options: values by name, for all variants.

    Returns:
        A row for each variant, and the signals that were kept.

    Raises:
        CommandError: the plan is wrong. Nothing was run.
        RunError: the cluster is lost, or files cannot be written.

    Examples:
        >>> import emla_cosim as ec
        >>> result = ec.sweep("lift", {"lift.plant.motor.R_s": [0.1, 0.2]}, stop_time=0.01)
        >>> result.variants["status"].to_list()
        ['done', 'done']
    """
    fields = {"vary": vary, "runs": runs, "seed": seed, "sampling": sampling, "metrics": metrics}
    option_values = {**options, "overwrite": True} if overwrite else {**options}
    plan = load_plan(source).updated({**fields, "signals": signals, "options": option_values})
    if output is None and resume:
        raise CommandError("to resume a sweep, set `output` to its folder.")
    with contextlib.ExitStack() as resources:
        path = resources.enter_context(temporary_folder("sweep")) if output is None else output
        path = convert_value(path, Path, "the output folder")
        folder = SweepFolder(OUTPUTS, path, overwrite, plots, report)
        session = Session(OUTPUTS, folder=folder, scheduler=scheduler, workers=workers, progress=progress)
        with session.with_workers():
            design = design_variants(plan, session.progress)
            notes = _list_notes(design)
            for note in notes:
                session.progress.note(f"Note: {note}.")
            session.check_unread([group.preparation.read for group in design.groups])
            _run(design, notes, folder, session, resume)
            result = read_sweep(folder.path)
            if output is not None and (plots or report) and result.variants.height:
                session.progress.begin("drawing plots", 1)
                folder.draw_result(result)
                session.progress.advance(1)
        return replace(result, folder=None, resources=resources.pop_all()) if output is None else result


def _list_notes(design: Design) -> list[str]:
    """Return warnings without periods, each once.

    Those on the scenario come first, then those on variants with all factors at one end of their ranges.
    """
    notes: dict[str, str] = {}
    for group in design.groups:
        for note in _list_group_notes(group):
            # notes that differ in their numbers only are one note: groups differ in values
            notes.setdefault(_NUMBER.sub("#", note), note)
    return list(notes.values())


def _list_group_notes(group: VariantGroup) -> Iterator[str]:
    """Yield notes on the scenario, and on the variants with all factors high, then low."""
    scenario = group.preparation.scenario
    if scenario is None:
        return
    yield from scenario.notes
    changing = [f for f in group.factors if not any(map(needs_preparation, f.targets))]
    for end in (1, 0):  # high end first: high loads, speeds and strokes are the critical ones
        try:
            options = merge_options(f.options(f.value(f.distribution.ends[end])) for f in changing)
            variant = scenario.with_options(options)
        except CommandError as error:  # a single run would fail with this message
            yield f"some variants cannot run: {str(error).strip().rstrip('.')}"
            continue
        yield from variant.notes


def _run(
    design: Design, notes: Sequence[str], folder: SweepFolder, session: Session[SweepResult], resume: bool
) -> None:
    """Run the variants that are not finished, and write all results but pictures and page."""
    request = MetricRequest.of(design.plan.metrics, design.plan.where)
    check_portable("metric", request.functions)
    identity = design.identity(request.identity(design.plan.signals))
    folder.check(identity, resume)
    if resume and folder.is_complete:
        return  # nothing is missing, and the files stay as they are
    with session.open_runs([group.preparation for group in design.groups]) as runs:
        measures, described = _resolve_measures(design, request, runs)
        # before the first run: a full disk after hours loses them
        folder.check_room(design.count, len(measures.names), described.rows * len(measures.signals))
        about = design.table().with_columns(
            polars.lit(design.plan.seed, polars.Int64).alias("seed"),
            polars.Series("provenance", design.provenance(identity["metrics"]), polars.String),
        )
        folder.begin(_build_record(design, notes, measures, described, identity), about, resume)
        finished = folder.list_finished()
        session.progress.begin("sweeping", design.count, "variants")
        session.progress.advance(len(finished))

        def keep(chunk: Chunk) -> None:
            folder.keep_chunk(chunk, measures)
            session.progress.advance(len(chunk.outcomes))

        size = 8 * described.rows * (2 + len(measures.signals)) if measures.signals else 0
        start, is_complete = time.monotonic(), False
        work = design.work(finished)
        try:
            is_complete = runs.executor.run(work, design.variant, measures, size, keep, runs.interrupted)
        finally:  # also without workers
            folder.finish(is_complete, time.monotonic() - start)


def _resolve_measures(
    design: Design, request: MetricRequest, runs: Runs
) -> tuple[Measures, SimulationDescription]:
    """Return the measures, and the description of the first group.

    Raises:
        CommandError: Groups have different measures, or a figure has the name of a factor.
    """
    plan, descriptions = design.plan, [runs.describe(group) for group in range(len(design.groups))]
    measures, main = list[Measures](), design.groups[0].preparation.system.main_name
    for described in descriptions:
        names, further = list(described.units), list(described.further)
        signals = select_signals(plan.signals, names, further, main) if plan.signals else []
        resolved = resolve_measures(request, described.figures, names, further, signals, plan.where)
        measures.append(add_verdicts(resolved, described.figures))
    if any(m.names != measures[0].names or m.signals != measures[0].signals for m in measures):
        raise CommandError(
            f"the variants of {plan.where} differ in their figures or signals; name those to keep."
        )
    if shared := {f.name for f in design.factors} & set(measures[0].names):
        raise CommandError(
            f"'{min(shared)}' of {plan.where} is the name of a factor and of a figure; rename one of them."
        )
    return measures[0], descriptions[0]


def _build_record(
    design: Design,
    notes: Sequence[str],
    measures: Measures,
    described: SimulationDescription,
    identity: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the initial content of sweep.json."""
    plan = design.plan
    arguments = format_arguments(plan.options) if isinstance(plan.scenario, (str, Path)) else None
    all_units = {**described.further, **described.units}
    units = {f.name: f.unit for f in design.factors} | {name: all_units[name] for name in measures.signals}
    return {
        "identity": dict(identity),
        "name": plan.name,
        "description": plan.description,
        "variants": design.count,
        "sampling": design.method,
        "runs": plan.runs,
        "seed": plan.seed,
        "vary": {name: str(entry) for name, entry in plan.vary.items()},
        "factors": {f.name: [asdict(target) for target in f.targets] for f in design.factors},
        "figures": list(measures.names),
        "expressions": dict(measures.expressions),
        "signals": list(measures.signals),
        "units": units,
        "shown": {n: asdict(d) for n in measures.figures if (d := described.figures[n].display) is not None},
        "verdicts": list(measures.verdicts),
        "notes": list(notes),
        "required": list(design.groups[0].preparation.options.require),
        "base": None if arguments is None else ["emla", "run", str(plan.scenario), *arguments],
        "systems": design.identities,
        "version": version("emla-cosim"),
    }
