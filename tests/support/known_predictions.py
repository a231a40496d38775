"""Predictions from functions, in place of runs of FMUs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from emla_cosim.analyses.identify.certainty import Estimate
from emla_cosim.analyses.identify.parameters import Parameter, Parameters
from emla_cosim.analyses.identify.problem import Problem
from emla_cosim.analyses.identify.residuals import MeasuredSignal

Model = Callable[[Mapping[str, float]], Sequence[Mapping[str, np.ndarray] | str]]


@dataclass
class KnownPredictor:
    """A predictor whose predictions are known: those of `model` for the values of the parameters."""

    parameters: Parameters
    experiments: Sequence[Sequence[MeasuredSignal]]
    model: Model
    failures: dict[str, int] = field(default_factory=dict)
    runs: int = 0

    def batches(self, points: Sequence[np.ndarray], experiments: Sequence[int]) -> list[Sequence[np.ndarray]]:
        return [points[:3], points[3:]]

    def predict(
        self, points: Sequence[np.ndarray], experiments: Sequence[int] | None = None
    ) -> list[dict[int, Any]]:
        requested = range(len(self.experiments)) if experiments is None else experiments
        modelled = [self.model(self.parameters.values(point)) for point in points]
        predictions = [{i: of[i] for i in requested} for of in modelled]
        self.runs += len(points)
        for data in (data for prediction in predictions for data in prediction.values()):
            if isinstance(data, str):
                self.failures[data] = self.failures.get(data, 0) + 1
        return predictions


def parameter(name: str, low: float, high: float, start: float | None = None) -> Parameter:
    begin = 0.5 * (low + high) if start is None else start
    return Parameter(name, low, high, begin, "", factor=object())  # type: ignore[arg-type]


def measured(time: np.ndarray, values: np.ndarray, signal: str = "y") -> MeasuredSignal:
    return MeasuredSignal(signal, time, values, "", f"the column '{signal}'")


def contain(estimates: Sequence[Estimate], values: Sequence[float]) -> list[bool]:
    """Whether the interval of each estimate contains its true value."""
    pairs = zip(estimates, values, strict=True)
    return [
        estimate.interval is not None and estimate.interval[0] <= x <= estimate.interval[1]
        for estimate, x in pairs
    ]


def problem(
    parameters: Sequence[Parameter],
    experiments: Sequence[Sequence[MeasuredSignal]],
    model: Model,
    sigma: float = 1.0,
) -> Problem:
    """A problem of all experiments."""
    predictor: Any = KnownPredictor(Parameters(parameters), experiments, model)
    signals = {measurement.signal: sigma for of in experiments for measurement in of}
    return Problem(predictor, range(len(experiments)), signals)
