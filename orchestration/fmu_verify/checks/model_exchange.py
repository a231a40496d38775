"""Checks of Model Exchange: integration, agreement with Co-Simulation, states."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from emla_cosim.base.arrays import Vector

from ..check import CheckOutcome, check, noted, passed, quote, skipped, unjudged
from ..host.experiment import (
    FEWEST_STEPS,
    Experiment,
    list_outputs,
    make_experiment,
    read_span,
    run_alone,
    run_instance,
)
from ..host.hosted_instance import CallError, HostedInstance
from ..host.integration import HostedModel
from ..messages import Breach, judge_problems
from ..subject import Subject
from ._sameness import describe_differences
from .events import make_endless_outcome

_WITH_CLOCKS = "Models with Clocks are not integrated; their co-simulation is examined."


@check("model_exchange.runs", needs=("instance.created",), time_factor=2.0)
def runs(subject: Subject) -> CheckOutcome:
    """Check that the model can be initialized, integrated with events, terminated and freed."""
    if "ModelExchange" not in subject.kinds:
        return skipped("The FMU is not for Model Exchange.")
    if subject.has_clocks:
        return unjudged(_WITH_CLOCKS)
    try:
        trajectory = run_alone(subject, kind="ModelExchange")
    except CallError as error:
        return make_endless_outcome(error)
    instance = HostedInstance(subject, kind="ModelExchange")
    run_instance(instance, make_experiment(subject, FEWEST_STEPS))
    instance.close()
    states = len(subject.description.derivatives)
    return passed(f"{states} states were integrated to t = {trajectory.times[-1]:.9g} s.")


@check("model_exchange.split", needs=("model_exchange.runs",), time_factor=3.0)
def split(subject: Subject) -> CheckOutcome:
    """Compare a run with one that enters event mode more often.

    Events near a communication point may fall on either side of it, so only many different rows count.
    """
    course = make_experiment(subject)
    inputs = {name: np.full(len(course.times), v[0]) for name, v in course.inputs.items()}
    start, step, count = read_span(subject)
    stride = step * max(1, count // (len(course.times) - 1))
    times = start + stride * np.arange(float(len(course.times)))
    frequent = run_alone(subject, Experiment(times, inputs), "ModelExchange")
    rare_inputs = {name: v[::_STRIDE] for name, v in inputs.items()}
    rare_times = start + _STRIDE * stride * np.arange(float(len(times[::_STRIDE])))
    rare = run_alone(subject, Experiment(rare_times, rare_inputs), "ModelExchange")
    # the FMU may end one of the runs early
    rows = min(len(rare.times), len(frequent.times[::_STRIDE]))
    frequent_values, rare_values = frequent.values[::_STRIDE][:rows], rare.values[:rows]
    scale = np.maximum(np.ptp(frequent_values, axis=0), np.ptp(rare_values, axis=0))
    different_fraction = (np.abs(frequent_values - rare_values) > _MAX_DIFFERENCE * scale).mean(axis=0)
    where = "where the host enters event mode"
    lines = [
        f"{name} differs in {part:.0%} of the rows {where} more often, with constant inputs."
        for name, part in zip(frequent.names, different_fraction, strict=True)
        if part > _MAX_DIFFERENT_FRACTION
    ]
    fine = f"{len(frequent.names)} outputs are the same {where} {_STRIDE} times as often."
    return judge_problems((), fine, lines)


_STRIDE = 5
_MAX_DIFFERENCE = 5e-3
_MAX_DIFFERENT_FRACTION = 0.3


@check("model_exchange.agrees", needs=("model_exchange.runs", "run.finite"), time_factor=3.0)
def agrees(subject: Subject) -> CheckOutcome:
    """Note outputs that differ between both kinds: the standard does not require that they agree."""
    if "CoSimulation" not in subject.kinds:
        return skipped("The FMU is not for Co-Simulation.")
    co_simulation, model = run_alone(subject, kind="CoSimulation"), run_alone(subject, kind="ModelExchange")
    rows = min(len(co_simulation.times), len(model.times))  # one may end the run early
    far, most = describe_differences(model, co_simulation, rows)
    if far:
        lines = tuple(f"{line}." for line in far)
        message = f"{len(far)} of {len(model.names)} outputs differ between Model Exchange and Co-Simulation"
        return noted(f"{message}: {lines[0]}", details=lines)
    return passed(f"Both kinds agree within {most:.1g} of each output's range.")


_POSITIVE = quote("model_states.positive")
_STEPS = 50
_CLOSE = 1e-9
"""Allowed distance of a derivative from the variable that it is, relative to the largest one."""

_STATES_IN_MESSAGE = 4
_HALVINGS = 30
_JUMP = 0.02
"""Least jump of a derivative, relative to its range in the run, that counts."""


@check("model_exchange.states", needs=("model_exchange.runs",), time_factor=2.0)
def states(subject: Subject) -> CheckOutcome:
    """Compare vectors of states and derivatives with the variables, and look for events not announced."""
    derivatives = [u.variable for u in subject.description.derivatives]
    names = [(d.derivative.name, d.name) for d in derivatives if d is not None and d.derivative is not None]
    if not derivatives or len(names) < len(derivatives):
        return skipped("It has no continuous states.")
    instance, course = HostedInstance(subject, kind="ModelExchange"), _make_long_experiment(subject)
    model = instance.model
    assert model is not None
    problems, doubts = list[str | Breach](), list[str | Breach]()
    instance.initialize(course.at(0), float(course.times[0]))
    visited = [_read_vector(model.read_states, len(names))]
    slopes = [_read_vector(model.derive, len(names))]
    problems += _find_wrong_nominal(model, names)
    for k in range(len(course.times) - 1):
        problems = problems or [*_find_mismatch(instance, names, float(course.times[k]))]
        instance.set(course.at(k))
        instance.step(float(course.times[k]), course.step)
        if instance.terminated:
            break
        visited.append(_read_vector(model.read_states, len(names)))
        slopes.append(_read_vector(model.derive, len(names)))
    problems += [Breach(message, quote("model_states.jumped")) for message in model.event_faults[:1]]
    instance.free()
    doubts += _find_jump(subject, course, names, np.array(visited), np.array(slopes))
    fine = f"{len(names)} states and derivatives are the variables of their places, and continuous."
    return judge_problems(problems, fine, doubts)


def _make_long_experiment(subject: Subject) -> Experiment:
    """Return the default experiment to its end, in long steps: the host integrates, and events come late."""
    course = make_experiment(subject, _STEPS)
    start, step, count = read_span(subject)
    stride = max(1, count // (len(course.times) - 1))
    return Experiment(start + stride * step * np.arange(float(len(course.times))), course.inputs)


def _read_vector(function: Any, count: int) -> Vector:
    vector = np.zeros(count)
    function(vector.ctypes.data)
    return vector


def _find_wrong_nominal(model: HostedModel, names: list[tuple[str, str]]) -> Iterator[Breach]:
    """Yield the first nominal value that is not positive."""
    nominal_values = _read_vector(model.write_nominals, len(names))
    for (state, _), value in zip(names, nominal_values, strict=True):
        if not value > 0.0:
            yield Breach(f"The nominal value of {state} is {value:g}; it must be positive.", _POSITIVE)
            return


def _find_mismatch(instance: HostedInstance, names: list[tuple[str, str]], time: float) -> Iterator[str]:
    """Yield the first state or derivative of the vectors that is not its variable, in event mode."""
    model = instance.model
    assert model is not None
    for kind, function, column in (("state", model.read_states, 0), ("derivative", model.derive, 1)):
        vector = _read_vector(function, len(names))
        variable_values = np.array(instance.get([pair[column] for pair in names]), dtype=float)
        is_different = np.abs(vector - variable_values) > _CLOSE * np.abs(variable_values).max(initial=1e-300)
        if is_different.any():
            i = int(np.argmax(is_different))
            message = f"{kind} {i + 1} is {vector[i]:.9g} at t = {time:.9g} s, but {names[i][column]}"
            yield f"{message}, which is listed there, is {variable_values[i]:.9g}."
            return


def _find_stale_output(instance: HostedInstance, visited: Vector) -> Iterator[str]:
    """Yield an output that follows new states only after the derivatives were read."""
    model, names = instance.model, list_outputs(instance.subject)
    assert model is not None
    for x in visited[1:3].copy():
        model.set_time_and_states(instance.start_time, x.ctypes.data)
        before = instance.get(names)
        _read_vector(model.derive, len(x))
        for name, old, new in zip(names, before, instance.get(names), strict=True):
            if old != new and old == old:
                message = f"{name} is {old:.9g} after new states were set, and {new:.9g} after their"
                yield f"{message} derivatives were read, too."
                return


def _find_jump(
    subject: Subject, course: Experiment, names: list[tuple[str, str]], visited: Vector, slopes: Vector
) -> Iterator[str | Breach]:
    """Yield a derivative that jumps between two states in continuous-time mode, without an event.

    Yield also an output that follows new states too late.

    Between events it is a continuous function of the states, which integrators rely on.
    """
    instance = HostedInstance(subject, name="continuous", kind="ModelExchange")
    model, start_time = instance.model, float(course.times[0])
    assert model is not None
    instance.initialize(course.at(0), start_time)
    model.enter_continuous_time_mode()
    yield from _find_stale_output(instance, visited)
    scale = np.ptp(slopes, axis=0)

    def derive(x: Vector) -> Vector:
        model.set_time_and_states(start_time, x.ctypes.data)
        return _read_vector(model.derive, len(names))

    try:
        with instance.calling():
            for left_states, right_states in zip(visited[:-1].copy(), visited[1:].copy(), strict=True):
                left_slopes, right_slopes = derive(left_states), derive(right_states)
                if not (np.abs(right_slopes - left_slopes) > _JUMP * scale).any():
                    continue
                for _ in range(_HALVINGS):
                    # halving leads to where the derivative jumps, if it does
                    middle = 0.5 * (left_states + right_states)
                    between = derive(middle)
                    if np.abs(between - left_slopes).max() > np.abs(right_slopes - between).max():
                        right_states, right_slopes = middle, between
                    else:
                        left_states, left_slopes = middle, between
                jump = np.abs(right_slopes - left_slopes)
                if np.isfinite(jump).all() and (jump > _JUMP * scale).any():
                    i = int(np.argmax(jump > _JUMP * scale))
                    pairs = zip(names[:_STATES_IN_MESSAGE], right_states, strict=False)
                    at = ", ".join(f"{n} = {v:.6g}" for (n, _), v in pairs)
                    yield Breach(
                        f"{names[i][1]} jumps from {left_slopes[i]:.6g} to {right_slopes[i]:.6g} in "
                        f"continuous-time mode, at {at}: an event indicator must announce it.",
                        quote("model_states.frozen"),
                    )
                    return
    except CallError:  # states beyond an event may be invalid
        return
