"""Run a tuning: a search proposes gains, workers evaluate them, and other seeds validate the result."""

import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import polars

from ...base.arrays import Vector
from ...base.errors import RunError
from ...base.progress import Progress
from ...run.option_types import TuneOptions
from ...run.requirements import check_no_condition
from ...system.model import Value
from ..execution.executor import Scheduler
from ..frame.plan_files import Source, load_planned, scenario_content
from ..frame.session import Session
from ..variants.measures import Metric
from ..variants.sampling import draw_seeds
from .evaluation import Evaluation, describe_step
from .plan import TuningPlan, load_tuning_plan
from .preparation import TuningTask, prepare_task
from .report import OUTPUTS
from .result import Tuned, TuneResult
from .score import Order, Score, record_tracking_error

_INITIAL_DEVIATION = 0.25
"""Standard deviation of the first generation; 1 is the whole range of a gain."""

_MIN_DISTANCE = 0.02
"""Least distance of the first point from the ends of its range."""

_TOLERANCE = 1e-4
"""Tolerance of convergence (`tolx` of CMA-ES), as a part of the range."""

_NEVER = 10**9


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
    report: bool = False,
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
        report: write a page, tune.html, into the folder.
        progress: receives progress and notes.
        **options: values by name, for all runs.

    Returns:
        The first and the best gains, and a row for each set of gains.

    Raises:
        CommandError: the plan is wrong. Nothing was run.
        RunError: the cluster is lost, no run succeeds, or files cannot be written.

    Examples:
        >>> import emla_cosim as ec
        >>> result = ec.tune(
        ...     "lift",
        ...     {"lift.controller.k_p": "100:300"},
        ...     objective="lift.position_error_m",
        ...     controller="foc",
        ...     evaluations=1,
        ...     stop_time=0.01,
        ... )
        >>> result.history.height
        1
    """
    fields = {
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
        "options": {**options, "overwrite": True} if overwrite else options,
    }
    plan = load_tuning_plan(source).updated(fields)
    session = Session(OUTPUTS, output, overwrite, plots, report, scheduler, workers, progress)
    with session.with_workers(), record_tracking_error():
        scenario = load_planned(plan)
        check_no_condition(scenario.options.stop_when, "tune")
        prepared = session.prepare(scenario)
        # as conditions of the search: as requirements of a run they would make it fail
        conditions = [*plan.require, *prepared.options.require]
        preparation = replace(prepared, options=replace(prepared.options, require=[]))
        with session.open_runs([preparation]) as runs:
            task = prepare_task(replace(plan, require=conditions), preparation, runs.describe(), scenario)
            return _Tuning(task, Evaluation(runs, task), session, scenario.notes).run()


class Search:
    """Points of the unit cube to try, by CMA-ES of pycma, which uses only their order.

    Each restart doubles the size of a generation. The same seed and the same order give the same points.
    """

    def __init__(self, start: Sequence[float], seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._dimension = len(start)
        self._restart(np.clip(start, _MIN_DISTANCE, 1 - _MIN_DISTANCE), None)

    def propose(self) -> list[Vector]:
        """Return the next generation."""
        if self._strategy.stop():
            self._restart(self._random.random(self._dimension), 2 * self._strategy.popsize)
        self._proposed = self._strategy.ask()
        return [np.array(point) for point in self._proposed]

    def report_order(self, orders: Sequence[Order]) -> None:
        """Report the sort keys of the points of this generation, in the same order."""
        # ranks: violations and objectives have no common scale
        ranks = {order: rank for rank, order in enumerate(sorted(set(orders)))}
        self._strategy.tell(self._proposed, [float(ranks[order]) for order in orders])

    def _restart(self, start: Vector, size: int | None) -> None:
        """Start another search around a point; `size` is that of its generations, None for the default."""
        import cma  # slow to import

        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: self._random.standard_normal(shape),
            "seed": math.nan,  # any number would seed the global generator of NumPy
            "tolx": _TOLERANCE,
            # CMA-ES sees ranks, for which tolerances of values mean nothing
            "tolfun": 0,
            "tolfunhist": 0,
            "tolfunrel": 0,
            "tolflatfitness": _NEVER,
            "tolstagnation": _NEVER,
            "verbose": -9,
            "verb_log": 0,
            **({} if size is None else {"popsize": size}),
            **({"maxstd": math.inf} if len(start) == 1 else {}),  # cma raises if this limits one dimension
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # one dimension works
            self._strategy = cma.CMAEvolutionStrategy(start.tolist(), _INITIAL_DEVIATION, options)


@dataclass
class _Tuning:
    """A tuning in progress: the best gains so far, and all that were tried."""

    task: TuningTask
    evaluation: Evaluation
    session: Session[TuneResult]
    notes: Sequence[str]
    rows: list[dict[str, Any]] = field(default_factory=list)
    start_time: float = field(default_factory=time.monotonic)
    remarks: Sequence[str] = ()

    def run(self) -> TuneResult:
        """Return the result of search and validation, and write its files."""
        plan, space = self.task.plan, self.task.space
        count = 0 if self.task.seeds is None else plan.training + plan.validation
        seeds = draw_seeds(plan.seed, count)
        training, validation = seeds[: plan.training], seeds[plan.training :]
        self.seeds = {"training": training, "validation": validation}
        # a system without random sequences runs once, with the seeds of the scenario
        training = training or [None]
        self.session.progress.begin("tuning", plan.evaluations, "gains")
        # the gains of the scenario come first: the result must not be worse than these
        first = self.evaluation.score([{}], training)
        if first is None:
            raise RunError("interrupted before the first evaluation.")
        self.start = self.best = Tuned(dict(space.start), {}, first[0])
        self._add_rows(0, [(dict(space.start), first[0])])
        complete = self._search(training)
        if complete and validation:
            complete = self._validate(validation)
        # runs that failed have no objective to compare
        if complete and not self.best.training.lost:
            complete = self._score_half_step(training)
        return self._build_result(complete, is_final=True)

    def _search(self, seeds: Sequence[int | None]) -> bool:
        """Try generations, keep the best gains, and write files; return False after an interrupt.

        It ends before the generation for which too few evaluations are left.
        """
        plan, space = self.task.plan, self.task.space
        search = Search(space.start_point(), plan.seed)
        generation, remaining = 0, plan.evaluations - 1
        while len(points := search.propose()) <= remaining:
            generation += 1
            values = [space.values(point) for point in points]
            gains = [space.options(v) for v in values]
            scores = self.evaluation.score(gains, seeds)
            if scores is None:
                return False
            search.report_order([score.order for score in scores])
            remaining -= len(points)
            self._add_rows(generation, list(zip(values, scores, strict=True)))
            # the first of equal ones, so that the result does not depend on the order of workers
            first = min(range(len(scores)), key=[score.order for score in scores].__getitem__)
            if scores[first].order < self.best.training.order:
                self.best = Tuned(values[first], gains[first]["set"], scores[first])
            self._build_result(False, is_final=False)
        return True

    def _validate(self, seeds: Sequence[int | None]) -> bool:
        """Run start and best with other seeds; return False after an interrupt."""
        scores = self.evaluation.score([{}, {"set": self.best.set}], seeds)
        if scores is None:
            return False
        self.start, self.best = (
            replace(gains, validation=score)
            for gains, score in zip((self.start, self.best), scores, strict=True)
        )
        return True

    def _score_half_step(self, seeds: Sequence[int | None]) -> bool:
        """Add the score of the best gains with half the step; return False after an interrupt."""
        halved = self.evaluation.score_with_half_step({"set": self.best.set}, seeds)
        if halved is None:
            return False
        self.best = replace(self.best, half_step=halved.score)
        self.remarks = describe_step(self.start, self.best, halved)
        return True

    def _add_rows(self, generation: int, scores: Sequence[tuple[Mapping[str, Value | None], Score]]) -> None:
        """Add a row for each evaluated set of gains, and report the progress."""
        for values, score in scores:
            before = self.rows[-1]["best"] if self.rows else float("inf")
            objective = score.objective if not score.violation else float("inf")
            self.rows.append(
                {
                    "evaluation": len(self.rows),
                    "generation": generation,
                    **values,
                    "objective": score.objective,
                    "violation": score.violation,
                    "lost": score.lost,
                    "best": min(before, objective),
                }
            )
        self.session.progress.advance(len(scores))

    def _build_result(self, complete: bool, is_final: bool) -> TuneResult:
        """Return the result so far, and write its files."""
        plan = self.task.plan
        history = polars.DataFrame(self.rows, infer_schema_length=None)
        result = TuneResult(
            plan.name,
            plan.objective,
            self.start,
            self.best,
            history.with_columns(polars.col("best").replace(float("inf"), None)),
            {axis.name: axis.factor.unit for axis in self.task.space.axes if axis.factor is not None},
            self.seeds,
            plan.tolerance,
            complete,
            self.evaluation.runs.count,
            time.monotonic() - self.start_time,
            self.session.path,
            self.notes,
            self.remarks,
            plan.record,
            self.task.identity,
            scenario_content(plan.scenario, plan.options),
        )
        self.session.keep(result, is_final)
        return result
