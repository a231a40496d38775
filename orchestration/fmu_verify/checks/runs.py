"""Checks with runs of the default experiment."""

import math
import time

import numpy as np

from ..check import check
from ..host.experiment import Experiment, make_experiment, read_limits, read_span
from ..host.fresh_process import in_fresh_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.instance_runs import (
    OutputTrajectory,
    find_run,
    keep_run,
    list_outputs,
    run_alone,
    run_instance,
    step_instance,
    time_of_run,
)
from ..host.junk import fill_memory
from ..messages import join_few_names
from ..subject import Subject
from ..verdict import CheckOutcome, failed, noted, passed, warned
from ._sameness import compare_runs
from .iteration import explain_endless

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
            rest = _go_on(instance, course)
            more = len(rest.times)
            keep_run(subject, course, _REST, rest)
    except CallError as error:
        return explain_endless(error)
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


def _go_on(instance: HostedInstance, course: Experiment) -> OutputTrajectory:
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
    first, ended = run_alone(subject), time_of_run(subject)
    while int(time.time()) == int(ended):  # FMUs may use the clock second as a seed
        time.sleep(1.0 - time.time() % 1.0 + 1e-3)
    return compare_runs(in_fresh_process(_run_in_junk, subject), first, "A second run")


def _run_in_junk(subject: Subject) -> OutputTrajectory:
    with fill_memory():
        return run_instance(HostedInstance(subject), make_experiment(subject))
