"""Points at which states are knowns, or at which a co-simulation has made steps."""

import ctypes
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from emla_cosim.base.arrays import Vector

from ..host.experiment import make_experiment
from ..host.hosted_instance import HostedInstance
from ..host.points import (
    Dependency,
    Point,
    choose,
    list_run_dependencies,
    run_model,
    yield_points_in_initialization,
)
from ..subject import Subject

MOST_STATES = 50
# most updates of discrete states before a point; a model that needs more fails another check
_MOST_UPDATES = 100


def list_states(subject: Subject) -> list[str]:
    """Return the names of the continuous states, in the order of their derivatives in ModelStructure."""
    unknowns = [u.variable for u in subject.description.derivatives if u.variable is not None]
    return [v.derivative.name for v in unknowns if v.derivative is not None]


def list_settable_states(subject: Subject) -> list[str]:
    """Return the states that can be set in initialization mode."""
    variables = subject.variables
    states = [n for n in list_states(subject) if variables[n].type == "Real"]
    return [n for n in states if variables[n].initial == "exact" and variables[n].start is not None]


def yield_points_with_states(subject: Subject, count: int) -> Iterator[Point]:
    """Yield points in initialization mode, with states as further knowns and derivatives as unknowns."""
    states = list_settable_states(subject)[:MOST_STATES]
    initial_unknowns = [(u.variable, u.dependencies) for u in subject.description.initialUnknowns]
    real = [
        Dependency(v.name, None if on is None else frozenset(known.name for known in on))
        for v, on in initial_unknowns
        if v is not None and v.type == "Real" and v.name not in states
    ]
    for point in yield_points_in_initialization(subject, count):
        values = dict(zip(states, map(float, point.instance.get(states)), strict=True))
        knowns = [n for n in point.knowns if n not in states]
        yield replace(point, dependencies=real, knowns=[*knowns, *states], values={**point.values, **values})


def yield_points_in_step_mode(subject: Subject, count: int) -> Iterator[Point]:
    """Yield points after some steps of a co-simulation, with continuous inputs as knowns."""
    course = make_experiment(subject)
    knowns = [v.name for v in subject.of_causality("input") if v.variability in (None, "continuous")]
    dependencies, moved_inputs = choose(list_run_dependencies(subject), knowns)
    instance, last = HostedInstance(subject, kind="CoSimulation"), len(course.times) - 1
    instance.initialize(course.at(0), float(course.times[0]))
    chosen_steps = {*np.linspace(1, last, count).astype(int)}
    for k in range(1, last + 1):
        instance.step(float(course.times[k - 1]), course.step)
        if instance.terminated:
            break
        instance.set(course.at(k))
        if k in chosen_steps:
            inputs = course.at(k)
            values = {name: inputs[name] for name in moved_inputs}
            where = f"after the step to t = {course.times[k]:.9g} s"
            yield Point(instance, dependencies, moved_inputs, values, where)
    instance.free()


@dataclass(frozen=True)
class _ModelPoint(Point):
    """A model in continuous-time mode. `states` are the names of all states, which are knowns, too."""

    states: Sequence[str]

    def evaluate_shifted(self, changes: dict[str, float]) -> Vector:
        """Return the unknowns with some knowns changed by these amounts. Restore the knowns."""
        state_changes = {name: by for name, by in changes.items() if name in self.states}
        self._set_states(state_changes)
        try:
            return super().evaluate_shifted({n: by for n, by in changes.items() if n not in state_changes})
        finally:
            self._set_states({})

    def _set_states(self, changes: dict[str, float]) -> None:
        values = [self.values[name] + changes.get(name, 0.0) for name in self.states]
        with self.instance.calling():
            self.instance.fmu.setContinuousStates((ctypes.c_double * len(values))(*values), len(values))


def yield_points_in_continuous_time(subject: Subject, count: int) -> Iterator[Point]:
    """Yield points of a model in continuous-time mode at several times, with inputs and states as knowns."""
    states = list_states(subject)
    inputs = [v.name for v in subject.of_causality("input") if v.variability in (None, "continuous")]
    inputs = [name for name in inputs if name not in states]
    for instance, input_values, time in run_model(subject, count):
        with instance.calling():
            for _ in range(_MOST_UPDATES):
                if not instance.fmu.newDiscreteStates()[0]:
                    break
            instance.fmu.enterContinuousTimeMode()
            state_values = (ctypes.c_double * len(states))()
            instance.fmu.getContinuousStates(state_values, len(states))
        values = {**{n: input_values[n] for n in inputs}, **dict(zip(states, state_values, strict=True))}
        knowns = [*inputs, *states[:MOST_STATES]]
        where = f"of the model in continuous time at t = {time:.9g} s"
        yield _ModelPoint(instance, list_run_dependencies(subject), knowns, values, where, states)
        with instance.calling():
            instance.fmu.enterEventMode()
