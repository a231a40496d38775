"""Check that values are those of their types: Booleans, Enumerations, Strings."""

import ctypes
import time as clock
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from fmpy.model_description import ModelVariable

from ..check import CheckOutcome, check, skipped
from ..host.experiment import make_experiment
from ..host.hosted_instance import CallError, HostedInstance
from ..host.other_values import MOST, Values, list_items, list_other_values, list_settable
from ..host.process_state import fill_memory, load_c_library
from ..messages import judge_problems, list_left_out, shorten_sentence
from ..subject import Subject
from ..subprocess_run import in_fresh_process, is_single_instance, note

_STEPS = 60
_STEPS_PER_CHANGE = 7
"""Steps after which discrete inputs change, and after which the memory of Strings is looked at."""

_TIME_FRACTION = 0.5
"""Part of the time limit for one run."""


@check("values.booleans", needs=("run.completes",))
def booleans(subject: Subject) -> CheckOutcome:
    """Check that Booleans are true or false in runs with inputs and parameters that change."""
    return _judge_values(subject, "Boolean", lambda _, value: value in (0, 1))


@check("values.enumerations", needs=("run.completes",))
def enumerations(subject: Subject) -> CheckOutcome:
    """Check that Enumerations have values of their items in runs with inputs and parameters that change."""
    return _judge_values(subject, "Enumeration", lambda variable, value: value in list_items(variable))


def _judge_values(subject: Subject, kind: str, is_valid: Any) -> CheckOutcome:
    """Judge the values of all variables of a type; `is_valid` takes a variable and its value."""
    all_variables = [v for v in subject.description.modelVariables if v.type == kind]
    if not all_variables:
        return skipped(f"It has no {kind}.")
    variables = all_variables[:MOST]
    times_by_value, gaps = in_fresh_process(_collect_values, subject, [v.name for v in variables])
    problems = [
        f"{v.name} is {value} at t = {time:.9g} s, which is not a value of its type."
        for v in variables
        for value, time in times_by_value[v.name].items()
        if not is_valid(v, value)
    ]
    fine = f"{len(variables)} variables of type {kind} have values of their type."
    return judge_problems(problems, fine, gaps=(*gaps, *_list_unread(variables, all_variables)))


def _list_unread(
    variables: Sequence[ModelVariable], all_variables: Sequence[ModelVariable]
) -> tuple[str, ...]:
    return list_left_out(
        len(variables), len(all_variables), f"variables of type {all_variables[0].type} were read."
    )


def _collect_values(
    subject: Subject, names: Sequence[str]
) -> tuple[dict[str, dict[int, float]], tuple[str, ...]]:
    """Return the values of each variable in runs, with the time of the first, and what the runs lack."""
    times_by_value: dict[str, dict[int, float]] = {name: {} for name in names}
    gaps = list[str]()
    for parameters in _yield_parameters(subject):
        with suppress(*([CallError] if parameters else [])):  # valid values, which the model need not accept
            for time, instance in _run_varying(subject, parameters, gaps):
                for name, value in zip(names, instance.get(names), strict=True):
                    times_by_value[name].setdefault(int(value), time)
    return times_by_value, tuple(dict.fromkeys(gaps))


def _yield_parameters(subject: Subject) -> Iterator[Values]:
    """Yield values of parameters for runs: none, then other ones of Booleans and Enumerations."""
    yield {}
    if not is_single_instance(subject):
        parameters = (v for v in list_settable(subject, "parameter") if v.type in ("Boolean", "Enumeration"))
        if changes := list_other_values(parameters):
            yield changes


def _run_varying(
    subject: Subject, parameters: Values, gaps: list[str]
) -> Iterator[tuple[float, HostedInstance]]:
    """Yield an instance at communication points, while inputs of all types change.

    `gaps` gets why it ended early.
    """
    course, kinds = make_experiment(subject, _STEPS), ("Boolean", "Enumeration", "String")
    inputs = [v for v in list_settable(subject, "input") if v.type in kinds]
    other_values, steps = list_other_values(inputs), len(course.times) - 1
    instance = HostedInstance(subject)
    instance.initialize({**course.at(0), **parameters}, float(course.times[0]))
    yield float(course.times[0]), instance
    limit = _TIME_FRACTION * subject.settings.seconds
    until = clock.monotonic() + limit  # a slow FMU is not a fault
    for k in range(steps):
        if clock.monotonic() > until:
            gaps.append(f"Values were read for {k} of {steps} steps: more take longer than {limit:g} s.")
            return
        changed = other_values if (k // _STEPS_PER_CHANGE) % 2 else {}
        try:
            instance.set({**course.at(k), **changed})
            instance.step(float(course.times[k]), course.step)
        except CallError:
            if not changed:
                raise
            # valid values, which the model need not accept
            gaps.append(f"Values were read for {k} of {steps} steps: it refuses other values of inputs.")
            return
        if instance.terminated:
            return
        yield float(course.times[k + 1]), instance


@check("values.strings", needs=("run.completes",))
def strings(subject: Subject) -> CheckOutcome:
    """Check that Strings are not NULL, are UTF-8, and live until the next call."""
    all_variables = [v for v in subject.description.modelVariables if v.type == "String"]
    if not all_variables:
        return skipped("It has no String.")
    variables = all_variables[:MOST]
    problems, gaps = in_fresh_process(_find_invalid_strings, subject, variables)
    fine = f"{len(variables)} Strings are valid."
    return judge_problems(problems, fine, gaps=(*gaps, *_list_unread(variables, all_variables)))


def _find_invalid_strings(
    subject: Subject, variables: Sequence[ModelVariable]
) -> tuple[list[str], tuple[str, ...]]:
    """Return what is wrong with Strings in a run, and what the run lacks."""
    messages, gaps = dict[str, str](), list[str]()
    with fill_memory():  # what is freed does not keep its content
        for k, (time, instance) in enumerate(_run_varying(subject, {}, gaps)):
            for variable in variables:
                if problem := _describe_string_problem(
                    instance, variable, checks_memory=k % _STEPS_PER_CHANGE == 0
                ):
                    messages.setdefault(variable.name, f"{variable.name} {problem} at t = {time:.9g} s.")
            if not messages and (name := _find_overwritten(instance, [v.name for v in variables])):
                problem = "has another value if all Strings are read in one call"
                messages[name] = f"{name} {problem} at t = {time:.9g} s."
    return list(messages.values()), tuple(gaps)


def _find_overwritten(instance: HostedInstance, names: Sequence[str]) -> str:
    """Return the first String that differs if it is read with others; empty if there is none."""
    pairs = zip(names, instance.get_together(names), instance.get(names), strict=True)
    return next((name for name, joint_value, single_value in pairs if joint_value != single_value), "")


def _describe_string_problem(instance: HostedInstance, variable: ModelVariable, checks_memory: bool) -> str:
    """Return what is wrong with a String, or an empty text. To look where it is takes longest."""
    pointer = (ctypes.c_char_p * 1)()
    with instance.calling():
        reference = (ctypes.c_uint * 1)(variable.valueReference)
        if instance.subject.version == 3:
            instance.fmu.fmi3GetString(instance.fmu.component, reference, 1, pointer, 1)
        else:
            instance.fmu.fmi2GetString(instance.fmu.component, reference, 1, pointer)
    address = ctypes.cast(pointer, ctypes.POINTER(ctypes.c_void_p))[0]
    if address is None:
        return "is a NULL pointer"
    if checks_memory and _is_on_stack(address):
        return "is on the stack of a function that has returned"
    note(f"reading the String {variable.name} that fmi2GetString returned")
    content = ctypes.string_at(address)
    if checks_memory and _is_text_changed(address, content):
        return "changes although no function of the FMU is called: its memory is free"
    try:
        content.decode()
    except UnicodeDecodeError:
        return f"is not UTF-8, but {shorten_sentence(repr(content[:60]))},"
    return ""


def _is_on_stack(address: int) -> bool:
    """Return whether an address is on the stack of this process; False if the system does not tell."""
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return False
    for line in lines:
        if line.endswith("[stack]"):
            low, high = (int(end, 16) for end in line.split()[0].split("-"))
            return low <= address < high
    return False


def _is_text_changed(address: int, text: bytes) -> bool:
    """Return whether a text changes when small blocks of memory are taken, as by any host."""
    library = load_c_library()
    library.malloc.restype = ctypes.c_void_p
    blocks = [library.malloc(ctypes.c_size_t(size)) for size in range(8, 520, 16) for _ in range(9)]
    for k, block in enumerate(blocks):
        ctypes.memset(block, 0x5A, 8 + 16 * (k // 9))
    for block in blocks:
        library.free(ctypes.c_void_p(block))
    return ctypes.string_at(address) != text
