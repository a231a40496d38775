"""Checks of instances: creation, independence, reset, memory."""

import math
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from emla_cosim.fmu.elements import CLOCK, explain_unsupported_clock, is_triggered_input
from emla_cosim.fmu.instance import OK

from ..check import CheckOutcome, Verdict, blocked, check, failed, noted, passed, quote, skipped, warned
from ..host.experiment import (
    MOST_STEPS,
    Experiment,
    OutputTrajectory,
    list_outputs,
    make_experiment,
    read_span,
    run_alone,
    run_instance,
)
from ..host.hosted_instance import CallError, HostedInstance
from ..host.log import LOG
from ..host.process_state import can_read_memory, read_memory
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process, is_single_instance
from ._sameness import compare_runs
from .memory import read_allocated


@check("instance.created", needs=("instance.environment",))
def created(subject: Subject) -> CheckOutcome:
    """Check that fmi2Instantiate returns an instance and fmi2FreeInstance frees it."""
    if subject.version == 3 and (reason := _explain_not_run(subject)):
        return blocked(reason)
    HostedInstance(subject).free()
    return passed("An instance was created and freed.")


def _explain_not_run(subject: Subject) -> str:
    """Return why an FMU of FMI 3.0 is not called; empty if it is."""
    if subject.kinds[0] == "ScheduledExecution":
        return "It is for Scheduled Execution only, which is not run."
    if not subject.has_clocks:
        return ""
    if subject.kinds[0] != "CoSimulation":
        return "It has Clocks, and is for Model Exchange only: such FMUs are not run."
    if not subject.has_flag("hasEventMode"):
        return "It has Clocks, but no event mode, which they need."
    description = subject.read_description()
    if (reason := explain_unsupported_clock(description)) is not None:
        return f"It {reason}."
    for clock in description.modelVariables:
        if clock.type == CLOCK and clock.causality == "input" and (clock.clocks or is_triggered_input(clock)):
            message = f"Its Clock '{clock.name}' is triggered from outside, or ticks with other Clocks"
            return f"{message}: such FMUs are not run."
    return ""


@check("instance.guid", needs=("instance.created",))
def guid(subject: Subject) -> CheckOutcome:
    """Check that fmi2Instantiate refuses a GUID of another model."""
    wrong = "{00000000-0000-0000-0000-000000000000}"
    try:
        HostedInstance(subject, guid=wrong)
    except CallError:
        return passed("fmi2Instantiate refused a wrong GUID.")
    judge = noted if subject.version == 3 else warned  # FMI 3.0 only allows the comparison
    return judge(f"fmi2Instantiate created an instance for the GUID {wrong}, which is not that of the FMU.")


_ONLY_ONCE = "canBeInstantiatedOnlyOncePerProcess is set."
_BATCHES = 5
_WARM_UP = 0.02
"""Duration in s of the cycles before memory is measured, and of each batch."""

_FEWEST = 10
"""Fewest cycles of a batch, unless they are slow."""

# Most cycles of a batch: enough for the smallest leak that counts. More may take all addresses.
_MOST = 41

_LEAK = 200.0
"""Bytes per cycle below which growth is ignored."""

# bytes per cycle from which the check fails: hosts with many instances notice
_SERIOUS = 2.0**14

# Bytes by which each batch must grow. A few pages are not a leak.
_PAGES = 2.0**13


@check("instance.cycles", clause=quote("shared.freed"), needs=("run.completes",), time_factor=4.0)
def cycles(subject: Subject) -> CheckOutcome:
    """Check that the process does not grow while instances are created, run, reset and freed."""
    if is_single_instance(subject):
        return skipped(_ONLY_ONCE)
    if not can_read_memory():
        message = "This system does not report how much memory a process uses."
        return skipped(message, gaps=(f"Memory that instances keep: {message}",))
    instance, course = HostedInstance(subject), make_experiment(subject, 2)
    instance.free()
    count, start = 0, time.monotonic()
    while count < _MOST:
        if (spent := time.monotonic() - start) > 1.0 or (spent > _WARM_UP and count >= _FEWEST):
            break
        _run_cycle(instance, course)
        count += 1
    leak = _measure_leak(instance, course, count)
    if leak:  # measure again, for longer, to be sure
        count *= 2
        leak = _measure_leak(instance, course, count)
    cycle_count = _BATCHES * count
    figures = {"bytes_per_cycle": leak, "cycles": cycle_count}
    if leak:
        message = f"The process grew by {leak:.0f} bytes with each of {cycle_count} instances that were"
        message = f"{message} created, run, reset, run again, terminated and freed."
        return (failed if leak > _SERIOUS else warned)(message, figures=figures)
    return passed(f"{cycle_count} instances were created, run, reset and freed.", figures=figures)


def _run_cycle(instance: HostedInstance, course: Experiment) -> None:
    """Instantiate, run, reset, run again, terminate and free an instance."""
    instance.instantiate()
    run_instance(instance, course)
    instance.reset()
    run_instance(instance, course)
    instance.close()
    LOG.lines.clear()


def _measure_leak(instance: HostedInstance, course: Experiment, count: int) -> float:
    """Return the bytes by which the process grows with each cycle; 0 if it does not grow in each batch."""
    # growth is judged batch by batch: caches grow once, leaks with each batch
    used = [_read_used()]
    for _ in range(_BATCHES):
        for _ in range(count):
            _run_cycle(instance, course)
        used.append(_read_used())
    leaks = [0.0]
    for grown, pages in zip(np.diff(used, axis=0).T, (_PAGES, 0.0), strict=True):
        least, middle = float(grown.min()), float(np.median(grown))
        if least > max(pages, 0.5 * _LEAK * count) and middle > _LEAK * count:
            leaks.append(middle / count)
    return max(leaks)


def _read_used() -> tuple[float, float]:
    """Return the bytes of pages that are used, and those that are allocated, also if nothing uses them."""
    return read_memory(), read_allocated() or 0.0


@check("instance.independent", clause=quote("shared.several"), needs=("run.deterministic",), time_factor=6.0)
def independent(subject: Subject) -> CheckOutcome:
    """Check that two instances that take turns, and one after them, give the same as each alone."""
    if is_single_instance(subject):
        return skipped(_ONLY_ONCE)
    courses = _make_courses(subject, 2)
    expected = [run_alone(subject, course) for course in courses]
    trajectories = in_fresh_process(_run_in_turns, subject, courses)
    subject_of_message = "An instance that runs with another one"
    outcomes = [compare_runs(f, w, subject_of_message) for f, w in zip(trajectories, expected, strict=False)]
    outcomes.append(compare_runs(trajectories[-1], expected[0], "An instance after others"))
    return _find_worst(outcomes) or passed("Two instances that took turns gave the same as each alone.")


def _make_courses(subject: Subject, count: int, steps: int = MOST_STEPS) -> list[Experiment]:
    """Return experiments that begin with different inputs."""
    course = make_experiment(subject, steps)
    shift = max(1, len(course.times) // (count + 1))
    return [
        replace(course, inputs={name: np.roll(v, k * shift) for name, v in course.inputs.items()})
        for k in range(count)
    ]


def _run_in_turns(subject: Subject, courses: list[Experiment]) -> list[OutputTrajectory]:
    """Run one instance for each course, each some steps behind the one before, and one more at the end."""
    instances = [HostedInstance(subject, f"examined {k}") for k in range(len(courses))]
    names = list_outputs(subject)
    rows: list[list[list[float]]] = [[] for _ in courses]
    last = len(courses[0].times) - 1
    delay = min(3, last)
    for round_number in range(last + 1 + delay * (len(courses) - 1)):
        for k, (instance, course) in enumerate(zip(instances, courses, strict=True)):
            at = round_number - k * delay
            if at == 0:
                instance.initialize(course.at(0), float(course.times[0]))
            elif 0 < at <= last and not instance.terminated:
                instance.set(course.at(at - 1))
                instance.step(float(course.times[at - 1]), course.step)
            else:
                continue
            if not instance.terminated:
                rows[k].append(instance.get(names))
    trajectories = [
        OutputTrajectory(c.times[: len(r)], names, np.array(r, dtype=float).reshape(len(r), len(names)))
        for c, r in zip(courses, rows, strict=True)
    ]
    for instance in instances:
        instance.close()
    return [*trajectories, run_instance(HostedInstance(subject), courses[0])]


def _find_worst(outcomes: list[CheckOutcome]) -> CheckOutcome | None:
    """Return the first failed outcome, or else the first warning; None if there is neither."""
    return next((o for v in (Verdict.FAILED, Verdict.WARNING) for o in outcomes if o.verdict == v), None)


_THREADS = 2, 8
_STEPS_IN_THREADS = 30
# part of the time limit for each of the runs one after the other; slow FMUs do fewer steps
_PART = 0.1


@check("instance.threads", needs=("instance.independent",), time_factor=9.0, advisory=True)
def threads(subject: Subject) -> CheckOutcome:
    """Check that two and eight instances in threads give the same as one after the other.

    The standard says in passing that they can be called in parallel.
    """
    courses = _make_courses(subject, max(_THREADS), _STEPS_IN_THREADS)
    expected = in_fresh_process(_run_one_by_one, subject, courses, _PART * subject.settings.seconds)
    if isinstance(expected, int):
        courses = _make_courses(subject, max(_THREADS), expected)
        expected = in_fresh_process(_run_one_by_one, subject, courses)
    for count in _THREADS:
        try:
            trajectories = in_fresh_process(_run_in_threads, subject, courses[:count])
        except (CallError, EndedError) as error:
            return warned(f"With {count} instances, each in its own thread: {error}")
        outcomes = [
            compare_runs(f, w, f"One of {count} instances in threads")
            for f, w in zip(trajectories, expected, strict=False)
        ]
        if worse := _find_worst(outcomes):
            return worse
    if worse := _judge_steps_at_once(subject):
        return worse
    counts = " and ".join(map(str, _THREADS))
    return passed(f"{counts} instances, each in its own thread, gave the same as one after the other.")


_AT_ONCE = 4
_REPEATS = 40
_MOST_STEPS_AT_ONCE = 1000
_DURATION = 0.02
"""Duration in s of the steps of one instance alone, and a fifth of that of all repetitions in threads."""


def _judge_steps_at_once(subject: Subject) -> CheckOutcome | None:
    """Repeat steps in threads with nothing between them: otherwise, threads of Python hardly ever meet.

    Return what is wrong; None if nothing is, or if the FMU cannot step with constant inputs.
    """
    if subject.kinds[0] != "CoSimulation" or subject.has_clocks:
        return None
    try:
        steps, expected = in_fresh_process(_step_alone, subject)
    except (CallError, EndedError):  # the model may not run with inputs that do not change
        return None
    try:
        trajectory = in_fresh_process(_step_in_threads, subject, steps, expected)
    except (CallError, EndedError) as error:
        return warned(f"With {_AT_ONCE} instances, each in its own thread: {error}")
    return _find_worst([compare_runs(trajectory, expected, f"One of {_AT_ONCE} instances in threads")])


def _step_alone(subject: Subject) -> tuple[int, OutputTrajectory]:
    """Return the steps that an instance makes in a short time, and its outputs after them."""
    instance, (_, _, count) = HostedInstance(subject), read_span(subject)
    until = time.monotonic() + _DURATION
    steps = _step_at_once(instance, min(count, _MOST_STEPS_AT_ONCE, subject.most_steps), until)
    return steps, _read_outputs(instance)


def _step_in_threads(subject: Subject, steps: int, expected: OutputTrajectory) -> OutputTrajectory:
    """Return the first outputs that differ, or the last ones, of instances that step at once."""
    instances = [HostedInstance(subject, f"examined {k}") for k in range(_AT_ONCE)]
    sys.setswitchinterval(1e-6)  # threads then leave each other less time alone
    until = time.monotonic() + 5.0 * _DURATION
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        for _ in range(_REPEATS):
            list(pool.map(_step_at_once, instances, [steps] * _AT_ONCE))
            for instance in instances:
                if not (trajectory := _read_outputs(instance)).has_same_values(expected):
                    return trajectory
                instance.free()
                instance.instantiate()
            if time.monotonic() > until:
                break
    return expected


def _step_at_once(instance: HostedInstance, most: int, until: float = math.inf) -> int:
    """Initialize an instance and step it with nothing between the calls; return the number of steps."""
    start, step, _ = read_span(instance.subject)
    instance.initialize(make_experiment(instance.subject, 1).at(0), start)
    call, arguments = instance.plain_step()
    for k in range(most):
        if call(instance.fmu.component, start + k * step, step, *arguments) != OK or time.monotonic() > until:
            return k + 1
    return most


def _read_outputs(instance: HostedInstance) -> OutputTrajectory:
    names = list_outputs(instance.subject)
    return OutputTrajectory(np.zeros(1), names, np.array([instance.get(names)], dtype=float))


def _run_one_by_one(
    subject: Subject, courses: list[Experiment], limit: float = math.inf
) -> list[OutputTrajectory] | int:
    """Return runs; or how many steps a run has in a limit in s, if the first one exceeds it."""
    trajectories = []
    for course in courses:
        start = time.monotonic()
        instance = HostedInstance(subject)
        trajectories.append(run_instance(instance, course))
        instance.free()
        if len(trajectories) == 1 and (spent := time.monotonic() - start) > limit:
            return max(1, int(limit / spent * (len(course.times) - 1)))
    return trajectories


def _run_in_threads(subject: Subject, courses: list[Experiment]) -> list[OutputTrajectory]:
    instances = [HostedInstance(subject, f"examined {k}") for k in range(len(courses))]
    with ThreadPoolExecutor(len(courses)) as pool:
        return list(pool.map(run_instance, instances, courses))


@check("instance.reset", needs=("run.deterministic",), time_factor=5.0)
def reset(subject: Subject) -> CheckOutcome:
    """Compare a run after fmi2Reset with that of a new instance, both after the same first run."""
    is_single = is_single_instance(subject)
    expected = run_alone(subject) if is_single else in_fresh_process(_run_twice, subject, False)
    after_reset = in_fresh_process(_run_twice, subject, True)
    return compare_runs(after_reset, expected, "A run after fmi2Reset", _ALLOWED)


_ALLOWED = 1e-6
"""Effect of solvers that begin to iterate at their last solution, relative to an output's range."""


def _run_twice(subject: Subject, resets: bool) -> OutputTrajectory:
    """Return the second of two runs, of the same instance (`resets`) or of a second one.

    Static variables keep their values in both cases, since fmi2Reset does not concern them.
    """
    course = make_experiment(subject)
    instance = HostedInstance(subject)
    reversed_course = replace(course, inputs={name: np.flip(v) for name, v in course.inputs.items()})
    run_instance(instance, reversed_course)
    if resets:
        instance.reset()
    else:
        instance.close()
        instance = HostedInstance(subject)
    return run_instance(instance, course)
