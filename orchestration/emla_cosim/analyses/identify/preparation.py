"""Prepare an identification: its experiments, what was measured in them, and the unknown parameters."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.quantities import read_quantity
from ...base.units import SiUnit
from ...base.wording import format_count
from ...inputs.loaded_input import LoadedInput
from ...run.options import Options
from ...system.names import Names
from ..execution.worker_payload import Preparation
from ..frame.plan_files import load_planned
from ..frame.session import Session
from .parameters import DELAY, Parameters, resolve_parameters
from .plan import IdentificationPlan
from .residuals import MeasuredSignal, read_drivers, read_measurements

_ROWS_PER_SAMPLE = 10
"""Rows of the simulation from one sample to the next if sensors may be late: straight lines between rows are
too coarse for them.
"""


@dataclass(frozen=True)
class IdentificationTask:
    """A prepared identification.

    Attributes:
        plan: the plan.
        preparations: the prepared experiments.
        signals: what was measured in each experiment.
        parameters: the unknown parameters.
        sigma: standard deviations that the plan gives, by signal, in its unit.
        drivers: times and values of the data that drive inputs, by column, for each experiment.
        notes: how the measured data were read.
    """

    plan: IdentificationPlan
    preparations: Sequence[Preparation]
    signals: Sequence[Sequence[MeasuredSignal]]
    parameters: Parameters
    sigma: Mapping[str, float]
    drivers: Sequence[Mapping[str, tuple[Vector, Vector]]]
    notes: Sequence[str]


def prepare_task(plan: IdentificationPlan, session: Session[Any]) -> IdentificationTask:
    """Prepare the experiments of a plan, and read what was measured.

    Raises:
        CommandError: A name does not exist, data are wrong, or the folder of the session has the data.
        RunError: An FMU cannot be built.
    """
    session.check_unread(
        [{data.file: "the measured data" for e in plan.experiments for data in e.measured if data.file}]
    )
    preparations, signals, notes = list[Preparation](), list[list[MeasuredSignal]](), list[str]()
    units, sigma = dict[str, SiUnit | None](), dict[str, Any]()
    drivers = list[dict[str, tuple[Vector, Vector]]]()
    for experiment in plan.experiments:
        label = f"the experiment '{experiment.name}'"
        scenario = load_planned(plan, experiment.options)
        start, stop = scenario.options.start_time or 0.0, scenario.options.stop_time
        if stop is None and experiment.measured:  # inputs are compared with it before signals are known
            end = max(float(LoadedInput.of(source, start).times[-1]) for source in experiment.measured)
            scenario = scenario.with_options({"stop_time": end})
        preparation = session.prepare(scenario)
        names = Names(preparation.system, preparation.interfaces)

        def find_signal(name: str, names: Names = names) -> tuple[str, SiUnit | None]:
            name_match = names.find(name)
            if name_match.variable.type not in ("Real", "Integer"):
                raise CommandError(
                    f"{name} is of the type {name_match.variable.type}; measured signals are numbers."
                )
            units[name_match.full_name] = name_match.unit
            return name_match.full_name, name_match.unit

        measured, remarks = read_measurements(experiment.measured, find_signal, label, start)
        sigma = {find_signal(name)[0]: value for name, value in plan.sigma.items()}
        drivers.append(read_drivers(scenario.options.input, start))
        notes += [note for note in remarks if note not in notes]
        may_be_late = any(DELAY in name for name in plan.vary)
        options = replace(preparation.options, require=[])
        # it was set only to prepare; the end of the measurement decides
        if stop is None and options.stop_time == scenario.options.stop_time:
            options = replace(options, stop_time=None)
        options = replace(options, **_choose_times(options, measured, may_be_late))
        preparations.append(replace(preparation, options=options))
        inside, left_out = _limit_samples(measured, options, label)
        signals.append(inside)
        notes += left_out
    parameters = resolve_parameters(plan, preparations, units)
    deviations = _read_sigma(sigma, units)
    if not plan.design:
        _check_samples(plan, signals, parameters, deviations)
    for note in notes:
        session.progress.note(f"Note: {note}")
    return IdentificationTask(
        plan, _extend_runs(preparations, parameters), signals, parameters, deviations, drivers, notes
    )


def _limit_samples(
    measured: Sequence[MeasuredSignal], options: Options, label: str
) -> tuple[list[MeasuredSignal], list[str]]:
    """Return the samples during a run, and notes on those outside of it.

    Raises:
        CommandError: A signal has fewer than two samples during the run.
    """
    start, stop = options.start_time or 0.0, options.stop_time or 0.0
    inside, notes = [x.between(start, stop) for x in measured], list[str]()
    for signal, part in zip(measured, inside, strict=True):
        if len(part.time) < 2:
            raise CommandError(
                f"{signal.label} has fewer than two samples between {start:g} s and {stop:g} s, the times "
                f"of {label}."
            )
        if (dropped := len(signal.time) - len(part.time)) > 0:
            notes.append(f"{format_count(dropped, 'sample')} of {signal.label} outside of the run: not used.")
    return inside, notes


def _extend_runs(preparations: Sequence[Preparation], parameters: Parameters) -> list[Preparation]:
    """Return preparations whose runs are so long that a sensor ahead of time can be predicted to the end."""
    ahead = max((-p.low for p in parameters.items if p.sensor and p.sensor[0] == DELAY), default=0.0)

    def extend(options: Options) -> Options:
        if ahead <= 0.0 or options.stop_time is None:
            return options
        step = options.step_size or ahead
        return replace(options, stop_time=options.stop_time + step * math.ceil(ahead / step - 1e-9))

    return [replace(preparation, options=extend(preparation.options)) for preparation in preparations]


def _choose_times(
    options: Options, measured: Sequence[MeasuredSignal], may_be_late: bool
) -> dict[str, float]:
    """Return stop time and output interval that suit the measurement, where the user gave none.

    Samples of a sensor that may be late are between rows, which are nearer to each other then.
    """
    if not measured:
        return {}
    changed = dict[str, float]()
    last = max(float(signal.time[-1]) for signal in measured)
    start, step = options.start_time or 0.0, options.step_size
    if options.stop_time is None or options.stop_time > last:
        # a whole number of steps that reaches the last sample; 1e-9 absorbs the rounding of times in files
        changed["stop_time"] = last if not step else start + step * math.ceil((last - start) / step - 1e-9)
    if options.output_interval is None and step:
        sample_time = min(float(np.median(np.diff(signal.time))) for signal in measured)
        rows = _ROWS_PER_SAMPLE if may_be_late else 1
        changed["output_interval"] = step * max(round(min(sample_time, 1e-3) / rows / step), 1)
    return changed


def _read_sigma(deviations: Mapping[str, Any], units: Mapping[str, SiUnit | None]) -> dict[str, float]:
    """Return the standard deviations in the units of their signals; raise CommandError for invalid ones."""
    sigma = {}
    for signal, text in deviations.items():
        label = f"the standard deviation of {signal}"
        value = read_quantity(str(text), label, units[signal])
        if not 0.0 < value < float("inf"):
            raise CommandError(f"{label} is {text}; it must be positive and finite.", signal=signal)
        sigma[signal] = value
    return sigma


def _check_samples(
    plan: IdentificationPlan,
    signals: Sequence[Sequence[MeasuredSignal]],
    parameters: Parameters,
    sigma: Mapping[str, float],
) -> None:
    """Raise CommandError if there are too few samples, or a standard deviation is of no measured signal."""
    fitted = [
        x for e, measured in zip(plan.experiments, signals, strict=True) if not e.held_out for x in measured
    ]
    samples = sum(len(signal.time) for signal in fitted)
    if samples <= len(parameters.items):
        raise CommandError(
            f"{plan.where} has {samples} samples for {len(parameters.items)} parameters; add measured "
            "data, or vary fewer parameters."
        )
    measured = {signal.signal for measured_signals in signals for signal in measured_signals}
    if idle := [signal for signal in sigma if signal not in measured]:
        raise CommandError(
            f"{idle[0]} in 'sigma' of {plan.where} is not measured; remove it.", signal=idle[0]
        )
