"""Checks of FMU states: get, set, free, serialize."""

import contextlib

import numpy as np

from emla_cosim.base.wording import format_count

from ..check import CheckOutcome, Verdict, check, failed, noted, passed, quote, skipped
from ..host.experiment import (
    Experiment,
    OutputTrajectory,
    make_experiment,
    run_alone,
    run_instance,
    step_instance,
    take_in_time,
)
from ..host.hosted_instance import CallError, HostedInstance, SerializedState
from ..host.process_state import can_read_memory, list_writable_memory, read_memory
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process, is_single_instance
from ._sameness import compare_runs
from .memory import read_allocated

# Effect of an internal solver that restarts when a state is set, relative to an output's range: up to it,
# a difference only warns. Solvers of stiff models with a loose tolerance reach several percent.
_ALLOWED = 0.1


@check("state.restored", needs=("run.deterministic",), time_factor=4.0)
def restored(subject: Subject) -> CheckOutcome:
    """Check that a run from a restored state continues as before, at several times, twice each."""
    if not subject.has_capability("canGetAndSetFMUstate"):
        return skipped("canGetAndSetFMUstate is not set.")
    instance, course = HostedInstance(subject), make_experiment(subject)
    steps = len(course.times) - 1
    instants = sorted({0, steps // 3, 2 * steps // 3})
    instance.initialize(course.at(0), float(course.times[0]))
    worst = None
    for first, last in zip(instants, [*instants[1:], steps], strict=True):
        for outcome in _run_twice_from_state(instance, course, first, last):
            if outcome.verdict == Verdict.FAILED:
                return outcome
            worst = outcome if outcome.verdict == Verdict.WARNING else worst
        if instance.terminated:
            break
    instance.close()
    return worst or passed(
        f"States at {len(instants)} times were saved, restored twice and freed; runs continued the same."
    )


def _run_twice_from_state(
    instance: HostedInstance, course: Experiment, first: int, last: int
) -> list[CheckOutcome]:
    """Compare two runs from a saved state, between two communication points, with the first run."""
    state = instance.save_state()
    expected = step_instance(instance, course, first, last)
    outcomes = []
    for _ in range(2):
        instance.restore_state(state)
        actual = step_instance(instance, course, first, last)
        run_name = f"A run from the state of t = {course.times[first]:.9g} s"
        outcomes.append(compare_runs(actual, expected, run_name, _ALLOWED))
    instance.free_state(state)
    return outcomes


# how often a state is saved again before memory is measured: where the C library counts bytes, and where
# it does not
_MAX_SAVES = {True: 500, False: 5000}

# part of the time limit in which that ends: states can be large
_TIME_FRACTION = 0.05

_MIN_GROWTH = 2.0**16, 2.0**12
"""Bytes by which the process must grow each time, counted by pages (a few are not a leak), and exactly."""


def _measure_growth_per_save(instance: HostedInstance) -> float:
    """Return the bytes by which the process grows with each call that saves a state over an earlier one.

    States are freed in between. 0 if nothing leaks, or if the memory cannot be measured.
    """
    if not can_read_memory():
        return 0.0
    uses_mallinfo = read_allocated() is not None
    used, count = [], 0
    for _ in range(3):
        state, count = instance.save_state(), 0
        for _ in take_in_time(
            range(_MAX_SAVES[uses_mallinfo]), _TIME_FRACTION * instance.subject.settings.seconds
        ):
            instance.save_state_again(state)
            count += 1
        instance.free_state(state)
        used.append((read_memory(), read_allocated() or 0.0))
    growth = np.diff(used, axis=0).min(axis=0)  # what was freed the first time is used again
    return float(np.where(growth > _MIN_GROWTH, growth, 0.0).max()) / count


@check("state.freed", needs=("state.restored",))
def freed(subject: Subject) -> CheckOutcome:
    """Check that saving a state again and freeing it leaks nothing; freeing must set and ignore NULL."""
    if not subject.has_capability("canGetAndSetFMUstate"):
        return skipped("canGetAndSetFMUstate is not set.")
    instance, course = HostedInstance(subject), make_experiment(subject, 1)
    instance.initialize(course.at(0), float(course.times[0]))
    state = instance.save_state()
    instance.free_state(state)
    if state.value is not None:
        return failed("fmi2FreeFMUstate leaves the pointer to the state that it freed.")
    if grown := _measure_growth_per_save(instance):
        return failed(
            f"The process grew by {grown:.0f} bytes with each call of fmi2GetFMUstate that was given an "
            "earlier state, although the state was freed then.",
            clause=quote("states.freed"),
        )
    instance.circumstance = " of a NULL pointer"
    instance.free_state(state)
    return passed("fmi2FreeFMUstate clears the pointer, and ignores one that is NULL.")


@check("state.serialized", needs=("state.restored",), time_factor=3.0)
def serialized(subject: Subject) -> CheckOutcome:
    """Check that a new instance continues the same from the serialized state of another one."""
    if not subject.has_capability("canSerializeFMUstate"):
        return skipped("canSerializeFMUstate is not set.")
    course = make_experiment(subject)
    middle = (len(course.times) - 1) // 2
    full_run = run_alone(subject, course)
    data = in_fresh_process(_serialize_at, subject, course, middle)
    if isinstance(data, int):
        return failed(f"fmi2SerializedFMUstateSize returned {data} bytes, which is not a plausible size.")
    if len(full_run.times) <= middle + 1:
        return skipped("It asked to end the run before its state could be saved.")
    actual = in_fresh_process(_run_from_bytes, subject, course, middle, data)
    expected = OutputTrajectory(full_run.times[middle:], full_run.names, full_run.values[middle:])
    run_name = f"A run from the serialized state of t = {course.times[middle]:.9g} s"
    outcome = compare_runs(actual, expected, run_name, _ALLOWED)
    if outcome.verdict == Verdict.PASSED and (count := len(_find_addresses(data))):
        outcome = _judge_moved_addresses(subject, course, middle, data, count) or outcome
    return outcome if outcome.verdict != Verdict.PASSED else _judge_damaged(subject, data)


_WORD = 8
# added to addresses in the bytes of a state, which then lead nowhere
_SHIFT = 1 << 46


def _find_addresses(data: bytes) -> list[int]:
    """Return where the bytes of a state hold addresses of the process that saved it.

    As doubles they are denormal, and as integers they are huge.
    """
    spans = getattr(data, "writable", ())
    words = np.frombuffer(data[: len(data) // _WORD * _WORD], dtype=np.uint64)
    inside = np.zeros(len(words), dtype=bool)
    for low, high in spans:
        inside |= (words >= low) & (words < high)
    return (_WORD * np.flatnonzero(inside)).tolist()


def _judge_moved_addresses(
    subject: Subject, course: Experiment, middle: int, data: bytes, count: int
) -> CheckOutcome | None:
    """Return what is wrong if a state's addresses are those of another process; None for nothing."""
    moved_data = bytearray(data)
    for position in _find_addresses(data):
        word = int.from_bytes(moved_data[position : position + _WORD], "little") + _SHIFT
        moved_data[position : position + _WORD] = word.to_bytes(_WORD, "little")
    addresses = format_count(count, "address", "addresses")
    message = f"The bytes of a state contain {addresses} of its process"
    try:
        arguments = (subject, course, middle, bytes(moved_data))
        in_fresh_process(_run_from_bytes, *arguments, timeout=subject.settings.seconds)
    except EndedError as error:
        return failed(f"{message}, used where they are restored: {error.call} ends another process.")
    except CallError:  # it may know that the bytes were changed
        return None
    return None


def save_bytes(instance: HostedInstance) -> bytes | None:
    """Return the present state serialized; None if the FMU cannot do that, or reports an implausible size."""
    if not instance.subject.has_capability("canSerializeFMUstate"):
        return None
    state = instance.save_state()
    data = instance.serialize(state)
    instance.free_state(state)
    return data if isinstance(data, bytes) else None


def _serialize_at(subject: Subject, course: Experiment, middle: int) -> bytes | int:
    """Return a state's bytes, or the reported size if it is not plausible."""
    instance = HostedInstance(subject)
    instance.initialize(course.at(0), float(course.times[0]))
    step_instance(instance, course, 0, middle)
    state = instance.save_state()
    data = instance.serialize(state)
    if isinstance(data, SerializedState):
        data.writable = list_writable_memory()
        instance.free_state(state)
    return data


def _run_from_bytes(subject: Subject, course: Experiment, middle: int, data: bytes) -> OutputTrajectory:
    instance = HostedInstance(subject)
    instance.initialize(course.at(0), float(course.times[0]))
    restore_bytes(instance, data)
    return step_instance(instance, course, middle)


def restore_bytes(instance: HostedInstance, data: bytes) -> None:
    """Continue from a serialized state."""
    state = instance.deserialize(data)
    instance.restore_state(state)
    instance.free_state(state)


def _judge_damaged(subject: Subject, data: bytes) -> CheckOutcome:
    """Check that truncated or changed bytes do not crash the FMU."""
    # the same damage in each examination
    random = np.random.default_rng(1)
    cases = {"half of the bytes": data[: len(data) // 2], "one byte": data[:1]}
    for k in range(4):
        damaged_data = bytearray(data)
        for position in random.integers(0, len(data), 1 + len(data) // 16):
            damaged_data[position] ^= int(random.integers(1, 256))
        cases[f"damaged bytes ({k + 1})"] = bytes(damaged_data)
    try:
        for part in ([c] for c in cases.items()) if is_single_instance(subject) else (list(cases.items()),):
            in_fresh_process(_restore_damaged, subject, part, timeout=subject.settings.seconds)
    except EndedError as error:
        return noted(f"{error.call} ends the process ({error.how}).")  # the standard does not require more
    message = f"A new instance continued from {len(data)} bytes like the old one; damaged bytes did no harm."
    return passed(message)


def _restore_damaged(subject: Subject, cases: list[tuple[str, bytes]]) -> None:
    """Continue from each of these states until a call fails."""
    course = make_experiment(subject, 2)
    for name, data in cases:
        instance = HostedInstance(subject)
        instance.circumstance = f" with a state made of {name}"
        with contextlib.suppress(CallError):
            run_instance(instance, course)
            restore_bytes(instance, data)
            instance.step(float(course.times[-1]), course.step)
        instance.free()
