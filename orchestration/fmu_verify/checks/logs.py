"""Check the log messages of an FMU, and the pointer to the environment that they get."""

import ctypes
import os
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from fmpy import fmi2, fmi3

from emla_cosim.fmu.instance import ERROR, FATAL, OK, STATUS
from emla_cosim.fmu.log import FmuLog, LogLine

from ..check import RETURNS, CheckOutcome, check, failed, noted, passed, quote, unjudged, warned
from ..host.experiment import make_experiment, run_instance
from ..host.hosted_instance import CallError, HostedInstance
from ..host.log import LOG, format_message
from ..host.process_state import load_c_library
from ..messages import list_left_out
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process, in_separate_process, is_single_instance
from .calls import go_to_phase, list_calls_usually_refused

_MOST_CATEGORIES = 6
_ALL = "logAll"
"""The category that section 2.2.4 proposes for all messages."""

# most steps: messages come with events, which may be late
_STEPS = 200

_STEPS_OF_ONE = 50
"""Most steps with one category enabled alone, of which there may be many."""


@check("log.categories", clause=quote("logs.disabled"), needs=("run.completes",), time_factor=2.0)
def categories(subject: Subject) -> CheckOutcome:
    """Check that debug messages are only in enabled categories, and note what is printed.

    Which categories `loggingOn` of fmi2Instantiate enables is left open by the standard. Therefore messages
    count only once categories have been chosen with fmi2SetDebugLogging.
    """
    declared = [str(e.get("name")) for e in subject.tree.iterfind("LogCategories/Category")]
    category_names = [c for c in declared if c != _ALL]
    enabled_alone = category_names[:_MOST_CATEGORIES]
    settings = [(False, []), (True, declared), *((True, [category]) for category in enabled_alone)]
    try:
        (quiet, everything, *messages_of_one), printed = in_fresh_process(_record_messages, subject, settings)
    except CallError as error:
        if error.call == "fmi2SetDebugLogging" and error.has_status and not declared:
            message = f"{error} No category is declared, but the call is part of the interface."
            return warned(message, clause=RETURNS)
        raise
    for line in quiet:
        if line.status == OK:
            return failed(
                f"With debug logging off it logs in {_describe_category(line)}: {format_message(line.text)}"
            )
    for category, lines in zip(enabled_alone, messages_of_one, strict=True):
        for line in lines:
            if line.status == OK and line.category != category:
                where = f"With only {category} enabled it logs in {_describe_category(line)}"
                return failed(f"{where}: {format_message(line.text)}", clause=quote("logs.enabled"))
    undeclared = [line for line in (*quiet, *everything) if line.category not in declared]
    strange = sorted({_describe_category(line) for line in undeclared})
    if strange and declared:
        message = f"It logs in {', '.join(strange)}, which modelDescription.xml does not declare."
        return warned(message, clause=quote("logs.allowed"))
    if printed:
        return noted(f"It writes to standard output: {format_message(printed)}")
    gaps = list_left_out(len(enabled_alone), len(category_names), "categories were enabled alone.")
    message = f"{len(everything)} messages in {len(declared)} categories follow the logging settings."
    return passed(message, gaps=gaps)


@check("log.errors", clause=quote("logs.expected"), needs=("run.completes",), time_factor=2.0)
def errors(subject: Subject) -> CheckOutcome:
    """Check that calls in a wrong phase that are answered with an error send a message, with logging on.

    FMI 3.0 requires it, FMI 2.0 expects it, so that it is noted there.
    """
    silent, refused = [], 0
    calls = list_calls_usually_refused(subject)
    for call, (status, is_explained) in zip(calls, _collect_answers(subject), strict=True):
        if status in (ERROR, FATAL):
            refused += 1
            silent += [] if is_explained else [f"{call.function} {call.phase}"]
    if silent:
        judge = warned if subject.version == 3 else noted
        message = f"{len(silent)} of {refused} calls returned {STATUS[ERROR]} without a message: {silent[0]}."
        details = tuple(f"{call} returned an error without a message." for call in silent)
        return judge(message, details=details)
    if not refused:
        return unjudged(
            "No call in a wrong phase is refused: whether errors come with a message is not known."
        )
    return passed(f"{refused} errors came with a message.")


_Answer = tuple[int, bool]
"""The status of a call in a wrong phase, and whether a message came."""


def _collect_answers(subject: Subject) -> list[_Answer]:
    """Return the answers to all calls; each call has a process of its own if they do harm in one."""
    numbers = range(len(list_calls_usually_refused(subject)))
    if not is_single_instance(subject):
        with suppress(CallError, EndedError):
            return in_fresh_process(_call_all, subject, numbers)
    answers = [(OK, False)] * len(numbers)
    for number in numbers:
        with suppress(CallError, EndedError):  # other checks report it
            answers[number] = in_fresh_process(_call_in_phase, subject, number)
    return answers


def _call_all(subject: Subject, numbers: Sequence[int]) -> list[_Answer]:
    return [_call_in_phase(subject, number) for number in numbers]


def _call_in_phase(subject: Subject, number: int) -> _Answer:
    """Return the answer to one of the calls that are usually refused, by its position in their list."""
    call = list_calls_usually_refused(subject)[number]
    instance = HostedInstance(subject, logging=True)
    go_to_phase(instance, call.phase)
    LOG.lines.clear()
    status = call.call(instance)
    is_explained = any(line.status > OK and line.text for line in LOG.lines)
    if status != FATAL:
        instance.free()
    return status, is_explained


def _describe_category(line: LogLine) -> str:
    return f"category {line.category!r}" if line.category else "no category"


def _record_messages(
    subject: Subject, settings: Sequence[tuple[bool, list[str]]]
) -> tuple[list[list[LogLine]], str]:
    """Return the messages of a short run with each logging setting, and the first line that is printed.

    Standard output of this process goes to a temporary file from then on.
    """
    with tempfile.TemporaryFile() as stream:
        os.dup2(stream.fileno(), 1)
        messages = [
            in_separate_process(_run_with_logging, subject, logging, names) for logging, names in settings
        ]
        if sys.stdout is not None:
            sys.stdout.flush()
        load_c_library().fflush(None)
        stream.seek(0)
        text = stream.read().decode(errors="replace").strip()
    return messages, text.partition("\n")[0]


def _run_with_logging(subject: Subject, logging: bool, names: list[str]) -> list[LogLine]:
    """Return the messages of a short run, with logging those after the categories were set."""
    LOG.lines.clear()
    steps = _STEPS if len(names) != 1 else _STEPS_OF_ONE
    instance, course = HostedInstance(subject, logging=logging), make_experiment(subject, steps)
    instance.set_debug_logging(logging, names)
    if logging:
        LOG.lines.clear()
    run_instance(instance, course)
    instance.close()
    return list(LOG.lines)


_TIME_FRACTION = 0.25
"""Part of the time limit for each of the two runs."""


@check("instance.environment", needs=("binaries.loads",))
def environment(subject: Subject) -> CheckOutcome:
    """Run a step with NULL and with another pointer, and look at what the logger gets.

    What goes wrong in the same way with both is left to other checks.
    """
    if subject.kinds[0] == "ScheduledExecution" or subject.has_clocks:
        message = "Whether it also runs with a pointer to an environment was not compared: it has Clocks."
        return passed("Other checks run it with NULL.", gaps=(message,))
    problem_with_null, _ = _run_one_step(subject, is_null=True)
    problem, wrong_messages = _run_one_step(subject, is_null=False)
    if problem_with_null and not problem:
        return failed(f"It runs with a pointer to an environment, but not with NULL. {problem_with_null}")
    if problem and not problem_with_null:
        return failed(f"It runs with NULL, but not with a pointer to an environment. {problem}")
    if problem_with_null:
        message = "It does not run with NULL, nor with a pointer to an environment."
        return passed(message, gaps=(problem_with_null,))
    if wrong_messages:
        message = f"{wrong_messages} messages came with another pointer than that of their environment."
        return warned(message, clause=quote("environment.passed_on").of(subject.version))
    return passed("It does the same with NULL and with a pointer to an environment.")


def _run_one_step(subject: Subject, is_null: bool) -> tuple[str, int]:
    """Return how a run ended, empty if well, and how many messages came with another pointer."""
    try:
        return "", in_fresh_process(
            _run_with_pointer, subject, is_null, timeout=_TIME_FRACTION * subject.settings.seconds
        )
    except (CallError, EndedError) as error:
        return str(error), 0


def _run_with_pointer(subject: Subject, is_null: bool) -> int:
    """Run a step in this process, which nothing else uses; return the number of wrong messages."""
    environment_block = ctypes.create_string_buffer(4096)
    pointer = None if is_null else ctypes.addressof(environment_block)
    wrong_messages = 0

    def on_message(environment: int | None, *_: Any) -> None:
        nonlocal wrong_messages
        wrong_messages += environment != pointer

    logger = fmi2.fmi2CallbackLoggerTYPE(on_message)
    LOG.callbacks.componentEnvironment, LOG.callbacks.logger = pointer, logger
    fmi3.fmi3InstanceEnvironment = lambda: ctypes.c_void_p(pointer)  # fmpy (0.3.32) passes NULL
    setattr(FmuLog, "hear", on_message)  # noqa: B010 - of FMI 3.0
    instance = HostedInstance(subject, logging=True)
    run_instance(instance, make_experiment(subject, 1))
    instance.close()
    return wrong_messages
