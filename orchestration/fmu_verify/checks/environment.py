"""Check the pointer to the environment, which messages get back."""

import ctypes
from typing import Any

from fmpy import fmi2, fmi3

from emla_cosim.fmu.log import FmuLog

from ..check import CheckOutcome, check, failed, passed, quote, warned
from ..host.experiment import make_experiment, run_instance
from ..host.fresh_process import EndedError, in_fresh_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.log import LOG
from ..subject import Subject

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
        return "", in_fresh_process(_run, subject, is_null, timeout=_TIME_FRACTION * subject.settings.seconds)
    except (CallError, EndedError) as error:
        return str(error), 0


def _run(subject: Subject, is_null: bool) -> int:
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
