"""Check that a run goes on: its time, its outputs and states, and the effect of its inputs."""

from collections.abc import Iterator, Mapping, Sequence
from ctypes import byref, c_double
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from fmpy.fmi2 import fmi2LastSuccessfulTime

from emla_cosim.base.arrays import Vector
from emla_cosim.fmu.instance import OK

from ..check import check
from ..host.experiment import Experiment, make_experiment, span
from ..host.fresh_process import in_fresh_process, in_separate_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.instance_runs import OutputTrajectory, outputs, step_instance
from ..host.other_values import Values, others, settable
from ..messages import join_few_names, judge_problems, list_left_out
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, fmi3, own_rule, skipped
from ._steps import walk
from ._time import take_in_time

_SOON = 1e-3
"""Distance of the FMU's time from the end of a step, relative to the step, that counts."""

_STEPS = 5
"""Steps of runs that look at the time, and the steps by which the second one starts later."""


@check(
    "steps.time",
    "The FMU's time is that of the host",
    Clause(
        "2.2.7",
        "Instead, its value is initialized with fmi2SetupExperiment and after initialization set by "
        "fmi2SetTime for ModelExchange and by arguments currentCommunicationPoint and communicationStepSize "
        "of fmi2DoStep for CoSimulation.",
        in_3=fmi3(
            "2.2.6",
            "The initial value of the independent variable is the value of the argument startTime of "
            "fmi3EnterInitializationMode.",
        ),
    ),
    "Begin with the start time that the host sets, and end each step at its communication point plus size.",
    needs=("run.finite",),
    time_factor=2.0,
)
def time(subject: Subject) -> CheckOutcome:
    """Compare the independent variable, and the time that steps say they reach, for two start times."""
    start, step, _ = span(subject)
    independent = [v.name for v in subject.of_causality("independent") if v.unit in (None, "s")]
    late, gaps, known = dict[str, str](), list[str](), bool(independent)
    for begin in (start, start + _STEPS * step):
        try:
            seen = in_separate_process(_times, subject, begin, independent)
            if subject.version == 2 and subject.kinds[0] == "CoSimulation":
                seen.off[_SUCCESSFUL] = in_separate_process(_successful_times, subject, begin)
        except CallError as error:
            if begin == start:
                raise
            if error.call.startswith(("fmi2DoStep", "fmi3DoStep")):
                late["start time"] = f"With the start time {begin:.9g} s, {error}"
            else:  # it may say that the model is not valid there
                gaps.append(f"It does not run from the start time {begin:.9g} s: {error}")
            continue
        for name, off in seen.off.items():
            known |= name not in independent
            if _is_late(name, off, step, name in independent):
                said = f"{name} is {off[-1]:+.9g} s off after steps from the start time {begin:.9g} s."
                late.setdefault(name, said)
        for name, off in seen.first.items():
            if abs(off) > _SOON * step:
                said = (
                    f"{name} is {off:+.9g} s off after an initialization with the start time {begin:.9g} s."
                )
                late.setdefault(name, said)
    if not known and not late:
        said = "No variable is declared as time: only a reference shows whether the start time is used."
        return skipped(said, gaps=(said,))
    return judge_problems((), "The FMU's time is that of the host.", list(late.values()), tuple(gaps))


class _Times(NamedTuple):
    """Distances in s of times from those of the host, by name: after initialization, and after each step."""

    first: dict[str, float]
    off: dict[str, Vector]


_REACHED = "the time that fmi3DoStep says it reached"
_SUCCESSFUL = "fmi2LastSuccessfulTime"


def _is_late(name: str, off: Vector, step: float, must_agree: bool) -> bool:
    """Return whether a time is wrong after all steps. Some may deviate, but not by a constant."""
    if not len(off) or not np.all(np.abs(off) > _SOON * step):
        return False
    return must_agree or bool(np.ptp(off) < _SOON * step)


def _times(subject: Subject, begin: float, independent: Sequence[str]) -> _Times:
    instance = HostedInstance(subject)
    course = make_experiment(subject, _STEPS)
    instance.initialize(course.at(0), begin)
    first = {name: float(value) - begin for name, value in _read(instance, independent)}
    off: dict[str, list[float]] = {}
    times = begin + course.step * np.arange(len(course.times))
    for k in walk(instance, times[:-1], course.step, lambda k: instance.set(course.at(k))):
        found = dict(_read(instance, independent))
        if instance.reached is not None:
            found[_REACHED] = instance.reached
        for name, value in found.items():
            off.setdefault(name, []).append(float(value) - times[k])
    instance.free()
    return _Times(first, {name: np.array(values) for name, values in off.items()})


def _read(instance: HostedInstance, names: Sequence[str]) -> Iterator[tuple[str, float]]:
    yield from zip(names, instance.get(names) if names else (), strict=True)


def _successful_times(subject: Subject, begin: float) -> Vector:
    """Return distances of the time that steps reached; nothing if the FMU does not say it."""
    instance, value, found = HostedInstance(subject), c_double(), list[float]()
    course = make_experiment(subject, _STEPS)
    instance.initialize(course.at(0), begin)
    times = begin + course.step * np.arange(len(course.times))
    for k in walk(instance, times[:-1], course.step):
        status = instance.status("fmi2GetRealStatus", fmi2LastSuccessfulTime, byref(value))
        if status != OK:
            return np.empty(0)
        found.append(value.value - times[k])
    instance.free()
    return np.array(found)


_MOST_OUTPUTS = 300
_MOST_INPUTS = 10
_MOST_STEPS = 250
"""More than others take: what stops does so late."""

_FEWEST = 5
"""Fewest steps before and after a time at which something stops."""

_TAIL = 0.2
"""Least part of a run in which what has stopped stays the same."""

_USUALLY = 0.9
"""Part of the steps in which something changes that changes all the time."""

_LATE = 0.6
"""Part of a run after which inputs change that did not before."""


@check(
    "run.frozen",
    "Outputs, states and effects of inputs do not stop",
    own_rule(
        "run.frozen",
        "What changed in each step goes on to change while that on which it depends changes.",
    ),
    "Look for what fmi2DoStep does once only or up to a certain time: counters, buffers, tables that end.",
    needs=("run.deterministic", "run.finite"),
    time_factor=3.0,
)
def frozen(subject: Subject) -> CheckOutcome:
    """Look for outputs and states that stay the same from some time on, and inputs that lose their effect.

    What stops at another time in a run with other inputs, or at the same value, may be meant to do so.
    """
    if subject.has_clocks:
        return skipped("Its Clocks decide when its variables change.")
    course = make_experiment(subject, _MOST_STEPS)
    if len(course.times) <= 2 * _FEWEST:
        said = f"Runs have {len(course.times) - 1} steps: too few to see whether something stops."
        return skipped(said, gaps=(said,))
    run = _Course(subject, course)
    problems, gaps = [*_stopped(run)], list(run.left_out)
    if not problems:
        problems = [*_without_late_effect(run, gaps)]
    fine = f"{len(run.names)} outputs and states and the effects of inputs go on."
    return judge_problems((), fine, problems, tuple(gaps))


class _Course:
    """Runs of an FMU along the inputs of its experiment, or other ones."""

    def __init__(self, subject: Subject, course: Experiment) -> None:
        variables = subject.description.modelVariables
        self.subject, self.course = subject, course
        self.slopes = {v.derivative.name: v.name for v in variables if v.derivative is not None}
        self.slopes = {x: d for x, d in self.slopes.items() if subject.variables[x].type == "Real"}
        self.inputs = [v.name for v in subject.of_causality("input") if v.variability in (None, "continuous")]
        every = dict.fromkeys([*outputs(subject), *self.slopes, *self.slopes.values()])
        self.names = list(every)[:_MOST_OUTPUTS]
        self.left_out = list_left_out(len(self.names), len(every), "outputs and states were watched.")
        self.plain = self.run(course)

    def run(self, course: Experiment, values: Values | None = None) -> OutputTrajectory:
        """Return the outputs, states and derivatives of a run."""
        return in_separate_process(_trace, self.subject, course, values or {}, self.names)

    @property
    def flipped(self) -> Experiment:
        """The experiment with its inputs in reverse."""
        return replace(self.course, inputs={name: np.flip(v) for name, v in self.course.inputs.items()})

    @property
    def held(self) -> Experiment:
        """The experiment with constant inputs, with which limits of the model are reached least."""
        inputs = {name: np.full_like(v, v[0]) for name, v in self.course.inputs.items()}
        return replace(self.course, inputs=inputs)


def _trace(
    subject: Subject, course: Experiment, values: Mapping[str, object], names: list[str]
) -> OutputTrajectory:
    instance = HostedInstance(subject)
    instance.initialize({**values, **course.at(0)}, float(course.times[0]))
    found = step_instance(instance, course, names=names)
    instance.free()
    return found


def _stopped(run: _Course) -> Iterator[str]:
    """Yield outputs and states that stop."""
    rows = run.plain
    stops = {n: k for i, n in enumerate(rows.names) if (k := _find_stop(rows.values[:, i])) is not None}
    for state, k in stops.items():
        if run.slopes.get(state) in rows.names:
            x, slope = (rows.values[:, rows.names.index(n)] for n in (state, run.slopes[state]))
            if np.mean(np.abs(slope[k:]) * run.course.step > np.spacing(np.abs(x[k]))) >= _USUALLY:
                at = f"from t = {rows.times[k]:.9g} s on"
                yield f"{state} stays the same {at}, although its derivative is not 0."
                return
    candidates = {n: k for n, k in stops.items() if n not in run.slopes.values() and _moves(run, rows, n, k)}
    if not candidates:
        return
    other = _run_otherwise(run)
    if other is None:
        return
    for name, k in candidates.items():
        i = rows.names.index(name)
        same_time = _find_stop(other.values[:, i]) == k and _moves(run, other, name, k)
        if same_time and other.values[-1, i] != rows.values[-1, i]:
            yield (
                f"{name} stays the same from t = {rows.times[k]:.9g} s on in two runs with other inputs or "
                "parameters, although what it depends on changes."
            )


def _find_stop(values: Vector) -> int | None:
    """Return the row from which values stay the same that changed before; None if they do not stop."""
    changes = values[1:] != values[:-1]
    if not changes.any():
        return None
    last = int(np.flatnonzero(changes)[-1]) + 1
    tail = len(values) - 1 - last
    if last < _FEWEST or tail < max(_FEWEST, _TAIL * len(changes)):
        return None
    return last if np.mean(changes[:last]) >= _USUALLY else None


def _moves(run: _Course, rows: OutputTrajectory, name: str, first: int) -> bool:
    """Return whether something that a variable depends on changes after a row."""
    unknowns = [*run.subject.description.outputs, *run.subject.description.derivatives]
    listed = [u.dependencies for u in unknowns if u.variable is not None and u.variable.name == name]
    knowns = {v.name for v in listed[0]} if listed and listed[0] is not None else None
    states = [x for x in run.slopes if x != name and x in rows.names and (knowns is None or x in knowns)]
    columns = [rows.values[first:, rows.names.index(x)] for x in states]
    columns += [
        run.course.inputs[u][first : len(rows.times)] for u in run.inputs if knowns is None or u in knowns
    ]
    return any(np.mean(c[1:] != c[:-1]) >= _USUALLY for c in columns)


def _run_otherwise(run: _Course) -> OutputTrajectory | None:
    """Return a run with other inputs, or other parameters if it has none; None without both."""
    subject = run.subject
    if run.inputs:
        return run.run(run.flipped)
    parameters = others(settable(subject, "parameter"))
    for values in (parameters, *({name: value} for name, value in list(parameters.items())[:_MOST_INPUTS])):
        try:
            found = in_fresh_process(_trace, subject, run.course, values, run.names)
        except CallError:  # the model does not bear these values
            continue
        if len(found.times) == len(run.plain.times) and not found.same(run.plain):
            return found
    return None


def _without_late_effect(run: _Course, gaps: list[str]) -> Iterator[str]:
    """Yield inputs that change nothing after some time in three runs, but did so before."""
    late, tried, lost = int(_LATE * len(run.course.times)), 0, list[str]()
    for name in take_in_time(run.inputs[:_MOST_INPUTS], 0.5 * run.subject.settings.seconds):
        tried += 1
        bases = (run.course, run.flipped, run.held)
        without = all(_has_effect(run, base, name, early=False) is False for base in bases)
        if without and _has_effect(run, run.held, name, early=True):
            lost.append(name)
    gaps += list_left_out(tried, len(run.inputs), "inputs were changed late in a run.")
    if lost:
        yield (
            f"{join_few_names(lost)} changes nothing any more after t = {run.course.times[late]:.9g} s, "
            "although it does before."
        )


def _has_effect(run: _Course, base: Experiment, name: str, early: bool) -> bool | None:
    """Return whether another value of an input, at the start or late, changes something; None if it ends."""
    late = int(_LATE * len(base.times))
    values, usual = base.inputs[name].copy(), run.course.inputs[name]
    part = slice(0, len(values) - late) if early else slice(late, None)
    high = float(usual.max())
    moved = values[part] + 0.5 * (high - float(usual.min()) or 1.0)
    values[part] = np.where(moved > high, 2.0 * high - moved, moved)  # in the range that is known to work
    wanted = run.plain if base is run.course else run.run(base)
    try:
        found = run.run(replace(base, inputs={**base.inputs, name: values}))
    except CallError:
        return True
    rows = min(len(found.times), len(wanted.times))
    if rows <= late + _FEWEST:
        return None
    part = slice(0, len(values) - late) if early else slice(late, rows)
    return found.values[part].tobytes() != wanted.values[part].tobytes()
