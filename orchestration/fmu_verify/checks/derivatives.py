"""Compare directional, adjoint and output derivatives with differences."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from emla_cosim.base.arrays import Vector

from ..check import CheckOutcome, check, failed, noted, passed, quote, skipped, warned
from ..host.experiment import make_experiment, step_through
from ..host.hosted_instance import CallError, HostedInstance
from ..host.points import (
    Point,
    list_unexamined_pairs,
    yield_points_in_event_mode,
    yield_points_in_initialization,
)
from ..messages import list_left_out
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process, in_separate_process
from ._points import (
    MOST_STATES,
    list_settable_states,
    list_states,
    yield_points_in_continuous_time,
    yield_points_in_step_mode,
    yield_points_with_states,
)

_FUNCTION = "fmi2GetDirectionalDerivative"
_POINTS = 5
_STEPS = (1e-3, 1e-4)
"""Step sizes of two differences, relative to the scale of the known."""

# allowed relative error of a derivative; that of the differences is smaller
_MAX_ERROR = 1e-3

# points with a wrong derivative from which it counts: one may be a kink
_MIN_WRONG_POINTS = 2

_ROUNDING = 1e-13
"""Relative change of an unknown that is lost in rounding."""

_ALL = "all knowns together"

_KINK = 0.1
"""Difference of the one-sided slopes, relative to their mean, from which there is no derivative."""


class _Slope(NamedTuple):
    """A derivative from the FMU, and the finite difference."""

    unknown: str
    direction: str
    where: str
    returned_value: float
    difference: float
    is_correct: bool


class _Difference(NamedTuple):
    """Slopes of all unknowns: central, forward, backward, and the rounding error."""

    central: Vector
    forward_slope: Vector
    backward_slope: Vector
    rounding_error: Vector


@check("derivatives.directional", needs=("run.finite",), time_factor=5.0)
def directional(subject: Subject) -> CheckOutcome:
    """Check directional derivatives against central differences, by inputs, states and mixed directions.

    They are compared in initialization mode, between steps, and in event and continuous-time mode.
    """
    claimed = [k for k in subject.kinds if subject.has_capability("providesDirectionalDerivative", k)]
    if not claimed:
        return skipped("providesDirectionalDerivative is not set.")
    slopes_by_mode, gaps = list[list[_Slope]](), list[str]()
    try:
        if "CoSimulation" in claimed:
            slopes_by_mode.append(
                in_separate_process(_compare_at_points, subject, yield_points_in_initialization)
            )
    except CallError as error:  # the schema requires them at communication points only
        if not error.call.startswith(_FUNCTION):
            raise
        return noted(f"In initialization mode {error}")
    if "CoSimulation" in claimed:
        if list_settable_states(subject):
            slopes_by_mode.append(_compare_in_fresh_process(subject, yield_points_with_states, gaps))
        if not subject.has_clocks:
            slopes = _compare_in_fresh_process(subject, yield_points_in_step_mode, gaps)
            # an FMU may hold outputs until the next step
            slopes_by_mode.append([s for s in slopes if s.difference])
    if "ModelExchange" in claimed and "ModelExchange" in subject.run_kinds:
        slopes_by_mode.append(_compare_in_fresh_process(subject, yield_points_in_event_mode))
        if list_states(subject):
            slopes_by_mode.append(_compare_in_fresh_process(subject, yield_points_in_continuous_time, gaps))
    if len(list_states(subject)) > MOST_STATES:
        gaps.append(f"Only derivatives by {MOST_STATES} of {len(list_states(subject))} states were compared.")
    if not any(slopes_by_mode):
        return skipped("No directional derivative of a Real output by a Real input can be requested.")
    return _judge_slopes(slopes_by_mode, (*gaps, *list_unexamined_pairs(subject)))


Points = Callable[[Subject, int], Iterable[Point]]


def _compare_in_fresh_process(
    subject: Subject, points: Points, gaps: list[str] | None = None
) -> list[_Slope]:
    """Return the slopes at points of another process. If another call fails, return none.

    Another check reports that. If derivatives are refused, `gaps` gets the reason; without `gaps`, where the
    FMU must have them, the error is raised.
    """
    try:
        return in_fresh_process(_compare_at_points, subject, points)
    except (CallError, EndedError) as error:
        if not error.call.startswith((_FUNCTION, _FUNCTION.replace("2", "3"))):
            return []
        if gaps is None or isinstance(error, EndedError):
            raise
        gaps.append(f"Not all directional derivatives were compared. {error}")
        return []


def _compare_at_points(subject: Subject, points: Points) -> list[_Slope]:
    return [slope for point in points(subject, _POINTS) for slope in _compare_at_point(point)]


def _compare_at_point(point: Point) -> Iterator[_Slope]:
    """Yield slopes along each known, along all of them together, and along two mixed directions."""
    if not point.unknowns:
        return
    # the same directions in each examination
    random, variables = np.random.default_rng(1), point.instance.subject.variables
    knowns = [name for name in point.knowns if variables[name].variability in (None, "continuous")]
    for known in knowns:
        yield from _compare_along(point, {known: 1.0}, known)
    if len(knowns) > 1:
        yield from _compare_sum(point, knowns)
        for k in range(2):
            seed = dict(zip(knowns, random.uniform(-1.0, 1.0, len(knowns)), strict=True))
            scaled = {name: by * point.scale(name) for name, by in seed.items()}
            yield from _compare_along(point, scaled, f"direction {k + 1}")


def _compare_sum(point: Point, knowns: Sequence[str]) -> Iterator[_Slope]:
    """Yield derivatives along all knowns together, and the sums of those along each."""
    single_derivatives = np.array([point.directional([name], [1.0]) for name in knowns])
    seed = [(-1.0) ** k / (1 + k) for k in range(len(knowns))]
    terms = single_derivatives * np.array(seed)[:, None]
    for unknown, returned_value, sum_, size in zip(
        point.unknowns,
        point.directional(knowns, seed),
        terms.sum(axis=0),
        np.abs(terms).sum(axis=0),
        strict=True,
    ):
        if np.isfinite(size):
            is_right = abs(returned_value - sum_) <= _MAX_ERROR * size
            yield _Slope(unknown, _ALL, point.where, float(returned_value), float(sum_), bool(is_right))


def _compare_along(point: Point, seed: dict[str, float], direction: str) -> Iterator[_Slope]:
    """Yield slopes along a direction, of the unknowns that may depend on all of its knowns."""
    returned_value = point.directional(list(seed), list(seed.values()))
    size = min(point.scale(name) / abs(by) for name, by in seed.items() if by)
    try:
        narrow, doubt = _differentiate(point, seed, size)
    except CallError:  # outside of the values that the FMU accepts
        return
    kinked = np.abs(narrow.forward_slope - narrow.backward_slope) > _KINK * np.abs(narrow.central) + doubt
    for i, dependency in enumerate(point.dependencies):
        may_depend = all(not dependency.excludes(name) for name in seed)
        if may_depend and np.isfinite(doubt[i]) and not kinked[i]:
            expected, actual = float(narrow.central[i]), float(returned_value[i])
            is_correct = abs(actual - expected) <= _MAX_ERROR * max(abs(actual), abs(expected)) + doubt[i]
            yield _Slope(dependency.unknown, direction, point.where, actual, expected, bool(is_correct))


def _differentiate(point: Point, seed: dict[str, float], size: float) -> tuple[_Difference, Vector]:
    """Return a difference, and its uncertainty: noise or curvature makes those of two sizes disagree."""
    wide, narrow = (_compute_difference(point, seed, part * size) for part in _STEPS)
    return narrow, 2.0 * np.abs(wide.central - narrow.central) + narrow.rounding_error


def _compute_difference(point: Point, seed: dict[str, float], size: float) -> _Difference:
    """Return the slopes of all unknowns along a direction, by steps of this size ahead and back."""
    value_ahead, value_behind, center = (
        point.evaluate_shifted({name: by * way for name, by in seed.items()}) for way in (size, -size, 0.0)
    )
    forward_slope, backward_slope = (value_ahead - center) / size, (center - value_behind) / size
    return _Difference(
        0.5 * (forward_slope + backward_slope),
        forward_slope,
        backward_slope,
        _ROUNDING * np.abs(center) / size,
    )


def _judge_slopes(slopes_by_mode: Sequence[Sequence[_Slope]], gaps: tuple[str, ...]) -> CheckOutcome:
    """Fail if a derivative is wrong at most of the points of a mode, or at several: one may be a kink."""
    pairs: dict[tuple[int, str, str], list[_Slope]] = {}
    for mode, slopes in enumerate(slopes_by_mode):
        for slope in slopes:
            pairs.setdefault((mode, slope.unknown, slope.direction), []).append(slope)
    wrong = list[_Slope]()
    for slopes in pairs.values():
        wrong_slopes = [s for s in slopes if not s.is_correct]
        if 2 * len(wrong_slopes) > len(slopes) or len(wrong_slopes) >= _MIN_WRONG_POINTS:
            wrong.append(wrong_slopes[0])
    if wrong:
        lines = tuple(_describe_slope(s) for s in wrong)
        message = f"{len(wrong)} of {len(pairs)} directional derivatives are wrong: {lines[0]}"
        return failed(message, details=lines, gaps=gaps)
    message = f"{len(pairs)} directional derivatives agree with differences at {_POINTS} points."
    return passed(message, gaps=gaps)


def _describe_slope(slope: _Slope) -> str:
    reference = "the sum of those along each" if slope.direction == _ALL else "the finite difference"
    return (
        f"that of {slope.unknown} along {slope.direction} {slope.where} is {slope.returned_value:.6g}, "
        f"{reference} is {slope.difference:.6g}."
    )


_MAX_ADJOINT_ERROR = 1e-9
"""Allowed difference of both products, relative to the sum of their terms."""


@check("derivatives.adjoint", needs=("run.finite",), time_factor=3.0, only_for=3)
def adjoint(subject: Subject) -> CheckOutcome:
    """Compare adjoint derivatives by inputs and states with directional ones, or with differences."""
    kind = subject.kinds[0]
    if not subject.has_flag("providesAdjointDerivatives", kind):
        return skipped("providesAdjointDerivatives is not set.")
    directional = subject.has_flag("providesDirectionalDerivatives", kind)
    (first, *further_modes), gaps = _list_adjoint_modes(subject, kind, directional), list[str]()
    wrong, count = in_separate_process(_compare_adjoint, subject, first, directional)
    for points in further_modes:
        try:
            more, number = in_separate_process(_compare_adjoint, subject, points, directional)
        except CallError as error:  # the standard requires fewer knowns
            gaps.append(f"Not all adjoint derivatives were compared. {error}")
            continue
        wrong, count = [*wrong, *more], count + number
    if wrong:
        message = f"{len(wrong)} of {count} adjoint derivatives are wrong: {wrong[0]}"
        return failed(message, details=tuple(wrong), gaps=tuple(gaps))
    if not count:
        return skipped("No derivative of a Real output by a Real input can be requested.")
    others = "directional ones" if directional else "differences"
    return passed(f"{count} adjoint derivatives agree with {others}.", gaps=tuple(gaps))


def _list_adjoint_modes(subject: Subject, kind: str, directional: bool) -> list[Points]:
    """Return the modes in which a kind has derivatives; between steps, an FMU may hold its outputs."""
    if kind != "CoSimulation":
        return [
            yield_points_in_event_mode,
            *([yield_points_in_continuous_time] if list_states(subject) else []),
        ]
    of_states = [yield_points_with_states] if list_settable_states(subject) else []
    return [yield_points_in_initialization, *of_states, *([yield_points_in_step_mode] if directional else [])]


def _compare_adjoint(subject: Subject, points: Points, directional: bool) -> tuple[list[str], int]:
    """Return what is wrong with adjoint derivatives, and how many were compared."""
    wrong, count = list[str](), 0
    for point in points(subject, _POINTS):
        if not point.unknowns or not point.knowns:
            continue
        matrix, doubt = _compute_matrix(point, directional)
        for i, unknown in enumerate(point.unknowns):
            seed = [float(k == i) for k in range(len(point.unknowns))]
            derivatives = np.array(point.instance.adjoint(point.unknowns, point.knowns, seed))
            count += len(derivatives)
            allowed = _MAX_ADJOINT_ERROR if directional else _MAX_ERROR
            limit = allowed * np.maximum(np.abs(derivatives), np.abs(matrix[i])) + doubt[i]
            for k in np.flatnonzero(~(np.abs(derivatives - matrix[i]) <= limit) & np.isfinite(matrix[i])):
                label = f"that of {unknown} by {point.knowns[k]} {point.where}"
                wrong.append(f"{label} is {derivatives[k]:.6g}, not {matrix[i][k]:.6g}.")
    return wrong, count


def _compute_matrix(point: Point, directional: bool) -> tuple[Vector, Vector]:
    """Return derivatives of the unknowns (rows) by the knowns (columns), and the uncertainty of each."""
    if directional:
        derivatives = np.array([point.directional([known], [1.0]) for known in point.knowns]).T
        return derivatives, np.zeros_like(derivatives)
    derivatives = [_differentiate(point, {known: 1.0}, point.scale(known)) for known in point.knowns]
    return np.array([d.central for d, _ in derivatives]).T, np.array([doubt for _, doubt in derivatives]).T


_MOST_ORDERS = 3
_LATE_RATIO = 0.1
"""Distance from the slope one step before, relative to that from the present one, that shows a late one."""

_MARGIN = 0.05
"""Allowed distance from the surrounding slopes, relative to the largest slope of the output."""


@check("derivatives.outputs", needs=("run.finite",))
def of_outputs(subject: Subject) -> CheckOutcome:
    """Check that fmi2GetRealOutputDerivatives is between the slopes before and after, at most points."""
    if subject.kinds[0] != "CoSimulation":
        return skipped("The FMU is not for Co-Simulation.")
    declared = int(subject.tree.find("CoSimulation").get("maxOutputDerivativeOrder", "0"))
    if not declared:
        return skipped("maxOutputDerivativeOrder is 0.")
    names = [v.name for v in subject.of_causality("output") if v.variability in (None, "continuous")]
    if not names:
        return skipped("It has no continuous output.")
    most = min(declared, _MOST_ORDERS)
    times, values = _record_derivatives(subject, names, most)
    wrong = []
    for order in range(1, most + 1):
        slopes = np.diff(values[order - 1], axis=0) / np.diff(times)[:, None]
        is_wrong = (_are_outside(values[order], slopes).mean(axis=0) > 0.5) | _are_late(values[order], slopes)
        wrong += [(name, order) for name, is_this in zip(names, is_wrong, strict=True) if is_this]
    if wrong:
        lines = tuple(f"The derivative of order {order} of {name} does not match." for name, order in wrong)
        message = f"{len(wrong)} of {most * len(names)} derivatives of outputs do not match their slopes"
        return warned(
            f"{message}, for example that of {wrong[0][0]}, of order {wrong[0][1]}.",
            details=lines,
            clause=quote("output_derivatives.at_the_end"),
        )
    gaps = list_left_out(most, declared, "orders of derivatives were compared.")
    message = f"The derivatives of {len(names)} outputs match their slopes, up to order {most}."
    return passed(message, gaps=gaps)


def _record_derivatives(subject: Subject, names: list[str], most: int) -> tuple[Vector, list[Vector]]:
    """Return times, and outputs and derivatives by order, of a run with constant inputs.

    A jump of an input has no slope.
    """
    instance, course = HostedInstance(subject), make_experiment(subject, 40)
    instance.initialize(course.at(0), float(course.times[0]))
    middle, rows = course.at(len(course.times) // 3), []
    for _ in step_through(instance, course.times[:-1], course.step, lambda _: instance.set(middle)):
        rows.append(
            [instance.get(names), *(instance.output_derivatives(names, n) for n in range(1, most + 1))]
        )
    shape = (len(rows), len(names))
    values = [np.array([r[order] for r in rows], dtype=float).reshape(shape) for order in range(most + 1)]
    return course.times[1 : len(rows) + 1], values


def _are_late(derivatives: Vector, slopes: Vector) -> Vector:
    """Return which derivatives are those of the communication point before."""
    middle = 0.5 * (slopes[:-1] + slopes[1:])  # at the points 1 to the last but one
    now, before = (np.abs(derivatives[2:-1] - m).sum(axis=0) for m in (middle[1:], middle[:-1]))
    variation = np.abs(np.diff(middle, axis=0)).sum(axis=0)
    return (before < _LATE_RATIO * now) & (variation > _MARGIN * np.abs(slopes).max(axis=0, initial=0.0))


def _are_outside(derivatives: Vector, slopes: Vector) -> Vector:
    """Return where a derivative is outside of the slopes of the steps before and after it."""
    inner = derivatives[1:-1]
    low, high = np.minimum(slopes[:-1], slopes[1:]), np.maximum(slopes[:-1], slopes[1:])
    # the constant is for slopes that are 0 but for rounding
    margin = (high - low) + _MARGIN * np.abs(slopes).max(axis=0, initial=0.0) + 1e-12
    return ~((inner >= low - margin) & (inner <= high + margin))
