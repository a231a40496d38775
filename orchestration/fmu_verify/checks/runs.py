"""Checks with runs of the default experiment."""

import math
import time
from collections.abc import Iterator

import numpy as np

from ..check import check
from ..host.experiment import Experiment, limits_of, make_experiment, span
from ..host.fresh_process import in_fresh_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.instance_runs import OutputTrajectory, outputs, run_alone, run_instance, step_instance
from ..host.junk import FIRST, SECOND, Junk, fill_memory
from ..messages import join_few_names
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, failed, fmi3, noted, passed, warned
from ._sameness import compare_runs
from .iteration import explain_endless

_PART = 0.4
"""Part of the time limit for one run; other checks run as many steps as are possible in this time."""


@check(
    "run.completes",
    "The default experiment runs",
    Clause(
        "4.2.4",
        "The following state machine defines the supported calling sequences.",
        in_3=fmi3(
            "4.2",
            "The state machine in [...] defines the allowed calling sequences for FMI for Co-Simulation.",
        ),
    ),
    "See the log. Try the FMU with the step size and start values that its author uses.",
    needs=("instance.created",),
)
def completes(subject: Subject) -> CheckOutcome:
    """Check that the FMU can be initialized, stepped with varying inputs, terminated and freed."""
    limit = _PART * subject.settings.seconds
    until = time.monotonic() + limit
    instance, course = HostedInstance(subject), make_experiment(subject)
    steps, done = len(course.times) - 1, 0
    try:
        instance.initialize(course.at(0), float(course.times[0]))
        while done < steps and not instance.terminated and (done == 0 or time.monotonic() < until):
            done += len(step_instance(instance, course, done, done + 1).times) - 1
        more = sum(1 for _ in _go_on(instance, course)) if done == steps else 0
    except CallError as error:
        return explain_endless(error)
    instance.close()
    if instance.terminated:
        said = f"It asked to end the run after {done} of {steps} steps of {course.step:g} s."
        return noted(said, figures={"steps": steps})
    whole, gaps = span(subject)[2], tuple[str, ...]()
    if done < steps:
        gaps = (f"Runs end after {done} of {whole} steps: more of them take longer than {limit:g} s.",)
    elif done < whole:
        gaps = (f"Runs end after {done} of the {whole} steps of the default experiment.",)
    if instance.events is not None and (idle := instance.events.list_idle_clocks()):
        gaps += (f"{join_few_names(idle)} did not tick, so that what belongs to it was not examined.",)
    said = f"{done + more} steps of {course.step:g} s were completed."
    return passed(said, figures={"steps": done + more}, gaps=gaps)


@check(
    "run.finite",
    "Outputs are always finite",
    Clause(
        "2.1.3",
        "fmi2OK – all well",
        in_3=fmi3("2.2.4", "The output argument values are defined."),
    ),
    "A step without finite results should return fmi2Discard or fmi2Error, and log the reason.",
    needs=("run.completes",),
)
def finite(subject: Subject) -> CheckOutcome:
    """Check that no output is NaN or infinite while calls return fmi2OK."""
    instance, course = HostedInstance(subject), make_experiment(subject)
    found = run_instance(instance, course)
    wrong = ~np.isfinite(found.values)
    for column, name in enumerate(found.names):
        if subject.variables[name].clocks and not wrong[:, column].all():  # it may begin with the first tick
            wrong[: int(np.argmin(wrong[:, column])), column] = False
    if wrong.any():
        return failed(found.describe(wrong))
    for at, values in _go_on(instance, course):
        for name, value in zip(found.names, values, strict=True):
            if not subject.variables[name].clocks and not math.isfinite(value):
                return failed(f"{name} is {value} at t = {at:.9g} s.")
    return passed(f"{len(found.names)} outputs are finite at {len(found.times)} times.")


_REST = 0.05
"""Part of the time limit in which a run goes on to the end of the default experiment."""


def _go_on(instance: HostedInstance, course: Experiment) -> Iterator[tuple[float, list[float]]]:
    """Step on with the last inputs to the end of the default experiment; yield times in s and outputs."""
    until, (start, step, count) = (
        time.monotonic() + _REST * instance.subject.settings.seconds,
        span(instance.subject),
    )
    names = outputs(instance.subject)
    for k in range(len(course.times) - 1, count):
        if instance.terminated or time.monotonic() > until:
            return
        instance.step(start + k * step, step)
        if not instance.terminated:
            yield start + (k + 1) * step, [float(value) for value in instance.get(names)]


_UNCERTAIN = 1e-6
"""Allowed distance from a declared range, relative to its ends."""


@check(
    "run.ranges",
    "Outputs stay between their min and max",
    Clause(
        "2.2.3",
        "If an FMU defines min/max values for Reals, then the expected behavior of the FMU is that "
        "fmi2GetReal returns values at the solution [...] in the defined range with a certain uncertainty "
        "related to the tolerances of the numerical algorithms.",
        in_3=fmi3(
            "2.2.7.3",
            "If an FMU defines min/max values for local and output variables of floating point types, then "
            "the FMU may return values in the defined range with a certain uncertainty related to the "
            "tolerances of the numerical algorithms and representational limits of IEEE 754.",
        ),
    ),
    "Widen min and max in modelDescription.xml, or limit the output.",
    needs=("run.finite",),
)
def ranges(subject: Subject) -> CheckOutcome:
    """Check that outputs stay in their declared ranges, but for the tolerance of solvers."""
    found = run_alone(subject)
    details = [
        line
        for n, values in zip(found.names, found.values.T, strict=True)
        if (line := _outside(subject, n, values, found))
    ]
    if details:
        return warned(
            f"{len(details)} outputs leave their declared range: {details[0]}", details=tuple(details)
        )
    return passed(f"{len(found.names)} outputs stay within their declared ranges.")


def _outside(subject: Subject, name: str, values: np.ndarray, found: OutputTrajectory) -> str:
    variable = subject.variables[name]
    low, high = limits_of(variable)
    slack = _UNCERTAIN * max((abs(x) for x in (low, high) if math.isfinite(x)), default=0.0)
    wrong = (values < low - slack) | (values > high + slack)
    if not wrong.any():
        return ""
    k = int(np.argmax(wrong))
    return f"{name} is {values[k]:.9g} at t = {found.times[k]:.9g} s, outside of {low:g} to {high:g}."


@check(
    "run.deterministic",
    "Two runs are the same",
    Clause("run.deterministic", "The same inputs give the same outputs.", document="emla verify"),
    "Initialize all memory, seed random numbers by a parameter, and do not use clocks or addresses.",
    needs=("run.completes",),
    time_factor=3.0,
)
def deterministic(subject: Subject) -> CheckOutcome:
    """Check that two processes agree that differ in addresses, clock second and junk in fresh memory.

    The standard does not require it, but a run that is not repeatable cannot be compared with anything.
    """
    first = in_fresh_process(_run_in_junk, subject, FIRST)
    time.sleep(1.0 - time.time() % 1.0 + 1e-3)  # FMUs may use the clock second as a seed
    second = in_fresh_process(_run_in_junk, subject, SECOND)
    return compare_runs(second, first, "A second run")


def _run_in_junk(subject: Subject, junk: Junk) -> OutputTrajectory:
    with fill_memory(junk):
        return run_instance(HostedInstance(subject), make_experiment(subject))
