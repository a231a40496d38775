"""Checks with runs of the default experiment, also with other orders and steps."""

import math
import time
from collections.abc import Sequence

import numpy as np

from ..check import CheckOutcome, Verdict, check, failed, noted, passed, quote, skipped, warned
from ..host.experiment import (
    MOST_STEPS,
    Experiment,
    OutputTrajectory,
    find_run,
    keep_run,
    list_outputs,
    make_experiment,
    read_end_of_run,
    read_limits,
    read_span,
    run_alone,
    run_instance,
    step_instance,
    step_through,
)
from ..host.hosted_instance import CallError, HostedInstance
from ..host.process_state import fill_memory
from ..messages import join_few_names
from ..subject import Subject
from ..subprocess_run import in_fresh_process
from ._sameness import compare_runs, describe_differences
from .events import make_endless_outcome

# part of the time limit for one run; other checks run as many steps as are possible in this time
_PART = 0.4


@check("run.completes", needs=("instance.created",))
def completes(subject: Subject) -> CheckOutcome:
    """Check that the FMU can be initialized, stepped with varying inputs, terminated and freed."""
    limit = _PART * subject.settings.seconds
    until = time.monotonic() + limit
    instance, course = HostedInstance(subject), make_experiment(subject)
    steps, more = len(course.times) - 1, 0
    try:
        instance.initialize(course.at(0), float(course.times[0]))
        trajectory = step_instance(instance, course, until=until)
        steps_done = len(trajectory.times) - 1
        if steps_done == steps:
            rest = _run_rest(instance, course)
            more = len(rest.times)
            keep_run(subject, course, _REST, rest)
    except CallError as error:
        return make_endless_outcome(error)
    instance.close()
    if steps_done == steps or instance.terminated:
        keep_run(subject, course, subject.kinds[0], trajectory)
    if instance.terminated:
        message = f"It asked to end the run after {steps_done} of {steps} steps of {course.step:g} s."
        return noted(message, figures={"steps": steps})
    all_steps, gaps = read_span(subject)[2], tuple[str, ...]()
    if steps_done < steps:
        reason = f"more of them take longer than {limit:g} s"
        gaps = (f"Runs end after {steps_done} of {all_steps} steps: {reason}.",)
    elif steps_done < all_steps:
        gaps = (f"Runs end after {steps_done} of the {all_steps} steps of the default experiment.",)
    if instance.events is not None and (idle := instance.events.list_idle_clocks()):
        gaps += (f"{join_few_names(idle)} did not tick, so that what belongs to it was not examined.",)
    message = f"{steps_done + more} steps of {course.step:g} s were completed."
    return passed(message, figures={"steps": steps_done + more}, gaps=gaps)


@check("run.finite", needs=("run.completes",))
def finite(subject: Subject) -> CheckOutcome:
    """Check that no output is NaN or infinite while calls return fmi2OK."""
    trajectory, rest = run_alone(subject), find_run(subject, make_experiment(subject), _REST)
    wrong = ~np.isfinite(trajectory.values)
    for column, name in enumerate(trajectory.names):
        if subject.variables[name].clocks and not wrong[:, column].all():  # it may begin with the first tick
            wrong[: int(np.argmin(wrong[:, column])), column] = False
    if wrong.any():
        return failed(trajectory.describe(wrong))
    if rest is not None:
        clocked = [bool(subject.variables[name].clocks) for name in rest.names]
        if (wrong := ~np.isfinite(rest.values) & ~np.array(clocked, dtype=bool)).any():
            return failed(rest.describe(wrong))
    return passed(f"{len(trajectory.names)} outputs are finite at {len(trajectory.times)} times.")


_REST = "the rest"
"""The name of the run from there to the end of the default experiment."""

_PART_OF_REST = 0.05
"""Part of the time limit for it."""


def _run_rest(instance: HostedInstance, course: Experiment) -> OutputTrajectory:
    """Step on with the last inputs to the end of the default experiment."""
    until = time.monotonic() + _PART_OF_REST * instance.subject.settings.seconds
    (start, step, count), names = read_span(instance.subject), list_outputs(instance.subject)
    rows = list[list[float]]()
    for k in range(len(course.times) - 1, count):
        if instance.terminated or time.monotonic() > until:
            break
        instance.step(start + k * step, step)
        if not instance.terminated:
            rows.append(instance.get(names))
    times = start + step * (len(course.times) + np.arange(float(len(rows))))
    return OutputTrajectory(times, names, np.array(rows, dtype=float).reshape(len(rows), len(names)))


_UNCERTAIN = 1e-6
"""Allowed distance from a declared range, relative to its ends."""


@check("run.ranges", needs=("run.finite",))
def ranges(subject: Subject) -> CheckOutcome:
    """Check that outputs stay in their declared ranges, but for the tolerance of solvers."""
    trajectory = run_alone(subject)
    details = [
        line
        for n, values in zip(trajectory.names, trajectory.values.T, strict=True)
        if (line := _describe_violation(subject, n, values, trajectory))
    ]
    if details:
        message = f"{len(details)} outputs leave their declared range: {details[0]}"
        return warned(message, details=tuple(details))
    return passed(f"{len(trajectory.names)} outputs stay within their declared ranges.")


def _describe_violation(subject: Subject, name: str, values: np.ndarray, trajectory: OutputTrajectory) -> str:
    """Return the first value of an output outside of its declared range, as a message; empty without one."""
    variable = subject.variables[name]
    low, high = read_limits(variable)
    # the standard allows "a certain uncertainty" of solvers
    slack = _UNCERTAIN * max((abs(x) for x in (low, high) if math.isfinite(x)), default=0.0)
    wrong = (values < low - slack) | (values > high + slack)
    if not wrong.any():
        return ""
    k = int(np.argmax(wrong))
    return f"{name} is {values[k]:.9g} at t = {trajectory.times[k]:.9g} s, outside of {low:g} to {high:g}."


@check("run.deterministic", needs=("run.completes",), time_factor=3.0)
def deterministic(subject: Subject) -> CheckOutcome:
    """Check that two processes agree that differ in addresses, clock second and junk in fresh memory.

    The standard does not require it, but a run that is not repeatable cannot be compared with anything.
    """
    first, ended = run_alone(subject), read_end_of_run(subject)
    while int(time.time()) == int(ended):  # FMUs may use the clock second as a seed
        time.sleep(1.0 - time.time() % 1.0 + 1e-3)
    return compare_runs(in_fresh_process(_run_in_junk, subject), first, "A second run")


def _run_in_junk(subject: Subject) -> OutputTrajectory:
    with fill_memory():
        return run_instance(HostedInstance(subject), make_experiment(subject))


_MOST_CALLS, _FEWEST_STEPS = 50_000, 2
"""Most calls of a run with values exchanged one by one, and its fewest steps."""


@check("exchange.order", needs=("run.deterministic",), time_factor=4.0)
def order(subject: Subject) -> CheckOutcome:
    """Check that setting inputs and reading outputs one by one, in both orders, gives the same run."""
    steps = _MOST_CALLS // (len(subject.of_causality("input", "output")) or 1)
    course = make_experiment(subject, min(max(steps, _FEWEST_STEPS), MOST_STEPS))
    expected = run_alone(subject, course)
    for description, backwards in (("one by one", False), ("one by one in reverse", True)):
        actual = in_fresh_process(_run_exchanging_one_by_one, subject, course, backwards)
        outcome = compare_runs(actual, expected, f"A run with values exchanged {description}")
        if outcome.verdict != Verdict.PASSED:
            return outcome
    return passed(f"Exchanging values one by one, in both orders, gave the same {len(expected.times)} rows.")


def _run_exchanging_one_by_one(subject: Subject, course: Experiment, backwards: bool) -> OutputTrajectory:
    """Run an instance with one call for each input and output, if `backwards` in reverse order."""
    instance, names = HostedInstance(subject), list_outputs(subject)

    def order_of(all_names: Sequence[str]) -> list[str]:
        return list(all_names)[::-1] if backwards else list(all_names)

    def set_inputs(k: int) -> None:
        values = course.at(k)
        for name in order_of(list(values)):
            instance.set({name: values[name]})

    def read_outputs() -> list[float]:
        first = {n: instance.get([n])[0] for n in order_of(names)}
        values_read_last = {n: instance.get([n])[0] for n in order_of(names)} if backwards else first
        return [values_read_last[n] for n in names]

    set_inputs(0)
    instance.initialize(None, float(course.times[0]))
    rows = [read_outputs()]
    rows += [read_outputs() for _ in step_through(instance, course.times[:-1], course.step, set_inputs)]
    values = np.array(rows, dtype=float).reshape(len(rows), len(names))
    return OutputTrajectory(course.times[: len(rows)], names, values)


@check("steps.split", needs=("run.deterministic", "run.finite"), time_factor=4.0)
def split(subject: Subject) -> CheckOutcome:
    """Check that half steps with held inputs work, and note outputs that do not end where whole ones do."""
    if subject.kinds[0] != "CoSimulation":
        return skipped("The FMU is for Model Exchange: the host integrates it.")
    if not subject.has_capability("canHandleVariableCommunicationStepSize"):
        return skipped("canHandleVariableCommunicationStepSize is not set.")
    course = make_experiment(subject)
    times = course.times[0] + 0.5 * course.step * np.arange(2 * len(course.times) - 1)
    held_inputs = {name: np.repeat(v, 2)[:-1] for name, v in course.inputs.items()}  # for two half steps
    full_steps, half_steps = run_alone(subject, course), run_alone(subject, Experiment(times, held_inputs))
    rows = min(len(full_steps.times), (len(half_steps.times) + 1) // 2)  # the FMU may end the run early
    values = half_steps.values[: 2 * rows : 2]
    every_other = OutputTrajectory(full_steps.times[:rows], full_steps.names, values)
    different, most = describe_differences(full_steps, every_other, rows)
    if different and (same := _find_outputs_that_ignore_step_size(subject, course)):
        names = join_few_names(same)
        count = _STEPS_WITHOUT_INPUTS
        message = f"These are the same after {count} half steps as after {count} whole ones: {names}."
        return warned(message, clause=quote("exchange.size"))
    if different:
        lines = tuple(f"{line} with half steps." for line in different)
        # the standard does not require it, and a state may be sampled once per step on purpose
        return noted(
            f"{len(different)} of {len(full_steps.names)} outputs depend on the step size: {lines[0]}",
            details=lines,
        )
    return passed(f"Half steps and whole steps agree within {most:.1g} of each output's range.")


_STEPS_WITHOUT_INPUTS = 20


def _find_outputs_that_ignore_step_size(subject: Subject, course: Experiment) -> list[str]:
    """Return continuous outputs that change as much in half steps as in whole ones, with constant inputs."""
    inputs = {name: np.full(_STEPS_WITHOUT_INPUTS + 1, v[0]) for name, v in course.inputs.items()}
    full_steps, half_steps = (
        run_alone(
            subject,
            Experiment(course.times[0] + np.arange(_STEPS_WITHOUT_INPUTS + 1) * part * course.step, inputs),
        )
        for part in (1.0, 0.5)
    )
    if len(full_steps.times) != len(half_steps.times):
        return []
    is_moving = np.mean(np.diff(full_steps.values, axis=0) != 0.0, axis=0) > 0.5
    is_close = np.isclose(full_steps.values, half_steps.values, rtol=1e-9, atol=0.0).all(axis=0)
    return [
        name
        for name, is_same in zip(full_steps.names, is_moving & is_close, strict=True)
        if is_same and subject.variables[name].variability in (None, "continuous")
    ]
