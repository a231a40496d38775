"""Run an identification: prepare the experiments, estimate, and judge what came out."""

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import polars

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from ...base.files import hash_plain_data
from ...base.interruption import catch_interrupts
from ...base.progress import Progress
from ...base.quantities import read_quantity
from ...base.units import SiUnit
from ...base.values import convert_value
from ...base.wording import format_count
from ...inputs.input import Input
from ...run.option_types import SweepOptions
from ...system.names import Names
from ..execution.executor import Executor, Scheduler, check_cluster, open_executor
from ..execution.worker_payload import Preparation, WorkerPayload
from ..frame.plan_files import Source, load_planned
from ..frame.scenario_text import scenario_content
from ..variants.targets import merge_options
from .certainty import Certainty, Estimate, judge
from .design import Candidate, rank_experiments
from .estimation import Estimator, draw_starting_points
from .fit import Fit, assess_fit, list_poor_fits
from .folder import IdentificationFolder, read_unfinished
from .loss import LINEAR
from .measurement import MeasuredSignal, read_drivers, read_measurements
from .parameters import DELAY, Parameters, resolve_parameters
from .plan import Experiment, IdentificationPlan, load_identification_plan
from .prediction import InterruptedRunsError, Predictor
from .problem import UNSURE, Derivatives, Problem
from .profile import profile as profile_interval
from .result import IdentificationResult
from .step_influence import judge_step
from .time_shift import describe_shifts, find_time_shifts

_MEASURED = "measured"
"""Name of the experiment of `measured`."""

_UNEVEN = 0.2
"""Unevenness from which it is reported: intervals are then 20 % wider."""

_SAVE_S = 5.0
"""Least time in s between two saves of an unfinished result."""

_ROWS = 10
"""Rows of the simulation from one sample to the next if sensors may be late: straight lines between rows are
too coarse for them.
"""


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
        loss: loss function; "soft_l1", "huber", "cauchy" and "arctan" bear outliers. Default: linear.
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
        report: write a page into the folder.
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
        >>> found = ec.identify(
        ...     "lift",
        ...     {"lift.plant.motor.J_m": "0.05:0.4"},
        ...     measured=[ec.Input(data=data, signals={"lift.plant.x_L": "x"})],
        ...     workers=1,
        ... )
        >>> round(found["lift.plant.motor.J_m"].value, 6)
        0.2
    """
    own = None
    if measured is not None:
        own = [Experiment(_MEASURED, convert_value(list(measured), Sequence[Input], "'measured'"))]
    given = {
        "vary": vary,
        "experiments": [*(own or ()), *(experiments or ())] or None,
        "sigma": sigma,
        "loss": loss,
        "starts": starts,
        "evaluations": evaluations,
        "profile": profile,
        "seed": seed,
        "design": design,
        "options": {**options, "overwrite": True} if overwrite else {**options},
    }
    plan = load_identification_plan(source).updated(given)
    check_cluster(scheduler, workers)
    folder = None
    if output is not None:
        place = convert_value(output, Path, "the output folder")
        folder = IdentificationFolder(place, overwrite, plots, report)
    reporter = progress or Progress()
    with nullcontext() if folder is None else folder.alone():
        task = _prepare(plan, reporter)
        if folder is not None:
            measured_files = {
                file: "the measured data"
                for one in plan.experiments
                for data in one.measured
                if (file := data.file) is not None
            }
            folder.check_unread([measured_files, *(one.read for one in task.preparations)])
        key = f"emla-identify-{hash_plain_data((plan.where, time.time_ns()))}"
        payload = WorkerPayload.of(key, task.preparations)
        with (
            catch_interrupts() as interrupted,
            open_executor(payload, scheduler, workers, reporter.note) as executor,
        ):
            identification = _Identification(task, folder, reporter)
            return identification.run(_predictor(task, executor, interrupted))


@dataclass(frozen=True)
class _Task:
    """A prepared identification."""

    plan: IdentificationPlan
    preparations: Sequence[Preparation]
    signals: Sequence[Sequence[MeasuredSignal]]
    parameters: Parameters
    sigma: Mapping[str, float]
    drivers: Sequence[Mapping[str, tuple[Vector, Vector]]]
    notes: Sequence[str]


def _prepare(plan: IdentificationPlan, reporter: Progress) -> _Task:
    """Prepare the experiments, and read what was measured."""
    preparations, signals, notes = list[Preparation](), list[list[MeasuredSignal]](), list[str]()
    units: dict[str, SiUnit | None] = {}
    given: dict[str, Any] = {}
    drivers = list[dict[str, tuple[Vector, Vector]]]()
    for one in plan.experiments:
        label = f"the experiment '{one.name}'"
        scenario = load_planned(plan, one.options)
        for note in scenario.notes:
            reporter.note(f"Note: {note}.")
        preparation = Preparation.of(scenario, reporter)

        def find_signal(name: str, of: Preparation = preparation) -> tuple[str, SiUnit | None]:
            signal, unit = _find_signal(of, name)
            units[signal] = unit
            return signal, unit

        begin = preparation.options.start_time or 0.0
        found, told = read_measurements(one.measured, find_signal, label, begin)
        given = {find_signal(name)[0]: value for name, value in plan.sigma.items()}
        drivers.append(read_drivers(scenario.options.input, begin))
        notes += [note for note in told if note not in notes]
        late = any(DELAY in name for name in plan.vary)
        used = replace(preparation.options, require=[], **_times(preparation.options, found, late))
        preparations.append(replace(preparation, options=used))
        start, stop = used.start_time or 0.0, used.stop_time or 0.0
        inside = [x.between(start, stop) for x in found]
        for whole, part in zip(found, inside, strict=True):
            if len(part.time) < 2:
                raise CommandError(
                    f"{whole.label} has no samples between {start:g} s and {stop:g} s, the times of {label}."
                )
            if (left := len(whole.time) - len(part.time)) > 0:
                notes.append(f"{format_count(left, 'sample')} of {whole.label} outside of the run: not used.")
        signals.append(inside)
    parameters = resolve_parameters(plan, preparations, units)
    sigma = _read_sigma(given, units)
    if not plan.design:
        _check_counts(plan, signals, parameters)
        measured = {x.signal for of in signals for x in of}
        if idle := [signal for signal in sigma if signal not in measured]:
            raise CommandError(f"{idle[0]} in 'sigma' of {plan.where} is not measured.", signal=idle[0])
    for note in notes:
        reporter.note(f"Note: {note}")
    preparations = _extend(preparations, parameters)
    return _Task(plan, preparations, signals, parameters, sigma, drivers, notes)


def _extend(preparations: Sequence[Preparation], parameters: Parameters) -> list[Preparation]:
    """Return preparations whose runs are so long that a sensor ahead of time can be predicted to the end."""
    ahead = max((-one.low for one in parameters.items if one.sensor and one.sensor[0] == DELAY), default=0.0)
    found = list[Preparation]()
    for one in preparations:
        options = one.options
        if ahead > 0.0 and options.stop_time is not None:
            step = options.step_size or ahead
            stop = options.stop_time + step * math.ceil(ahead / step - 1e-9)
            options = replace(options, stop_time=stop)
        found.append(replace(one, options=options))
    return found


def _find_signal(preparation: Preparation, signal: str) -> tuple[str, SiUnit | None]:
    """Return full name and unit of a signal; raise CommandError if it does not exist, or is no number."""
    found = Names(preparation.system, preparation.interfaces).find(signal)
    if found.variable.type not in ("Real", "Integer"):
        raise CommandError(f"{signal} is of the type {found.variable.type}; measured signals are numbers.")
    return found.full_name, found.unit


def _times(options: Any, found: Sequence[MeasuredSignal], late: bool) -> dict[str, Any]:
    """Return stop time and output interval that suit the measurement, where the user gave none.

    Samples of a sensor that may be late are between rows, which are nearer to each other then.
    """
    changed: dict[str, Any] = {}
    if not found:
        return changed
    last = max(float(one.time[-1]) for one in found)
    start, step = options.start_time or 0.0, options.step_size
    if options.stop_time is None or options.stop_time > last:
        changed["stop_time"] = last if not step else start + step * np.ceil((last - start) / step - 1e-9)
    if options.output_interval is None and step:
        between = min(float(np.median(np.diff(one.time))) for one in found)
        changed["output_interval"] = step * max(round(min(between, 1e-3) / (_ROWS if late else 1) / step), 1)
    return {name: float(value) for name, value in changed.items()}


def _read_sigma(asked: Mapping[str, Any], units: Mapping[str, SiUnit | None]) -> dict[str, float]:
    found = {}
    for signal, given in asked.items():
        label = f"the standard deviation of {signal}"
        value = read_quantity(str(given), label, units[signal])
        if not 0.0 < value < float("inf"):
            raise CommandError(f"{label} is {given}; it must be positive.", signal=signal)
        found[signal] = value
    return found


def _check_counts(
    plan: IdentificationPlan, signals: Sequence[Sequence[MeasuredSignal]], parameters: Parameters
) -> None:
    fitted = [x for one, of in zip(plan.experiments, signals, strict=True) if not one.held_out for x in of]
    samples = sum(len(x.time) for x in fitted)
    if samples <= len(parameters.items):
        raise CommandError(
            f"{plan.where} has {samples} samples for {len(parameters.items)} parameters; more are needed."
        )


def _predictor(task: _Task, executor: Executor, interrupted: Any) -> Predictor:
    names = list(dict.fromkeys(x.signal for of in task.signals for x in of)) or list(task.sigma)
    rows = max(executor.describe(i).rows for i in range(len(task.preparations)))
    return Predictor(executor, task.parameters, task.signals, names, rows, interrupted)


@dataclass
class _Identification:
    """An identification in progress."""

    task: _Task
    folder: IdentificationFolder | None
    reporter: Progress
    began: float = field(default_factory=time.monotonic)
    saved: float = 0.0

    def run(self, predictor: Predictor) -> IdentificationResult:
        """Run the whole identification."""
        if self.task.plan.design:
            return self._design(predictor)
        plan = self.task.plan
        fitted = [i for i, one in enumerate(plan.experiments) if not one.held_out]
        sigma = self._first_sigma(fitted)
        problem = Problem(predictor, fitted, sigma)
        estimator = Estimator(problem, plan.loss, plan.evaluations, lambda n: self._advance(estimator, n))
        self.reporter.begin("identifying", plan.starts * plan.evaluations, "evaluations")
        points = draw_starting_points(self._start(), plan.starts, plan.seed)
        free = [signal for signal in sigma if signal not in self.task.sigma]
        try:
            best = estimator.estimate(points, free)
            best, slopes = estimator.differentiate(best)
            notes = self._describe_unevenness(slopes)
            (residuals,) = problem.residuals([best.point])
            assert residuals is not None
            certainty, judgement = self._judge(problem, best.point, residuals, slopes)
            certainty = self._profiled(problem, best.point, certainty)
            notes += judgement
        except InterruptedRunsError:
            return self._interrupted(estimator, problem)
        self.reporter.finish()
        if not best.converged:
            notes.append(
                f"the search did not converge within {plan.evaluations} evaluations; raise --evaluations"
            )
        return self._finish(estimator, problem, best.point, certainty, best.converged, notes)

    def _start(self) -> Vector:
        """Return the first starting point: that of an unfinished result, or of the scenario."""
        found = None if self.folder is None else read_unfinished(self.folder.path, self.task.parameters.names)
        if found is None:
            return self.task.parameters.start
        self.reporter.note(f"Note: continued from the unfinished result in {self.folder.path}.")  # type: ignore[union-attr]
        return np.array([one.place(found[one.name]) for one in self.task.parameters.items])

    def _first_sigma(self, fitted: Sequence[int]) -> dict[str, float]:
        """Return the given standard deviations; for other signals the spread of what was measured."""
        found = dict[str, float]()
        for i in fitted:
            for one in self.task.signals[i]:
                found[one.signal] = max(found.get(one.signal, 0.0), float(np.std(one.values)))
        return {**found, **{k: v for k, v in self.task.sigma.items() if k in found}}

    def _advance(self, estimator: Estimator, count: int) -> None:
        self.reporter.advance(count)
        now = time.monotonic()
        if self.folder is not None and estimator.best is not None and now - self.saved > _SAVE_S:
            self.saved = now
            self.folder.keep_unfinished(self.task.parameters.values(estimator.best.point))

    def _describe_unevenness(self, found: Derivatives) -> list[str]:
        """Return notes on derivatives that depend on the step of the differences."""
        names = self.task.parameters.names
        notes = list[str]()
        if unsure := [name for name, part in zip(names, found.doubts, strict=True) if part > UNSURE]:
            notes.append(
                f"the derivatives by {', '.join(unsure)} depend on the step of the differences: outputs are "
                "rounded, noisy or have corners; switch off noise and rounding of the simulated sensors"
            )
        if found.unevenness > _UNEVEN:
            notes.append(
                f"runs with almost equal values differ: the sum of squares is uneven by "
                f"{2.0 * found.unevenness:.2g} times the variance, and intervals are "
                f"{np.sqrt(1.0 + 2.0 * found.unevenness):.2g} times as wide for it; drive the plant with "
                "recorded inputs instead of a simulated control loop"
            )
        return notes

    def _profiled(self, problem: Problem, point: Vector, found: Certainty) -> Certainty:
        estimates = list(found.estimates)
        for name in self.task.plan.profile:
            i = self.task.parameters.names.index(name)
            one = self.task.parameters.items[i]
            error = None
            if (interval := estimates[i].interval) is not None:
                error = max((one.place(interval[1]) - one.place(interval[0])) / 4.0, 1e-6)
            ends = profile_interval(problem, point, i, error, self.reporter.advance)
            values = [None if x is None else one.value(x) for x in ends]
            estimates[i] = replace(estimates[i], profile=(values[0], values[1]))
        return replace(found, estimates=estimates)

    def _judge(
        self, problem: Problem, point: Vector, residuals: Vector, slopes: Derivatives
    ) -> tuple[Certainty, list[str]]:
        """Return the certainty of the estimates, and a note if the step makes them or cannot be judged."""
        parameters, loss = self.task.parameters, self.task.plan.loss
        lengths = [len(one.time) for one in problem.samples]

        def assess(of: Vector, moves: Vector | None = None) -> Certainty:
            return judge(
                parameters,
                point,
                of,
                slopes.matrix,
                lengths,
                slopes.change,
                loss,
                problem.blocked,
                slopes.unevenness,
                moves,
            )

        if problem.is_exact(residuals):
            return assess(residuals), ["the step is not judged: the fit is exact, residuals are rounding"]
        sensors = [one.sensor for one in parameters.items if one.sensor is not None]
        shifts, moves = find_time_shifts(
            problem.samples,
            residuals,
            slopes.matrix,
            [problem.sigma[one.signal] for one in problem.samples],
            loss,
            known={signal for kind, signal in sensors if kind == DELAY},
        )
        notes = describe_shifts(shifts, parameters, point, moves, assess(residuals))
        shifted = partial(assess, moves=moves)
        halved = problem.halve_step(point)
        if isinstance(halved, str):
            return shifted(residuals), [*notes, f"the step is not judged: {halved.rstrip('.')}"]
        half = max(problem.predictor.half_steps.values(), key=lambda half: half.step)
        judged = (parameters, point, residuals, halved, slopes.matrix, loss, half)
        found, made = judge_step(*judged, assess)
        if made or not shifts:  # a shift that the step makes is not one of the machine
            return found, made
        found, made = judge_step(*judged, shifted)
        return found, [*notes, *made]

    def _interrupted(self, estimator: Estimator, problem: Problem) -> IdentificationResult:
        if estimator.best is None:
            raise RunError("interrupted before any values were tried.")
        values = self.task.parameters.values(estimator.best.point)
        estimates = [
            Estimate(
                one.name, values[one.name], one.unit, one.start, one.low, one.high, problem="interrupted"
            )
            for one in self.task.parameters.items
        ]
        count = len(estimates)
        certainty = Certainty(estimates, np.full((count, count), np.nan), float("nan"), float("nan"))
        return self._finish(estimator, problem, estimator.best.point, certainty, False, [], complete=False)

    def _finish(
        self,
        estimator: Estimator,
        problem: Problem,
        point: Vector,
        certainty: Certainty,
        converged: bool,
        notes: list[str],
        complete: bool = True,
    ) -> IdentificationResult:
        fits, samples = (self._fits(problem, point)) if complete else ([], _NO_SAMPLES)
        notes = [*notes, *_notes(fits, certainty, self.task)]
        notes += [problem.predictor.lost] if problem.predictor.lost else []
        if failures := problem.predictor.failures:
            reason = max(failures, key=failures.__getitem__)
            notes.append(f"{format_count(sum(failures.values()), 'run')} failed, most because: {reason}")
        plan = self.task.plan
        result = IdentificationResult(
            plan.name,
            certainty.estimates,
            self.task.parameters.start_values(point, 0),
            certainty.correlations,
            certainty.condition,
            fits,
            dict(problem.sigma),
            samples,
            polars.DataFrame(estimator.history),
            (),
            complete,
            converged,
            problem.predictor.runs,
            time.monotonic() - self.began,
            notes,
            None if self.folder is None else self.folder.path,
        )
        if self.folder is not None:
            content = scenario_content(plan.scenario, plan.options) or {}
            estimates = self.task.parameters.options(point)
            self.folder.keep(result, _record(self.task, result), merge_options([content, estimates]))
        return result

    def _fits(self, problem: Problem, point: Vector) -> tuple[list[Fit], polars.DataFrame]:
        (predictions,) = problem.predictor.predict([point])
        fits, frames = list[Fit](), list[polars.DataFrame]()
        for i, one in enumerate(self.task.plan.experiments):
            differences = problem.differences(point, predictions, i)
            if not differences:
                raise RunError(f"the experiment '{one.name}' fails with the estimates: {predictions[i]}.")
            for x in self.task.signals[i]:
                residuals = differences[x.signal]
                fits.append(assess_fit(one.name, one.held_out, x, residuals, self.task.drivers[i]))
                frames.append(
                    polars.DataFrame(
                        {
                            "experiment": [one.name] * len(x.time),
                            "signal": [x.signal] * len(x.time),
                            "time": x.time,
                            "measured": x.values,
                            "predicted": x.values + residuals,
                        }
                    )
                )
        return fits, polars.concat(frames)

    def _design(self, predictor: Predictor) -> IdentificationResult:
        """Rank the experiments at the values of the scenario."""
        plan, parameters = self.task.plan, self.task.parameters
        missing = [s for s in predictor.signals if s not in self.task.sigma]
        if missing or not predictor.signals:
            raise CommandError(
                f"{plan.where} needs the standard deviation of {missing[0] if missing else 'each signal'} to "
                "rank experiments; add it to 'sigma'."
            )
        point = np.clip(parameters.start, 0.01, 0.99)
        step = 1e-3 * np.eye(len(point))
        self.reporter.begin("ranking", 1)
        try:
            found = predictor.predict([point, *(point + s for s in step), *(point - s for s in step)])
        except InterruptedRunsError as error:
            raise RunError("interrupted before any experiment was ranked.") from error
        jacobians = list[np.ndarray]()
        for i, one in enumerate(plan.experiments):
            runs = [at[i] for at in found]
            if failed := [run for run in runs if isinstance(run, str)]:
                raise RunError(f"the experiment '{one.name}' fails: {failed[0]}.")
            columns = list[Vector]()
            for k in range(len(point)):
                pair = [
                    np.concatenate([run[s] / self.task.sigma[s] for s in predictor.signals])  # type: ignore[index]
                    for run in (runs[1 + k], runs[1 + len(point) + k])
                ]
                columns.append((pair[0] - pair[1]) / 2e-3)
            jacobians.append(np.column_stack(columns))
        self.reporter.advance(1)
        self.reporter.finish()
        names = [one.name for one in plan.experiments]
        candidates: list[Candidate] = rank_experiments(parameters, point, names, jacobians)
        count = len(point)
        result = IdentificationResult(
            plan.name,
            (),
            {},
            np.full((count, count), np.nan),
            float("nan"),
            (),
            dict(self.task.sigma),
            _NO_SAMPLES,
            polars.DataFrame(),
            candidates,
            runs=predictor.runs,
            wall_s=time.monotonic() - self.began,
            folder=None if self.folder is None else self.folder.path,
        )
        if self.folder is not None:
            self.folder.keep(result, _record(self.task, result), {})
        return result


_NO_SAMPLES = polars.DataFrame(
    schema={
        "experiment": polars.String,
        "signal": polars.String,
        "time": polars.Float64,
        "measured": polars.Float64,
        "predicted": polars.Float64,
    }
)


def _notes(fits: Sequence[Fit], found: Certainty, task: _Task) -> list[str]:
    """Return what limits the worth of the estimates."""
    notes = list[str]()
    for one in list_poor_fits([x for x in fits if not x.held_out]):
        why = f"related to the input {one.related_input}" if one.related_input else "correlated in time"
        notes.append(
            f"the residuals of {one.signal} in {one.experiment} are {why}: the model lacks something, and "
            "the estimates may be wrong by more than their intervals"
        )
    if fits and all(s in task.sigma for s in {x.signal for x in fits}) and found.deviation > 2.0:
        notes.append(
            f"the residuals are {found.deviation:.3g} times as large as the given standard deviations"
        )
    notes += [
        f"{format_count(one.outliers, 'outlier')} among the samples of {one.signal} in {one.experiment}; "
        "--loss soft_l1 bears them"
        for one in fits
        if one.outliers and one.is_white and task.plan.loss == LINEAR
    ]
    return notes


def _record(task: _Task, result: IdentificationResult) -> dict[str, Any]:
    """Return the content of identify.json: what determines the result, and the result."""
    plan = task.plan
    return {
        "format": "emla-identification",
        "name": plan.name,
        "status": "completed" if result.complete else "unfinished",
        "converged": result.converged,
        "estimates": [asdict(one) for one in result.estimates],
        "correlations": [[None if x != x else x for x in row] for row in result.correlations.tolist()],
        "condition": result.condition,
        "fits": [asdict(one) for one in result.fits],
        "candidates": [asdict(one) for one in result.candidates],
        "sigma": dict(result.sigma),
        "notes": [*task.notes, *result.notes],
        "plan": {
            "scenario": plan.scenario if isinstance(plan.scenario, str) else str(plan.name),
            "vary": {name: str(given) for name, given in plan.vary.items()},
            "loss": plan.loss,
            "starts": plan.starts,
            "evaluations": plan.evaluations,
            "seed": plan.seed,
            "experiments": [
                {
                    "name": one.name,
                    "held_out": one.held_out,
                    "measured": [source.record() for source in one.measured],
                }
                for one in plan.experiments
            ],
        },
        "systems": [one.identity for one in task.preparations],
        "runs": result.runs,
        "wall_s": result.wall_s,
        "version": version("emla-cosim"),
    }
