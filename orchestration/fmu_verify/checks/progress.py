"""Check that a run continues: its time, its outputs and states, and the effect of its inputs."""

from collections.abc import Iterator, Mapping, Sequence
from ctypes import byref, c_double
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from fmpy.fmi2 import fmi2LastSuccessfulTime

from emla_cosim.base.arrays import Vector
from emla_cosim.fmu.instance import OK

from ..check import CheckOutcome, check, skipped, unjudged
from ..host.experiment import (
    Experiment,
    OutputTrajectory,
    list_outputs,
    make_experiment,
    read_span,
    step_instance,
    step_through,
    take_in_time,
)
from ..host.hosted_instance import CallError, HostedInstance
from ..host.other_values import Values, list_other_values, list_settable
from ..messages import join_few_names, judge_problems, list_left_out
from ..subject import Subject
from ..subprocess_run import in_fresh_process, in_separate_process

_MAX_TIME_ERROR = 1e-3
"""Distance of the FMU's time from the end of a step, relative to the step, that counts."""

_STEPS = 5
"""Steps of runs that look at the time, and the steps by which the second one starts later."""


@check("steps.time", needs=("run.finite",), time_factor=2.0)
def time(subject: Subject) -> CheckOutcome:
    """Compare the independent variable, and the time that steps say they reach, for two start times."""
    start, step, _ = read_span(subject)
    independent = [v.name for v in subject.of_causality("independent") if v.unit in (None, "s")]
    messages, gaps, has_time = dict[str, str](), list[str](), bool(independent)
    for start_time in (start, start + _STEPS * step):
        try:
            times = in_separate_process(_measure_times, subject, start_time, independent)
            if subject.version == 2 and subject.kinds[0] == "CoSimulation":
                times.deviations[_SUCCESSFUL] = in_separate_process(_measure_reached, subject, start_time)
        except CallError as error:
            if start_time == start:
                raise
            if error.call.startswith(("fmi2DoStep", "fmi3DoStep")):
                messages["start time"] = f"With the start time {start_time:.9g} s, {error}"
            else:  # it may say that the model is not valid there
                gaps.append(f"It does not run from the start time {start_time:.9g} s: {error}")
            continue
        for name, deviations in times.deviations.items():
            has_time |= name not in independent
            if _is_wrong_time(name, deviations, step, name in independent):
                message = f"{name} is {deviations[-1]:+.9g} s off after steps from"
                message = f"{message} the start time {start_time:.9g} s."
                messages.setdefault(name, message)
        for name, deviation in times.first.items():
            if abs(deviation) > _MAX_TIME_ERROR * step:
                message = f"{name} is {deviation:+.9g} s off after an initialization with"
                message = f"{message} the start time {start_time:.9g} s."
                messages.setdefault(name, message)
    if not has_time and not messages:
        message = "No variable is declared as time: only a reference shows whether the start time is used."
        return unjudged(message)
    return judge_problems((), "The FMU's time is that of the host.", list(messages.values()), tuple(gaps))


class _Times(NamedTuple):
    """Distances in s of times from those of the host, by name: after initialization, and after each step."""

    first: dict[str, float]
    deviations: dict[str, Vector]


_REACHED = "the time that fmi3DoStep says it reached"
_SUCCESSFUL = "fmi2LastSuccessfulTime"


def _is_wrong_time(name: str, deviations: Vector, step: float, must_agree: bool) -> bool:
    """Return whether a time is wrong after all steps. Some may deviate, but not by a constant."""
    if not len(deviations) or not np.all(np.abs(deviations) > _MAX_TIME_ERROR * step):
        return False
    return must_agree or bool(np.ptp(deviations) < _MAX_TIME_ERROR * step)


def _measure_times(subject: Subject, start_time: float, independent: Sequence[str]) -> _Times:
    """Return how far times of the FMU are from those of the host in a run from a start time."""
    instance = HostedInstance(subject)
    course = make_experiment(subject, _STEPS)
    instance.initialize(course.at(0), start_time)
    first = {name: float(value) - start_time for name, value in _read_values(instance, independent)}
    deviations: dict[str, list[float]] = {}
    times = start_time + course.step * np.arange(len(course.times))
    for k in step_through(instance, times[:-1], course.step, lambda k: instance.set(course.at(k))):
        reached = dict(_read_values(instance, independent))
        if instance.reached is not None:
            reached[_REACHED] = instance.reached
        for name, value in reached.items():
            deviations.setdefault(name, []).append(float(value) - times[k])
    instance.free()
    return _Times(first, {name: np.array(values) for name, values in deviations.items()})


def _read_values(instance: HostedInstance, names: Sequence[str]) -> Iterator[tuple[str, float]]:
    yield from zip(names, instance.get(names) if names else (), strict=True)


def _measure_reached(subject: Subject, start_time: float) -> Vector:
    """Return how far times that the FMU reports after steps are off, in s; none if it reports none."""
    instance, value, distances = HostedInstance(subject), c_double(), list[float]()
    course = make_experiment(subject, _STEPS)
    instance.initialize(course.at(0), start_time)
    times = start_time + course.step * np.arange(len(course.times))
    for k in step_through(instance, times[:-1], course.step):
        status = instance.status("fmi2GetRealStatus", fmi2LastSuccessfulTime, byref(value))
        if status != OK:
            return np.empty(0)
        distances.append(value.value - times[k])
    instance.free()
    return np.array(distances)


_MOST_OUTPUTS = 300
_MOST_INPUTS = 10
# more than others take: what stops does so late
_MAX_STEPS = 250

_MIN_STEPS = 5
"""Fewest steps before and after a time at which something stops."""

_MIN_CONSTANT_FRACTION = 0.2
"""Least part of a run in which what has stopped stays the same."""

_MIN_CHANGING_FRACTION = 0.9
"""Part of the steps in which something changes that changes all the time."""

_LATE_FRACTION = 0.6
"""Part of a run after which inputs change that did not before."""


@check("run.frozen", needs=("run.deterministic", "run.finite"), time_factor=3.0)
def frozen(subject: Subject) -> CheckOutcome:
    """Look for outputs and states that stay the same from some time on, and inputs that lose their effect.

    What stops at another time in a run with other inputs, or at the same value, may be meant to do so.
    """
    if subject.has_clocks:
        return skipped("Its Clocks decide when its variables change.")
    course = make_experiment(subject, _MAX_STEPS)
    if len(course.times) <= 2 * _MIN_STEPS:
        return unjudged(f"Runs have {len(course.times) - 1} steps: too few to see whether something stops.")
    run = _RunSeries(subject, course)
    problems, gaps = [*_describe_stopped(run)], list(run.left_out)
    if not problems:
        problems = [*_describe_inputs_without_late_effect(run, gaps)]
    fine = f"{len(run.names)} outputs and states and the effects of inputs continue."
    return judge_problems((), fine, problems, tuple(gaps))


class _RunSeries:
    """Runs of an FMU along the inputs of its experiment, or other ones."""

    def __init__(self, subject: Subject, course: Experiment) -> None:
        variables = subject.description.modelVariables
        self.subject, self.course = subject, course
        pairs = [(v.derivative.name, v.name) for v in variables if v.derivative is not None]
        self.derivative_of_state = {x: d for x, d in pairs if subject.variables[x].type == "Real"}
        self.inputs = [v.name for v in subject.of_causality("input") if v.variability in (None, "continuous")]
        states = self.derivative_of_state
        all_names = dict.fromkeys([*list_outputs(subject), *states, *states.values()])
        self.names = list(all_names)[:_MOST_OUTPUTS]
        self.left_out = list_left_out(len(self.names), len(all_names), "outputs and states were watched.")
        inputs = course.inputs
        self._courses = {
            "plain": course,
            "reversed": replace(course, inputs={name: np.flip(v) for name, v in inputs.items()}),
            # with which limits of the model are reached least
            "constant": replace(course, inputs={name: np.full_like(v, v[0]) for name, v in inputs.items()}),
        }
        self._baselines = dict[str, OutputTrajectory]()
        self.plain = self.baseline("plain")

    def run(self, course: Experiment, values: Values | None = None) -> OutputTrajectory:
        """Return the outputs, states and derivatives of a run."""
        return in_separate_process(_record_run, self.subject, course, values or {}, self.names)

    def baseline(self, kind: str) -> OutputTrajectory:
        """Return the run along the inputs of the experiment, or along reversed or constant ones."""
        if kind not in self._baselines:  # each input is compared with the same ones
            self._baselines[kind] = self.run(self._courses[kind])
        return self._baselines[kind]

    def run_with(self, kind: str, name: str, values: Vector) -> OutputTrajectory:
        """Return the run along the inputs of a baseline, with other values of one of them."""
        course = self._courses[kind]
        return self.run(replace(course, inputs={**course.inputs, name: values}))

    def inputs_of(self, kind: str, name: str) -> Vector:
        """Return the values of an input in a baseline."""
        return self._courses[kind].inputs[name]


def _record_run(
    subject: Subject, course: Experiment, values: Mapping[str, object], names: list[str]
) -> OutputTrajectory:
    instance = HostedInstance(subject)
    instance.initialize({**values, **course.at(0)}, float(course.times[0]))
    trajectory = step_instance(instance, course, names=names)
    instance.free()
    return trajectory


def _describe_stopped(run: _RunSeries) -> Iterator[str]:
    """Yield messages on states that stop although their derivatives are not 0, and on outputs that stop."""
    rows = run.plain
    stops = {n: k for i, n in enumerate(rows.names) if (k := _find_stop(rows.values[:, i])) is not None}
    for state, k in stops.items():
        if run.derivative_of_state.get(state) in rows.names:
            x, slope = (rows.values[:, rows.names.index(n)] for n in (state, run.derivative_of_state[state]))
            is_moving = np.abs(slope[k:]) * run.course.step > np.spacing(np.abs(x[k]))  # not rounded
            if np.mean(is_moving) >= _MIN_CHANGING_FRACTION:
                at = f"from t = {rows.times[k]:.9g} s on"
                yield f"{state} stays the same {at}, although its derivative is not 0."
                return
    candidates = {
        n: k
        for n, k in stops.items()
        if n not in run.derivative_of_state.values() and _has_moving_dependency(run, rows, n, k)
    }
    if not candidates:
        return
    other_run = _run_with_other_values(run)
    if other_run is None:
        return
    for name, k in candidates.items():
        i = rows.names.index(name)
        stops_too = _find_stop(other_run.values[:, i]) == k
        is_driven = stops_too and _has_moving_dependency(run, other_run, name, k)
        if is_driven and other_run.values[-1, i] != rows.values[-1, i]:
            message = f"{name} stays the same from t = {rows.times[k]:.9g} s on in two runs with other inputs"
            yield f"{message} or parameters, although what it depends on changes."


def _find_stop(values: Vector) -> int | None:
    """Return the row from which values stay the same that changed before; None if they do not stop."""
    changes = values[1:] != values[:-1]
    if not changes.any():
        return None
    last = int(np.flatnonzero(changes)[-1]) + 1
    tail = len(values) - 1 - last
    if last < _MIN_STEPS or tail < max(_MIN_STEPS, _MIN_CONSTANT_FRACTION * len(changes)):
        return None
    return last if np.mean(changes[:last]) >= _MIN_CHANGING_FRACTION else None


def _has_moving_dependency(run: _RunSeries, rows: OutputTrajectory, name: str, first: int) -> bool:
    """Return whether something that a variable depends on changes after a row."""
    unknowns = [*run.subject.description.outputs, *run.subject.description.derivatives]
    listed = [u.dependencies for u in unknowns if u.variable is not None and u.variable.name == name]
    knowns = {v.name for v in listed[0]} if listed and listed[0] is not None else None
    inputs = [u for u in run.inputs if knowns is None or u in knowns]
    states = [x for x in run.derivative_of_state if knowns is None or x in knowns]
    columns = [rows.values[first:, rows.names.index(x)] for x in states if x != name and x in rows.names]
    columns += [run.course.inputs[u][first : len(rows.times)] for u in inputs]
    return any(np.mean(c[1:] != c[:-1]) >= _MIN_CHANGING_FRACTION for c in columns)


def _run_with_other_values(run: _RunSeries) -> OutputTrajectory | None:
    """Return a run with other inputs, or other parameters if it has none; None without both."""
    subject = run.subject
    if run.inputs:
        return run.baseline("reversed")
    parameters = list_other_values(list_settable(subject, "parameter"))
    for values in (parameters, *({name: value} for name, value in list(parameters.items())[:_MOST_INPUTS])):
        try:
            trajectory = in_fresh_process(_record_run, subject, run.course, values, run.names)
        except CallError:  # the model does not accept these values
            continue
        if len(trajectory.times) == len(run.plain.times) and not trajectory.has_same_values(run.plain):
            return trajectory
    return None


def _describe_inputs_without_late_effect(run: _RunSeries, gaps: list[str]) -> Iterator[str]:
    """Yield a message on inputs that change nothing after some time in three runs, but did so before.

    `gaps` gets how many inputs were left out.
    """
    late_row, examined_count, names = int(_LATE_FRACTION * len(run.course.times)), 0, list[str]()
    for name in take_in_time(run.inputs[:_MOST_INPUTS], 0.5 * run.subject.settings.seconds):
        examined_count += 1
        kinds = ("plain", "reversed", "constant")
        has_no_effect = all(_has_effect(run, kind, name, is_early=False) is False for kind in kinds)
        if has_no_effect and _has_effect(run, "constant", name, is_early=True):
            names.append(name)
    gaps += list_left_out(examined_count, len(run.inputs), "inputs were changed late in a run.")
    if names:
        at = f"t = {run.course.times[late_row]:.9g} s"
        yield f"{join_few_names(names)} changes nothing any more after {at}, although it does before."


def _has_effect(run: _RunSeries, kind: str, name: str, is_early: bool) -> bool | None:
    """Return whether another value of an input, at the start or late, changes something, or is refused.

    None if the run ends too early to show it.
    """
    late_row = int(_LATE_FRACTION * len(run.course.times))
    values, usual_values = run.inputs_of(kind, name).copy(), run.course.inputs[name]
    part = slice(0, len(values) - late_row) if is_early else slice(late_row, None)
    high = float(usual_values.max())
    shifted = values[part] + 0.5 * (high - float(usual_values.min()) or 1.0)
    # in the range that is known to work
    values[part] = np.where(shifted > high, 2.0 * high - shifted, shifted)
    expected = run.baseline(kind)
    try:
        actual = run.run_with(kind, name, values)
    except CallError:
        return True
    rows = min(len(actual.times), len(expected.times))
    if rows <= late_row + _MIN_STEPS:
        return None
    part = slice(0, len(values) - late_row) if is_early else slice(late_row, rows)
    return actual.values[part].tobytes() != expected.values[part].tobytes()
