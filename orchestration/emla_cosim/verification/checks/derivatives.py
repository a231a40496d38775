"""Derivatives that an FMU gives, beside differences of its values."""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ...base.arrays import Vector
from ..check import check
from ..host.experiment import make_experiment
from ..host.fresh_process import EndedError, in_fresh_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.points import Point, in_event_mode, in_initialization
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, failed, passed, skipped, warned

_FUNCTION = "fmi2GetDirectionalDerivative"
_POINTS = 5
_STEPS = (1e-3, 1e-4)
"""Of two differences, in parts of the size of what is changed."""

_AGREE = 1e-3
"""Relative error of a derivative that is right; differences are off by less."""

_LOST = 1e-13
"""Of an unknown's value: a change that differences do not see."""

_KINK = 0.1
"""By how much, in parts of their mean, slopes to both sides differ where there is no slope."""


class _Slope(NamedTuple):
    """A derivative as it is given, and as a difference tells it."""

    unknown: str
    direction: str
    where: str
    given: float
    difference: float
    right: bool


class _Difference(NamedTuple):
    """Slopes of all unknowns, to both sides, to each, and by how much rounding may have them wrong."""

    central: Vector
    ahead: Vector
    behind: Vector
    lost: Vector


@check(
    "derivatives.directional",
    "Directional derivatives are those of the outputs",
    Clause("2.1.9", "This function computes the directional derivatives of an FMU."),
    "Compare the derivatives with differences, or do not say providesDirectionalDerivative.",
    needs=("run.finite",),
    time_factor=3.0,
)
def directional(subject: Subject) -> CheckOutcome:
    """They agree with central differences at most of several points, along each input and mixed ones."""
    claimed = [k for k in subject.kinds if subject.has_capability("providesDirectionalDerivative", k)]
    if not claimed:
        return skipped("It does not say providesDirectionalDerivative.")
    found: list[_Slope] = []
    try:
        if "CoSimulation" in claimed:
            found += _slopes(in_initialization(subject, _POINTS))
    except CallError as error:  # "at communication points", says the schema
        if not error.call.startswith(_FUNCTION):
            raise
        return warned(f"In initialization mode {error}")
    if "ModelExchange" in claimed:
        found += _of_model(subject)
    if not found:
        return skipped("No derivative of a Real output by a Real input could be asked for.")
    return _judged(found)


def _of_model(subject: Subject) -> list[_Slope]:
    """Those in event mode; none where it is another call that goes wrong, which is for another check."""
    try:
        return in_fresh_process(_slopes_of_model, subject)
    except (CallError, EndedError) as error:
        if error.call.startswith(_FUNCTION):
            raise
        return []


def _slopes_of_model(subject: Subject) -> list[_Slope]:
    return _slopes(in_event_mode(subject, _POINTS))


def _slopes(points: Iterable[Point]) -> list[_Slope]:
    return [slope for point in points for slope in _at(point)]


def _at(point: Point) -> Iterator[_Slope]:
    if not point.unknowns:
        return
    random, variables = np.random.default_rng(1), point.instance.subject.variables
    knowns = [name for name in point.knowns if variables[name].variability in (None, "continuous")]
    for known in knowns:
        yield from _along(point, {known: 1.0}, known)
    if len(knowns) > 1:
        for k in range(2):
            seed = dict(zip(knowns, random.uniform(-1.0, 1.0, len(knowns)), strict=True))
            scaled = {name: by * point.scale(name) for name, by in seed.items()}
            yield from _along(point, scaled, f"direction {k + 1}")


def _along(point: Point, seed: dict[str, float], direction: str) -> Iterator[_Slope]:
    """Slopes along a direction, of the unknowns that may depend on all of it."""
    given = point.directional(list(seed), list(seed.values()))
    size = min(point.scale(name) / abs(by) for name, by in seed.items() if by)
    try:
        wide, narrow = (_difference(point, seed, part * size) for part in _STEPS)
    except CallError:  # beyond what the FMU takes
        return
    # where two differences do not agree, noise or curvature has a part in them
    doubt = 2.0 * np.abs(wide.central - narrow.central) + narrow.lost
    kinked = np.abs(narrow.ahead - narrow.behind) > _KINK * np.abs(narrow.central) + doubt
    for i, dependency in enumerate(point.dependencies):
        told = all(not dependency.excludes(name) for name in seed)
        if told and np.isfinite(doubt[i]) and not kinked[i]:
            wanted, got = float(narrow.central[i]), float(given[i])
            right = abs(got - wanted) <= _AGREE * max(abs(got), abs(wanted)) + doubt[i]
            yield _Slope(dependency.unknown, direction, point.where, got, wanted, bool(right))


def _difference(point: Point, seed: dict[str, float], size: float) -> _Difference:
    there, back, here = (
        point.evaluate_shifted({name: by * way for name, by in seed.items()}) for way in (size, -size, 0.0)
    )
    ahead, behind = (there - here) / size, (here - back) / size
    return _Difference(0.5 * (ahead + behind), ahead, behind, _LOST * np.abs(here) / size)


def _judged(found: list[_Slope]) -> CheckOutcome:
    """Failed where a derivative is wrong at most of the points that it was asked for at."""
    pairs: dict[tuple[str, str], list[_Slope]] = {}
    for slope in found:
        pairs.setdefault((slope.unknown, slope.direction), []).append(slope)
    wrong = [
        next(s for s in slopes if not s.right)
        for slopes in pairs.values()
        if 2 * sum(not s.right for s in slopes) > len(slopes)
    ]
    if wrong:
        lines = tuple(_line(s) for s in wrong)
        return failed(
            f"{len(wrong)} of {len(pairs)} directional derivatives are wrong: {lines[0]}", details=lines
        )
    return passed(f"{len(pairs)} directional derivatives agree with differences at {_POINTS} points.")


def _line(slope: _Slope) -> str:
    return (
        f"that of {slope.unknown} along {slope.direction} {slope.where} is {slope.given:.6g}, "
        f"but differences give {slope.difference:.6g}."
    )


_MARGIN = 0.05
"""Of the largest derivative of an output, by which one may be beside the differences around it."""


@check(
    "derivatives.outputs",
    "Derivatives of outputs are their slopes",
    Clause("4.2.1", "Retrieves the n-th derivative of output values."),
    "Give the slope at the end of the step, or say maxOutputDerivativeOrder = 0.",
    needs=("run.finite",),
)
def of_outputs(subject: Subject) -> CheckOutcome:
    """fmi2GetRealOutputDerivatives gives what lies between the slopes before and after, at most points."""
    if subject.kinds[0] != "CoSimulation":
        return skipped("It is no FMU for Co-Simulation.")
    if not subject.find_kind_element("CoSimulation").maxOutputDerivativeOrder:
        return skipped("It says maxOutputDerivativeOrder = 0.")
    names = [v.name for v in subject.of_causality("output") if v.variability in (None, "continuous")]
    if not names:
        return skipped("It has no continuous output.")
    times, values, given = _slopes_on_the_way(subject, names)
    slopes = np.diff(values, axis=0) / np.diff(times)[:, None]
    beside = _beside(given, slopes)
    wrong = [name for name, part in zip(names, beside.mean(axis=0), strict=True) if part > 0.5]
    if wrong:
        return warned(
            f"{len(wrong)} of {len(names)} output derivatives are not the slopes of their outputs, "
            f"such as that of {wrong[0]}.",
            details=tuple(f"That of {name} is not." for name in wrong),
        )
    return passed(f"The derivatives of {len(names)} outputs are their slopes.")


def _slopes_on_the_way(subject: Subject, names: list[str]) -> tuple[Vector, Vector, Vector]:
    """Times, outputs and derivatives of a run whose inputs stand still: a jump has no slope."""
    instance, course = HostedInstance(subject), make_experiment(subject, 40)
    instance.initialize(course.at(0), float(course.times[0]))
    references = [instance.reference(n) for n in names]
    call: Callable[..., list[float]] = instance.fmu.getRealOutputDerivatives
    values, given = [], []
    for k in range(len(course.times) - 1):
        instance.set(course.at(len(course.times) // 3))
        instance.step(float(course.times[k]), course.step)
        values.append(instance.get(names))
        with instance.calling():
            given.append(call(references, [1] * len(names)))
        if instance.terminated:
            break
    return course.times[1 : len(values) + 1], np.array(values, dtype=float), np.array(given, dtype=float)


def _beside(given: Vector, slopes: Vector) -> Vector:
    """Where a derivative lies beside the slopes of the steps before and after it."""
    inner = given[1:-1]
    low, high = np.minimum(slopes[:-1], slopes[1:]), np.maximum(slopes[:-1], slopes[1:])
    margin = (high - low) + _MARGIN * np.abs(slopes).max(axis=0, initial=0.0) + 1e-12
    return ~((inner >= low - margin) & (inner <= high + margin))
