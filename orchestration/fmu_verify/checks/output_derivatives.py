"""Compare derivatives of outputs with the slopes of the outputs."""

import numpy as np

from emla_cosim.base.arrays import Vector

from ..check import check
from ..host.experiment import make_experiment
from ..host.hosted_instance import HostedInstance
from ..host.instance_runs import walk
from ..messages import list_left_out
from ..subject import Subject
from ..verdict import CheckOutcome, passed, quote, skipped, warned

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
    for _ in walk(instance, course.times[:-1], course.step, lambda _: instance.set(middle)):
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
