"""Run a tuning: a search proposes gains, workers evaluate them, and other seeds validate the result."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Unpack

import polars

from ...base.errors import RunError
from ...base.files import hash_plain_data
from ...base.interruption import catch_interrupts
from ...base.progress import Progress
from ...base.values import convert_value
from ...run.option_types import TuneOptions
from ...run.options import select_repeatable
from ...run.requirements import check_no_condition
from ...run.scenarios.scenario import Scenario
from ...system.model import Value
from ..execution.executor import Scheduler, check_cluster, open_executor
from ..execution.worker_payload import Preparation, WorkerPayload
from ..frame.plan_files import Source, load_planned
from ..frame.scenario_text import scenario_content
from ..variants.measures import Metric
from ..variants.sampling import draw_seeds
from .data import Tuned
from .evaluation import Evaluation
from .folder import TuneFolder
from .plan import PLAIN_FIELDS, TuningPlan, load_tuning_plan
from .preparation import TuningTask, prepare_task
from .result import TuneResult
from .score import Score
from .search import Search
from .step_influence import describe_step
from .tracking import record_tracking_error


def tune(
    source: Source | TuningPlan,
    vary: Mapping[str, Any] | None = None,
    *,
    objective: str | None = None,
    require: Sequence[str] | None = None,
    derive: Mapping[str, str] | None = None,
    metrics: Sequence[Metric] | None = None,
    evaluations: int | None = None,
    training: int | None = None,
    validation: int | None = None,
    seed: int | None = None,
    tolerance: float | None = None,
    scheduler: Scheduler = None,
    workers: int | None = None,
    output: str | Path | None = None,
    overwrite: bool = False,
    plots: bool = True,
    progress: Progress | None = None,
    **options: Unpack[TuneOptions],
) -> TuneResult:
    """Search gains that make an objective small while conditions hold.

    Ctrl-C ends the search early; the result contains the best gains so far.

    Args:
        source: a plan (`TuningPlan`), its name or its file; or a scenario as for `load`, with `vary`.
        vary: gains and their ranges, as for `sweep`. A positive range such as "200:4000" is searched
            logarithmically.
        objective: expression over metrics, to be minimized.
        require: conditions on metrics, such as "lift.position_error_m < 1e-3".
        derive: further start values, as expressions over what varies.
        metrics: further metrics that objective and conditions can use.
        evaluations: number of sets of gains to try.
        training: number of seeds for the search.
        validation: number of other seeds, with which the first and the best gains are run at the end.
        seed: seed of the search. The same seed gives the same result with any number of workers.
        tolerance: relative increase of the objective that is allowed on the validation seeds.
        scheduler: as for `sweep`.
        workers: as for `sweep`.
        output: folder for the results. Default: no files.
        overwrite: replace files that emla did not write.
        plots: draw pictures into the folder.
        progress: receives progress and notes.
        **options: values by name, for all runs.

    Returns:
        The first and the best gains, and a row for each set of gains.

    Raises:
        CommandError: the plan is wrong. Nothing was run.
        RunError: the cluster is lost, no run succeeds, or files cannot be written.

    Examples:
        >>> import emla_cosim as ec
        >>> found = ec.tune(
        ...     "lift",
        ...     {"lift.controller.k_p": "100:300"},
        ...     objective="lift.position_error_m",
        ...     controller="foc",
        ...     evaluations=1,
        ...     stop_time=0.01,
        ... )
        >>> found.history.height
        1
    """
    given = {
        "vary": vary,
        "objective": objective,
        "require": require,
        "derive": derive,
        "metrics": metrics,
        "evaluations": evaluations,
        "training": training,
        "validation": validation,
        "seed": seed,
        "tolerance": tolerance,
        "options": {**options, "overwrite": True} if overwrite else {**options},
    }
    plan = load_tuning_plan(source).updated(given)
    check_cluster(scheduler, workers)
    folder = (
        None if output is None else TuneFolder(convert_value(output, Path, "the output folder"), overwrite)
    )
    reporter = progress or Progress()
    with nullcontext() if folder is None else folder.alone():
        scenario = load_planned(plan)
        check_no_condition(scenario.options.stop_when, "tune")
        for note in scenario.notes:
            reporter.note(f"Note: {note}.")
        preparation = Preparation.of(scenario, reporter)
        with (
            record_tracking_error(),
            _open_evaluation(plan, scenario, preparation, (scheduler, workers), reporter) as (
                task,
                evaluation,
            ),
        ):
            return _Tuning(task, evaluation, folder, reporter, scenario.notes).run(plots)


@contextmanager
def _open_evaluation(
    plan: TuningPlan,
    scenario: Scenario,
    preparation: Preparation,
    cluster: tuple[Scheduler, int | None],
    reporter: Progress,
) -> Iterator[tuple[TuningTask, Evaluation]]:
    """Open workers with all that a tuning needs; yield its task and its evaluation."""
    conditions = [*plan.require, *preparation.options.require]
    free = replace(preparation, options=replace(preparation.options, require=[]))
    shipment = WorkerPayload.of(f"emla-tune-{hash_plain_data((plan.where, time.time_ns()))}", [free])
    with catch_interrupts() as interrupted, open_executor(shipment, *cluster, reporter.note) as found:
        task = prepare_task(replace(plan, require=conditions), free, found.describe(0), scenario)
        yield (
            task,
            Evaluation(found, task.objective, task.measures, task.cases, task.seeds, interrupted, task.loops),
        )


@dataclass
class _Tuning:
    """A tuning in progress: the best gains so far, and all that were tried."""

    task: TuningTask
    evaluation: Evaluation
    folder: TuneFolder | None
    reporter: Progress
    notes: Sequence[str]
    rows: list[dict[str, Any]] = field(default_factory=list)
    began: float = field(default_factory=time.monotonic)
    remarks: Sequence[str] = ()

    def run(self, plots: bool) -> TuneResult:
        """Run the whole tuning."""
        plan, space = self.task.plan, self.task.space
        training, validation = self._seeds()
        self.drawn = {"training": _known(training), "validation": _known(validation)}
        self.reporter.begin("tuning", plan.evaluations, "gains")
        first = self.evaluation.scores([{}], training)
        if first is None:
            raise RunError("interrupted before any gains were tried.")
        self.start = self.best = Tuned(dict(space.start), {}, first[0])
        self._note_tried(0, [(dict(space.start), first[0])])
        whole = self._search(training)
        if whole and validation:
            whole = self._validate(validation)
        if whole and not self.best.training.lost:
            whole = self._judge_step(training)
        return self._save_progress(whole, plots)

    def _search(self, seeds: Sequence[int | None]) -> bool:
        """Try what the search asks for while evaluations are left; return False after an interrupt."""
        plan, space = self.task.plan, self.task.space
        search = Search(space.places(), plan.seed)
        generation, left = 0, plan.evaluations - 1
        while len(asked := search.ask()) <= left:
            generation += 1
            values = [space.values(point) for point in asked]
            gains = [space.options(v) for v in values]
            scores = self.evaluation.scores(gains, seeds)
            if scores is None:
                return False
            search.tell([score.order for score in scores])
            left -= len(asked)
            self._note_tried(generation, list(zip(values, scores, strict=True)))
            place = min(range(len(scores)), key=[_comparison_key(score) for score in scores].__getitem__)
            if _comparison_key(scores[place]) < _comparison_key(self.best.training):
                self.best = Tuned(values[place], gains[place]["set"], scores[place])
            self._save_progress(False)
        return True

    def _validate(self, seeds: Sequence[int | None]) -> bool:
        """Run start and best with other seeds; return False after an interrupt."""
        scores = self.evaluation.scores([{}, {"set": self.best.set}], seeds)
        if scores is None:
            return False
        self.start, self.best = (
            replace(gains, validation=score)
            for gains, score in zip((self.start, self.best), scores, strict=True)
        )
        return True

    def _judge_step(self, seeds: Sequence[int | None]) -> bool:
        """Run the best gains with half the step; return False after an interrupt."""
        halved = self.evaluation.halve_step({"set": self.best.set}, seeds)
        if halved is None:
            return False
        self.best = replace(self.best, half_step=halved.score)
        self.remarks = describe_step(self.start, self.best, halved)
        return True

    def _seeds(self) -> tuple[list[int | None], list[int | None]]:
        """Return the seeds of training and of validation; [None] and [] without random sequences."""
        plan = self.task.plan
        if self.task.seeds is None:
            return [None], []
        drawn: list[int | None] = [*draw_seeds(plan.seed, plan.training + plan.validation)]
        return drawn[: plan.training], drawn[plan.training :]

    def _note_tried(self, generation: int, tried: Sequence[tuple[Mapping[str, Value | None], Score]]) -> None:
        for values, score in tried:
            before = self.rows[-1]["best"] if self.rows else float("inf")
            known = score.objective if not score.violation else float("inf")
            self.rows.append(
                {
                    "evaluation": len(self.rows),
                    "generation": generation,
                    **values,
                    "objective": score.objective,
                    "violation": score.violation,
                    "lost": score.lost,
                    "best": min(before, known),
                }
            )
        self.reporter.advance(len(tried))

    def _save_progress(self, whole: bool, draw: bool = False) -> TuneResult:
        """Return the result so far, and write it to the folder."""
        plan = self.task.plan
        history = polars.DataFrame(self.rows, infer_schema_length=None)
        result = TuneResult(
            plan.name,
            plan.objective,
            self.start,
            self.best,
            history.with_columns(polars.col("best").replace(float("inf"), None)),
            self.task.units,
            self.drawn,
            plan.tolerance,
            whole,
            self.evaluation.runs,
            time.monotonic() - self.began,
            None if self.folder is None else self.folder.path,
            self.notes,
            self.remarks,
        )
        if self.folder is not None:
            self.folder.keep(
                result, _record(self.task, result), scenario_content(plan.scenario, plan.options)
            )
            if draw:
                self.folder.draw_result(result)
        return result


def _known(seeds: Sequence[int | None]) -> list[int]:
    return [seed for seed in seeds if seed is not None]


def _comparison_key(score: Score) -> tuple[bool, float]:
    """Return the sort key of a score; a score without a number is last."""
    bad, value = score.order
    return bad, value if value == value else float("inf")


def _record(task: TuningTask, result: TuneResult) -> dict[str, Any]:
    """Return the content of tune.json: everything that determines the result, and the result."""
    plan = task.plan
    asked = {
        **{name: getattr(plan, name) for name in PLAIN_FIELDS},
        "scenario": plan.scenario if isinstance(plan.scenario, str) else str(plan.name),
        "vary": {name: str(given) for name, given in plan.vary.items()},
        "cases": [asdict(case) for case in plan.cases],
        "metrics": [str(metric) for metric in plan.metrics],
        "options": {name: str(given) for name, given in select_repeatable(plan.options).items()},
    }
    return {
        "name": plan.name,
        "status": "completed" if result.complete else "unfinished",
        "problem": result.problem(),
        "notes": list(result.notes),
        "remarks": list(result.remarks),
        "plan": asked,
        "seeds": result.seeds,
        "start": _gains(result.start),
        "best": _gains(result.best),
        "units": result.units,
        "runs": result.runs,
        "wall_s": result.wall_s,
        "system": task.identity,
        "version": version("emla-cosim"),
    }


def _gains(gains: Tuned) -> dict[str, Any]:
    return {**asdict(gains), "ratio": gains.ratio}
