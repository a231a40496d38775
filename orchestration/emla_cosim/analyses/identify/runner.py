"""Run an identification: prepare the experiments, estimate, and assess the result."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import polars

from ...base.arrays import Vector
from ...base.errors import RunError
from ...base.progress import Progress
from ...base.values import convert_value
from ...base.wording import format_count
from ...inputs.input import Input
from ...run.option_types import SweepOptions
from ..execution.executor import Scheduler
from ..frame.plan_files import Source, scenario_content
from ..frame.session import Session
from ..variants.factors import merge_options
from .certainty import Certainty, find_profile, make_estimate, rank_experiments
from .estimation import Estimator, draw_starting_points
from .plan import Experiment, IdentificationPlan, load_identification_plan
from .prediction import InterruptedRunsError, Predictor
from .preparation import IdentificationTask, prepare_task
from .problem import UNSURE, Derivatives, Problem
from .report import OUTPUTS, read_unfinished
from .residuals import LINEAR, Fit, assess_fit
from .result import SAMPLES, IdentificationResult
from .systematic_errors import assess_estimates

_FIRST_EXPERIMENT = "measured"
"""Name of the experiment of `measured`."""

_REPORTED_COST_TOLERANCE = 0.2
"""Unevenness from which it is reported: intervals are then 20 % wider."""

_SAVE_S = 5.0
"""Least time in s between two saves of an unfinished result."""


def identify(
    source: Source | IdentificationPlan,
    vary: Mapping[str, Any] | None = None,
    *,
    measured: Sequence[Input | str | Mapping[str, Any]] | None = None,
    experiments: Sequence[Experiment] | None = None,
    sigma: Mapping[str, Any] | None = None,
    loss: str | None = None,
    starts: int | None = None,
    evaluations: int | None = None,
    profile: Sequence[str] | None = None,
    seed: int | None = None,
    design: bool | None = None,
    scheduler: Scheduler = None,
    workers: int | None = None,
    output: str | Path | None = None,
    overwrite: bool = False,
    plots: bool = True,
    report: bool = False,
    progress: Progress | None = None,
    **options: Unpack[SweepOptions],
) -> IdentificationResult:
    """Estimate parameters of a system from measured data.

    Ctrl-C ends the search early; the result has the best values so far. A folder with an unfinished result
    continues from them.

    Args:
        source: a plan (`IdentificationPlan`) or its file; or a scenario, SSP or FMU as for `load`.
        vary: unknown parameters and their ranges, such as {"lift.plant.motor.J_m": "0.01:0.1"}. Positive
            ranges of a decade or more are searched logarithmically. offset(SIGNAL), gain(SIGNAL) and
            delay(SIGNAL) describe the sensor of a measured signal.
        measured: data of one experiment: files or data with `signals`, as for `Input`.
        experiments: further experiments.
        sigma: standard deviations of measured signals by name, such as "1 um". Default: those of the
            residuals.
        loss: loss function; "soft_l1", "huber", "cauchy" and "arctan" tolerate outliers. Default: linear.
        starts: number of starting points: that of the scenario, and random ones. Default: 1.
        evaluations: most iterations from each starting point. Default: 50.
        profile: parameters whose intervals are found by profile likelihood.
        seed: seed of the random starting points. Default: 0.
        design: rank the experiments by what they would tell, in place of an estimation.
        scheduler: as for `sweep`.
        workers: as for `sweep`.
        output: folder for the results. Default: no files.
        overwrite: replace files that emla did not write.
        plots: draw pictures into the folder.
        report: write a page, identify.html, into the folder.
        progress: receives progress and notes.
        **options: values of options by name, for all experiments.

    Returns:
        The estimates with their certainty, and the fit.

    Raises:
        CommandError: the plan or the data are wrong. Nothing was run.
        RunError: the runs of all starting points fail, the cluster is lost, or files cannot be written.

    Examples:
        >>> import numpy as np
        >>> import emla_cosim as ec
        >>> run = ec.load("lift", stop_time=0.2, set={"lift.plant.motor.J_m": 0.2}).prepare().run()
        >>> data = {"time": run.time, "x": run["lift.plant.x_L"]}
        >>> result = ec.identify(
        ...     "lift",
        ...     {"lift.plant.motor.J_m": "0.05:0.4"},
        ...     measured=[ec.Input(data=data, signals={"lift.plant.x_L": "x"})],
        ...     workers=1,
        ... )
        >>> round(result["lift.plant.motor.J_m"].value, 6)
        0.2
    """
    converted = convert_value(list(measured), Sequence[Input], "'measured'") if measured is not None else None
    first = [] if converted is None else [Experiment(_FIRST_EXPERIMENT, converted)]
    fields = {
        "vary": vary,
        "experiments": [*first, *(experiments or ())] or None,
        "sigma": sigma,
        "loss": loss,
        "starts": starts,
        "evaluations": evaluations,
        "profile": profile,
        "seed": seed,
        "design": design,
        "options": {**options, "overwrite": True} if overwrite else options,
    }
    plan = load_identification_plan(source).updated(fields)
    session = Session(OUTPUTS, output, overwrite, plots, report, scheduler, workers, progress)
    with session.with_workers():
        task = prepare_task(plan, session)
        with session.open_runs(task.preparations) as runs:
            measured_names = dict.fromkeys(x.signal for signals in task.signals for x in signals)
            # an experiment that is only planned records the signals whose standard deviation is known
            signals = list(measured_names or task.sigma)
            rows = max(runs.describe(i).rows for i in range(len(task.preparations)))
            predictor = Predictor(runs, task.parameters, task.signals, signals, rows)
            identification = _Identification(task, session, predictor)
            return identification.rank() if plan.design else identification.run()


@dataclass
class _Identification:
    """An identification in progress."""

    task: IdentificationTask
    session: Session[IdentificationResult]
    predictor: Predictor
    start_time: float = field(default_factory=time.monotonic)
    last_save_time: float = 0.0

    def __post_init__(self) -> None:
        plan = self.task.plan
        fitted = [i for i, experiment in enumerate(plan.experiments) if not experiment.held_out]
        self.content = scenario_content(plan.scenario, plan.options) or {}
        self.problem = Problem(self.predictor, fitted, self._choose_sigma(fitted))
        self.estimator = Estimator(self.problem, plan.loss, plan.evaluations, self._advance)

    def rank(self) -> IdentificationResult:
        """Return a result with the ranked experiments, and write its files."""
        self.session.progress.begin("ranking", 1)
        candidates = rank_experiments(self.task, self.predictor)
        self.session.progress.advance(1)
        self.session.progress.finish()
        return self._build_result(sigma=dict(self.task.sigma), candidates=candidates)

    def run(self) -> IdentificationResult:
        """Return the result, and write its files; after an interrupt it has the best values so far."""
        plan, estimator, problem = self.task.plan, self.estimator, self.problem
        self.session.progress.begin("identifying", plan.starts * plan.evaluations, "evaluations")
        points = draw_starting_points(self._choose_start(), plan.starts, plan.seed)
        free = [signal for signal in problem.sigma if signal not in self.task.sigma]
        try:
            best = estimator.estimate(points, free)
            best, slopes = estimator.differentiate(best)
            notes = self._describe_unevenness(slopes)
            (residuals,) = problem.residuals([best.point])
            assert residuals is not None
            certainty, further = assess_estimates(problem, best.point, residuals, slopes, plan.loss)
            certainty = self._add_profiles(best.point, certainty, slopes.cost_tolerance)
        except InterruptedRunsError:
            return self._save_unfinished(is_final=True)
        self.session.progress.finish()
        # intervals belong to a minimum: the user must know where the search did not reach one
        notes += further
        if not best.converged:
            notes.append(
                f"the search did not converge within {plan.evaluations} evaluations; raise --evaluations"
            )
        fits, samples = self._assess_fits(best.point)
        return self._build_result(
            best.point,
            estimates=certainty.estimates,
            correlations=certainty.correlations,
            condition=certainty.condition,
            fits=fits,
            samples=samples,
            converged=best.converged,
            notes=[*notes, *_describe_limits(fits, certainty, self.task), *self._describe_failures()],
        )

    def _choose_start(self) -> Vector:
        """Return the first starting point: that of an unfinished result, or of the scenario."""
        parameters, folder = self.task.parameters, self.session.path
        values = None if folder is None else read_unfinished(folder, parameters.names)
        if values is None:
            return parameters.start
        self.session.progress.note(f"Note: continued from the unfinished result in {folder}.")
        return np.array([item.to_fraction(values[item.name]) for item in parameters.items])

    def _choose_sigma(self, fitted: Sequence[int]) -> dict[str, float]:
        """Return the given standard deviations; for other signals the spread of what was measured."""
        spreads = dict[str, float]()
        for i in fitted:
            for signal in self.task.signals[i]:
                spreads[signal.signal] = max(spreads.get(signal.signal, 0.0), float(np.std(signal.values)))
        return {**spreads, **{k: v for k, v in self.task.sigma.items() if k in spreads}}

    def _advance(self, count: int) -> None:
        """Report evaluations, and save the best values from time to time."""
        self.session.progress.advance(count)
        now = time.monotonic()
        # a long search must not lose everything when its process is killed
        if (
            self.session.path is not None
            and self.estimator.best is not None
            and now - self.last_save_time > _SAVE_S
        ):
            self.last_save_time = now
            self._save_unfinished(is_final=False)

    def _save_unfinished(self, is_final: bool) -> IdentificationResult:
        """Return the best values so far as a result, and write its files; RunError if there are none."""
        best = self.estimator.best
        if best is None:
            raise RunError("interrupted before the first evaluation.")
        return self._build_result(
            best.point,
            is_final,
            estimates=[
                make_estimate(parameter, fraction, problem="interrupted")
                for parameter, fraction in zip(self.task.parameters.items, best.point, strict=True)
            ],
            complete=False,
            converged=False,
            notes=self._describe_failures(),
        )

    def _describe_unevenness(self, slopes: Derivatives) -> list[str]:
        """Return notes on derivatives that depend on the step of the differences."""
        names = self.task.parameters.names
        notes = list[str]()
        if unsure := [name for name, part in zip(names, slopes.doubts, strict=True) if part > UNSURE]:
            notes.append(
                f"the derivatives by {', '.join(unsure)} depend on the step of the differences: outputs are "
                "rounded, noisy or have corners; switch off noise and rounding of the simulated sensors"
            )
        if slopes.cost_tolerance > _REPORTED_COST_TOLERANCE:
            notes.append(
                f"runs with almost equal values differ: the sum of squares varies by "
                f"{2.0 * slopes.cost_tolerance:.2g} times the variance, and intervals are "
                f"{np.sqrt(1.0 + 2.0 * slopes.cost_tolerance):.2g} times as wide; drive the plant with "
                "recorded inputs instead of a simulated control loop"
            )
        return notes

    def _add_profiles(self, point: Vector, certainty: Certainty, cost_tolerance: float) -> Certainty:
        """Return the certainty with the intervals of the profile likelihood that the plan asks for."""
        estimates = list(certainty.estimates)
        for name in self.task.plan.profile:
            i = self.task.parameters.names.index(name)
            parameter, error = self.task.parameters.items[i], None
            if (interval := estimates[i].interval) is not None:
                low, high = map(parameter.to_fraction, interval)
                # an interval of 95 % is about four standard errors wide
                error = max((high - low) / 4.0, 1e-6)
            ends = find_profile(self.problem, point, i, error, self.session.progress.advance, cost_tolerance)
            lower, upper = (None if x is None else parameter.value(x) for x in ends)
            estimates[i] = replace(estimates[i], profile=(lower, upper))
        return replace(certainty, estimates=estimates)

    def _assess_fits(self, point: Vector) -> tuple[list[Fit], polars.DataFrame]:
        """Return the fit of each signal in each experiment, and all samples with their predictions."""
        (predictions,) = self.predictor.predict([point])
        fits, frames = list[Fit](), list[polars.DataFrame]()
        for i, experiment in enumerate(self.task.plan.experiments):
            name, held_out = experiment.name, experiment.held_out
            differences = self.problem.differences(point, predictions, i)
            if not differences:
                raise RunError(f"the experiment '{name}' fails with the estimates: {predictions[i]}.")
            for measured in self.task.signals[i]:
                residuals = differences[measured.signal]
                fits.append(assess_fit(name, held_out, measured, residuals, self.task.drivers[i]))
                values = (measured.time, measured.values, measured.values + residuals)
                names = [[text] * len(residuals) for text in (name, measured.signal)]
                frames.append(polars.DataFrame(dict(zip(SAMPLES, (*names, *values), strict=True))))
        return fits, polars.concat(frames)

    def _describe_failures(self) -> list[str]:
        """Return notes on start values that were not taken, and on runs that failed."""
        notes = [self.predictor.start_value_remark] if self.predictor.start_value_remark else []
        if failures := self.predictor.failures:
            ((reason, _),) = failures.most_common(1)
            notes.append(f"{format_count(failures.total(), 'run')} failed, most often because: {reason}")
        return notes

    def _build_result(
        self, point: Vector | None = None, is_final: bool = True, **fields: Any
    ) -> IdentificationResult:
        """Return a result with these fields, at a point if it is estimated, and write its files."""
        parameters = self.task.parameters
        if point is not None:
            fields["set"] = parameters.start_values(point, 0)
            fields["scenario"] = merge_options([self.content, parameters.options(point)])
        unknown = np.full((len(parameters.items), len(parameters.items)), np.nan)
        result = IdentificationResult(
            name=self.task.plan.name,
            history=polars.DataFrame(self.estimator.history),
            runs=self.predictor.runs.count,
            wall_s=time.monotonic() - self.start_time,
            folder=self.session.path,
            data_notes=self.task.notes,
            plan=self.task.plan.record,
            systems=[preparation.identity for preparation in self.task.preparations],
            **{"correlations": unknown, "sigma": dict(self.problem.sigma), **fields},
        )
        self.session.keep(result, is_final)
        return result


def _describe_limits(fits: Sequence[Fit], certainty: Certainty, task: IdentificationTask) -> list[str]:
    """Return notes on what limits the estimates."""
    notes = list[str]()
    for fit in fits:
        if fit.held_out or (fit.is_white and fit.related_input is None):
            continue
        why = f"related to the input {fit.related_input}" if fit.related_input else "correlated in time"
        notes.append(
            f"the residuals of {fit.signal} in {fit.experiment} are {why}: the model lacks something, and "
            "the estimates may be wrong by more than their intervals"
        )
    if fits and all(s in task.sigma for s in {x.signal for x in fits}) and certainty.deviation > 2.0:
        notes.append(
            f"the residuals are {certainty.deviation:.3g} times as large as the given standard deviations"
        )
    notes += [
        f"{format_count(fit.outliers, 'outlier')} among the samples of {fit.signal} in {fit.experiment}; "
        "use --loss soft_l1"
        for fit in fits
        if fit.outliers and fit.is_white and task.plan.loss == LINEAR
    ]
    return notes
