"""Check that values are those of their types: Booleans, Enumerations, Strings."""

import ctypes
import time as clock
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from fmpy.model_description import ModelVariable

from ..check import check
from ..host.experiment import make_experiment
from ..host.fresh_process import in_fresh_process, is_single_instance
from ..host.hosted_instance import CallError, HostedInstance
from ..host.junk import fill_memory
from ..host.other_values import MOST, Values, items_of, others, settable
from ..host.process_state import load_c_library
from ..messages import judge_problems, list_left_out, shorten_sentence
from ..subject import Subject
from ..subprocess_run import note
from ..verdict import CheckOutcome, Clause, fmi3, skipped
from ._clauses import ENUMERATION

_STEPS = 60
_EVERY = 7
"""Steps after which discrete inputs change, and after which the memory of Strings is looked at."""

_PART = 0.5
"""Part of the time limit for one run."""


@check(
    "values.booleans",
    "Booleans are fmi2True or fmi2False",
    Clause(
        "2.1.2",
        "Data type for Boolean numbers (only two values: fmi2False, fmi2True)",
        in_3=fmi3("fmi3PlatformTypes.h", "Data type to be used with fmi3True and fmi3False"),
    ),
    "Return 0 or 1: hosts compare with fmi2True.",
    needs=("run.completes",),
)
def booleans(subject: Subject) -> CheckOutcome:
    """Check the Booleans of a run."""
    return _judge(subject, "Boolean", lambda _, value: value in (0, 1))


@check(
    "values.enumerations",
    "Enumerations are items of their types",
    Clause(
        "2.2.3",
        "The values can be any integer number but must be unique within the same enumeration (in order that "
        'the mapping between "name" and "value" is bijective).',
        in_3=ENUMERATION,
    ),
    "Add an item for the value to the SimpleType, or return another one.",
    needs=("run.completes",),
)
def enumerations(subject: Subject) -> CheckOutcome:
    """Check the Enumerations of a run."""
    return _judge(subject, "Enumeration", lambda variable, value: value in items_of(variable))


def _judge(subject: Subject, kind: str, is_valid: Any) -> CheckOutcome:
    every = [v for v in subject.description.modelVariables if v.type == kind]
    if not every:
        return skipped(f"It has no {kind}.")
    variables = every[:MOST]
    found, gaps = in_fresh_process(_distinct, subject, [v.name for v in variables])
    problems = [
        f"{v.name} is {value} at t = {time:.9g} s, which is not a value of its type."
        for v in variables
        for value, time in found[v.name].items()
        if not is_valid(v, value)
    ]
    fine = f"{len(variables)} variables of type {kind} have values of their type."
    return judge_problems(problems, fine, gaps=(*gaps, *_not_read(variables, every)))


def _not_read(variables: Sequence[ModelVariable], every: Sequence[ModelVariable]) -> tuple[str, ...]:
    return list_left_out(len(variables), len(every), f"variables of type {every[0].type} were read.")


def _distinct(subject: Subject, names: Sequence[str]) -> tuple[dict[str, dict[int, float]], tuple[str, ...]]:
    """Return the values of each variable in runs, with the time of the first, and what the runs lack."""
    found: dict[str, dict[int, float]] = {name: {} for name in names}
    gaps = []
    for parameters in _parameters(subject):
        run = _VaryingRun(subject, parameters)
        with suppress(*([CallError] if parameters else [])):  # valid values, which the model need not bear
            for time, instance in run:
                for name, value in zip(names, instance.get(names), strict=True):
                    found[name].setdefault(int(value), time)
        gaps += run.gaps
    return found, tuple(dict.fromkeys(gaps))


def _parameters(subject: Subject) -> Iterator[Values]:
    """Yield values of parameters for runs: none, then other ones of Booleans and Enumerations."""
    yield {}
    if not is_single_instance(subject):
        found = (v for v in settable(subject, "parameter") if v.type in ("Boolean", "Enumeration"))
        if changes := others(found):
            yield changes


class _VaryingRun:
    """Yields an instance at communication points, while inputs of all types change.

    `gaps` says afterwards why it ended early.
    """

    def __init__(self, subject: Subject, parameters: Values | None = None) -> None:
        self._subject, self._parameters = subject, parameters or {}
        self.gaps: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[tuple[float, HostedInstance]]:
        subject, course = self._subject, make_experiment(self._subject, _STEPS)
        inputs = [v for v in settable(subject, "input") if v.type in ("Boolean", "Enumeration", "String")]
        other, steps = others(inputs), len(course.times) - 1
        instance = HostedInstance(subject)
        instance.initialize({**course.at(0), **self._parameters}, float(course.times[0]))
        yield float(course.times[0]), instance
        limit = _PART * subject.settings.seconds
        until = clock.monotonic() + limit  # a slow FMU is no fault
        for k in range(steps):
            if clock.monotonic() > until:
                self.gaps = (
                    f"Values were read for {k} of {steps} steps: more take longer than {limit:g} s.",
                )
                return
            changed = other if (k // _EVERY) % 2 else {}
            try:
                instance.set({**course.at(k), **changed})
                instance.step(float(course.times[k]), course.step)
            except CallError:
                if not changed:
                    raise
                # valid values, which the model need not bear
                self.gaps = (
                    f"Values were read for {k} of {steps} steps: it refuses other values of inputs.",
                )
                return
            if instance.terminated:
                return
            yield float(course.times[k + 1]), instance


@check(
    "values.strings",
    "Strings are valid",
    Clause(
        "2.1.2",
        r"Data type for character strings ('\0' terminated, UTF8 encoded)",
        in_3=fmi3("fmi3PlatformTypes.h", r"Data type for character strings ('\0' terminated, UTF-8 encoded)"),
    ),
    "Return a pointer to UTF-8 text that lives at least until the next call of the FMU; never NULL.",
    needs=("run.completes",),
)
def strings(subject: Subject) -> CheckOutcome:
    """Check that Strings are not NULL, are UTF-8, and live until the next call."""
    every = [v for v in subject.description.modelVariables if v.type == "String"]
    if not every:
        return skipped("It has no String.")
    variables = every[:MOST]
    problems, gaps = in_fresh_process(_invalid, subject, variables)
    fine = f"{len(variables)} Strings are valid."
    return judge_problems(problems, fine, gaps=(*gaps, *_not_read(variables, every)))


def _invalid(subject: Subject, variables: Sequence[ModelVariable]) -> tuple[list[str], tuple[str, ...]]:
    """Return what is wrong with Strings in a run, and what the run lacks."""
    found: dict[str, str] = {}
    run = _VaryingRun(subject)
    with fill_memory():  # what is freed does not keep its content
        for k, (time, instance) in enumerate(run):
            for variable in variables:
                if wrong := _problem(instance, variable, looks_at_memory=k % _EVERY == 0):
                    found.setdefault(variable.name, f"{variable.name} {wrong} at t = {time:.9g} s.")
            if not found and (name := _overwritten(instance, [v.name for v in variables])):
                wrong = "has another value if all Strings are read in one call"
                found[name] = f"{name} {wrong} at t = {time:.9g} s."
    return list(found.values()), run.gaps


def _overwritten(instance: HostedInstance, names: Sequence[str]) -> str:
    """Return the first String that differs if it is read with others; empty if there is none."""
    pairs = zip(names, instance.get_together(names), instance.get(names), strict=True)
    return next((name for name, together, alone in pairs if together != alone), "")


def _problem(instance: HostedInstance, variable: ModelVariable, looks_at_memory: bool) -> str:
    """Return what is wrong with a String, or an empty text. To look where it is takes longest."""
    pointer = (ctypes.c_char_p * 1)()
    with instance.calling():
        reference = (ctypes.c_uint * 1)(variable.valueReference)
        if instance.subject.version == 3:
            instance.fmu.fmi3GetString(instance.fmu.component, reference, 1, pointer, 1)
        else:
            instance.fmu.fmi2GetString(instance.fmu.component, reference, 1, pointer)
    place = ctypes.cast(pointer, ctypes.POINTER(ctypes.c_void_p))[0]
    if place is None:
        return "is a NULL pointer"
    if looks_at_memory and _is_on_stack(place):
        return "is on the stack of a function that has returned"
    note(f"reading the String {variable.name} that fmi2GetString returned")
    first = ctypes.string_at(place)
    if looks_at_memory and _changes(place, first):
        return "changes although no function of the FMU is called: its memory is free"
    try:
        first.decode()
    except UnicodeDecodeError:
        return f"is not UTF-8, but {shorten_sentence(repr(first[:60]))},"
    return ""


def _is_on_stack(place: int) -> bool:
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return False
    for line in lines:
        if line.endswith("[stack]"):
            low, high = (int(end, 16) for end in line.split()[0].split("-"))
            return low <= place < high
    return False


def _changes(place: int, text: bytes) -> bool:
    """Return whether a text changes when small blocks of memory are taken, as by any host."""
    library = load_c_library()
    library.malloc.restype = ctypes.c_void_p
    blocks = [library.malloc(ctypes.c_size_t(size)) for size in range(8, 520, 16) for _ in range(9)]
    for k, block in enumerate(blocks):
        ctypes.memset(block, 0x5A, 8 + 16 * (k // 9))
    for block in blocks:
        library.free(ctypes.c_void_p(block))
    return ctypes.string_at(place) != text
