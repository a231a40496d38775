"""Points at which an FMU can be evaluated repeatedly, and the dependencies that it declares there."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from fmpy.model_description import Unknown

from emla_cosim.base.arrays import Vector

from ..messages import list_left_out
from ..subject import Subject
from ..subprocess_run import is_single_instance
from .experiment import make_experiment, parse_number, read_limits
from .hosted_instance import HostedInstance

T = TypeVar("T")

_STEPS = 20
"""Steps of the run for Model Exchange."""


_MOST_PAIRS = 40_000
"""Most pairs of an unknown and a known at a point, such as 200 of each."""

_FEWEST_KNOWNS = 20


@dataclass(frozen=True)
class Dependency:
    """An unknown and the names of its dependencies; None if they are not declared."""

    unknown: str
    on: frozenset[str] | None

    def excludes(self, name: str) -> bool:
        """Return whether the declaration excludes a dependency on a variable."""
        return self.on is not None and name not in self.on


REAL = ("Real",)
ALL_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")


def list_initial_dependencies(subject: Subject, types: Sequence[str] = REAL) -> list[Dependency]:
    """Return the dependencies of outputs of some types in initialization mode."""
    dependencies = _convert_unknowns(subject.description.initialUnknowns, types)
    return [d for d in dependencies if subject.variables[d.unknown].causality == "output"]


def list_run_dependencies(subject: Subject, types: Sequence[str] = REAL) -> list[Dependency]:
    """Return the dependencies of outputs and state derivatives in event and continuous-time mode."""
    return _convert_unknowns([*subject.description.outputs, *subject.description.derivatives], types)


def _convert_unknowns(unknowns: Iterable[Unknown], types: Sequence[str]) -> list[Dependency]:
    """Return the dependencies of those unknowns that exist and have one of the types."""
    return [
        Dependency(
            u.variable.name, None if u.dependencies is None else frozenset(v.name for v in u.dependencies)
        )
        for u in unknowns
        if u.variable is not None and u.variable.type in types
    ]


@dataclass(frozen=True)
class Point:
    """An instance in a mode that allows setting knowns and getting unknowns in any order.

    `values` are those of the knowns. Methods that change a known restore it.
    """

    instance: HostedInstance
    dependencies: list[Dependency]
    knowns: list[str]
    values: dict[str, float]
    where: str

    @property
    def unknowns(self) -> list[str]:
        """Names of the unknowns."""
        return [d.unknown for d in self.dependencies]

    def scale(self, known: str) -> float:
        """Return the typical magnitude of a known, from which step sizes derive."""
        variable = self.instance.subject.variables[known]
        nominal = abs(parse_number(variable.nominal, 0.0))
        low, high = read_limits(variable)
        width = 0.1 * (high - low)
        return max(nominal, abs(self.values[known]), width if math.isfinite(width) else 0.0) or 1.0

    def evaluate_shifted(self, changes: dict[str, float]) -> Vector:
        """Return the unknowns with some knowns changed by these amounts. Restore the knowns."""
        old = {name: self.values[name] for name in changes}
        self.instance.set({name: old[name] + by for name, by in changes.items()})
        try:
            return np.array(self.instance.get(self.unknowns), dtype=float)
        finally:
            self.instance.set(old)

    def directional(self, knowns: Sequence[str], seed: Sequence[float]) -> Vector:
        """Return the result of fmi2GetDirectionalDerivative for the unknowns."""
        return np.array(self.instance.directional(self.unknowns, knowns, seed))


def choose(dependencies: list[Dependency], knowns: list[str]) -> tuple[list[Dependency], list[str]]:
    """Return all unknowns and knowns; where these are too many, some that lie evenly among all.

    Unknowns that are declared to depend on the knowns come first.
    """
    if len(dependencies) * len(knowns) <= _MOST_PAIRS:
        return dependencies, knowns
    knowns = _choose_spread(knowns, max(_FEWEST_KNOWNS, _MOST_PAIRS // len(dependencies)))
    if len(dependencies) > (most := _MOST_PAIRS // len(knowns)):
        moved_knowns = set(knowns)
        related = [d for d in dependencies if d.on is not None and not moved_knowns.isdisjoint(d.on)]
        related = related[: most // 2]
        unknowns = {d.unknown for d in (*related, *_choose_spread(dependencies, most - len(related)))}
        dependencies = [d for d in dependencies if d.unknown in unknowns]
    return dependencies, knowns


def _choose_spread(items: list[T], most: int) -> list[T]:
    return [items[k] for k in np.unique(np.linspace(0, len(items) - 1, min(most, len(items))).astype(int))]


def list_unexamined_pairs(subject: Subject) -> tuple[str, ...]:
    """Return a gap for *Not examined* if points have not all inputs and outputs."""
    knowns = [v.name for v in subject.of_causality("input")]
    dependencies = list_initial_dependencies(subject)
    compared, moved_inputs = choose(dependencies, knowns)
    return (
        *list_left_out(len(moved_inputs), len(knowns), "inputs were moved alone."),
        *list_left_out(len(compared), len(dependencies), "outputs were examined with them."),
    )


def yield_points_in_initialization(subject: Subject, count: int) -> Iterator[Point]:
    """Yield points in initialization mode, with the inputs at several times of the experiment."""
    course = make_experiment(subject)
    knowns = [v.name for v in subject.of_causality("input")]
    dependencies, moved_inputs = choose(list_initial_dependencies(subject), knowns)
    # each point has an instance of its own
    indices = np.linspace(0, len(course.times) - 1, 1 if is_single_instance(subject) else count)
    for k in np.unique(indices.astype(int)):
        instance = HostedInstance(subject)
        first, values = course.at(0), course.at(int(k))
        instance.begin_initialization(float(course.times[0]), set_values=partial(instance.set, first))
        instance.set(values)
        yield Point(instance, dependencies, moved_inputs, values, f"in initialization mode (inputs {k})")
        instance.free()


def yield_points_in_event_mode(subject: Subject, count: int) -> Iterator[Point]:
    """Yield points of a model in event mode at several times of the experiment."""
    knowns = [v.name for v in subject.of_causality("input") if v.variability in (None, "continuous")]
    dependencies, moved_inputs = choose(list_run_dependencies(subject), knowns)
    for instance, inputs, time in run_model(subject, count):
        values = {n: inputs[n] for n in moved_inputs}
        yield Point(instance, dependencies, moved_inputs, values, f"of the model at t = {time:.9g} s")


def run_model(subject: Subject, count: int) -> Iterator[tuple[HostedInstance, dict[str, float], float]]:
    """Yield a model in event mode at several times of the experiment, its inputs, and the time in s."""
    course = make_experiment(subject, _STEPS)
    instance = HostedInstance(subject, kind="ModelExchange")
    instance.initialize(course.at(0), float(course.times[0]))
    indices = set(np.linspace(0, len(course.times) - 1, count).astype(int))
    for k, time in enumerate(course.times):
        instance.set(course.at(k))
        if k in indices:
            yield instance, course.at(k), float(time)
        if instance.terminated or k == len(course.times) - 1:
            return
        instance.step(float(time), course.step)
