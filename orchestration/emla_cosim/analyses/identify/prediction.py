"""Run experiments with values of the parameters on workers, and predict what was measured."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...run.half_step import HalfStep
from ...run.remarks import has_lost_values_remark
from ..frame.session import Job, Runs
from ..variants.factors import START
from ..variants.measures import DONE, Measures
from .parameters import Parameters
from .residuals import MeasuredSignal

_BYTES_PER_VALUE = 8
"""Size of a value."""

_MAX_CACHED = 64
"""Most predictions of an experiment that are kept for repeated values."""

_MAX_BYTES = 2**28
"""Most bytes of predictions that are kept, and that one batch of runs returns."""

_MIN_BATCH = 8
"""Fewest points of a batch, which keep the workers busy."""

Prediction = Mapping[str, Vector] | str
"""Signals of a run and `time`, or why it failed."""

Task = tuple[int, tuple[float, ...], bool]
"""Position of an experiment, the values of the parameters that decide its result, and whether the run has
half the step.
"""


class InterruptedRunsError(Exception):
    """The user interrupted the runs."""


@dataclass
class Predictor:
    """Predicts experiments.

    Attributes:
        runs: runs of the experiments.
        parameters: the parameters.
        experiments: measured signals of each experiment; empty for one that is only planned.
        signals: all signals to record.
        rows: rows of a table, of the experiment that has most.
        failures: why runs failed, with their numbers.
        start_value_remark: remark on start values that an FMU did not take; empty if it took all.
        half_steps: how experiments were run with half the step, by position.
    """

    runs: Runs
    parameters: Parameters
    experiments: Sequence[Sequence[MeasuredSignal]]
    signals: Sequence[str]
    rows: int
    failures: Counter[str] = field(default_factory=Counter)
    start_value_remark: str = ""
    half_steps: dict[int, HalfStep] = field(default_factory=dict)
    _cache: dict[Task, Prediction] = field(default_factory=dict)

    @property
    def _bytes_per_run(self) -> int:
        return _BYTES_PER_VALUE * (1 + len(self.signals)) * max(self.rows, 1)

    def batches(self, points: Sequence[Vector], experiments: Sequence[int]) -> list[Sequence[Vector]]:
        """Return points in batches whose predictions fit into memory together."""
        most = max(_MAX_BYTES // (self._bytes_per_run * max(len(experiments), 1)), _MIN_BATCH)
        return [points[i : i + most] for i in range(0, len(points), most)]

    def predict(
        self, points: Sequence[Vector], experiments: Sequence[int] | None = None, is_halved: bool = False
    ) -> list[dict[int, Prediction]]:
        """Return the prediction of experiments at each point.

        Args:
            points: fractions of the parameters, each of shape (p,).
            experiments: positions of the experiments. Default: all.
            is_halved: whether to run with half the step.

        Raises:
            InterruptedRunsError: The user interrupted.
            RunError: The workers are lost.
        """
        selected = range(len(self.experiments)) if experiments is None else experiments
        keys = [self.parameters.key(point) for point in points]
        tasks = {
            (i, key, is_halved): point for i in selected for key, point in zip(keys, points, strict=True)
        }
        missing = {task: point for task, point in tasks.items() if task not in self._cache}
        predictions = {**self._cache, **self._run(missing)}
        if missing:
            # differences repeat the point that the search has just evaluated
            most = min(_MAX_CACHED * len(self.experiments), max(_MAX_BYTES // self._bytes_per_run, 1))
            self._cache = dict(list(predictions.items())[-most:])
        return [{i: predictions[i, key, is_halved] for i in selected} for key in keys]

    def _run(self, missing: Mapping[Task, Vector]) -> dict[Task, Prediction]:
        """Return a prediction for each task; count failures, and note half steps and lost start values."""
        predictions, tasks = dict[Task, Prediction](), dict[Task, Job]()
        for task, point in missing.items():
            experiment, _, is_halved = task
            try:
                options = {START: self.parameters.start_values(point, experiment)}
                tasks[task] = Job(options, experiment, is_halved)
            except CommandError as error:  # entries of a data sheet that contradict each other
                predictions[task] = str(error)
        measures = Measures(signals=list(self.signals), read=list(self.signals))
        outcomes = self.runs.run(list(tasks.values()), measures, bytes_each=self._bytes_per_run)
        if not outcomes.complete:
            raise InterruptedRunsError
        for position, task in enumerate(tasks):
            outcome, series = outcomes.by_job[position], outcomes.series.get(position)
            if has_lost_values_remark(outcome.problem):
                self.start_value_remark = self.start_value_remark or str(outcome.problem)
            if outcome.half_step is not None:
                self.half_steps[task[0]] = outcome.half_step
            if outcome.status != DONE or series is None:
                predictions[task] = (outcome.problem or outcome.status).splitlines()[0]
            else:
                data = {column.name: np.asarray(column, dtype=float) for column in series}
                predictions[task] = _find_defect(data, self.experiments[task[0]]) or data
        self.failures.update(
            x for (*_, is_halved), x in predictions.items() if isinstance(x, str) and not is_halved
        )
        return predictions


def _find_defect(data: Mapping[str, Vector], measured: Sequence[MeasuredSignal]) -> str | None:
    """Return why signals of a run cannot be compared; None if they can."""
    last = data["time"][-1]
    # an FMU can end a run early without an error; samples after that have no prediction
    end = max((signal.time[-1] for signal in measured), default=last)
    step = last - data["time"][-2] if len(data["time"]) > 1 else 0.0
    if last < end - 1.5 * step:
        return f"it ended at {last:.6g} s"
    is_finite = all(np.isfinite(values).all() for values in data.values())
    return None if is_finite else "it has values that are not finite"


def predict_samples(
    parameters: Parameters, point: Vector, data: Mapping[str, Vector], measured: MeasuredSignal
) -> Vector:
    """Return what a sensor would have measured at the times of the samples, shape (n,)."""
    offset, gain, delay = parameters.sensor(point, measured.signal)
    # sensors need no run of their own: one trajectory serves all their values
    return offset + gain * np.interp(measured.time - delay, data["time"], data[measured.signal])
