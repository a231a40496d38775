"""Check event mode and early return of FMI 3.0 co-simulation."""

from typing import NamedTuple

from ..check import check
from ..host.experiment import make_experiment
from ..host.fresh_process import in_fresh_process
from ..host.hosted_instance import RETURNS_EARLY, HostedInstance
from ..host.instance_runs import run_instance
from ..subject import Subject
from ..verdict import CheckOutcome, failed, passed, quote, skipped

_STEPS = 100

_UNUSED = quote("events.unused")


class _EventRun(NamedTuple):
    """The numbers of steps, events and early returns of a run; the time in s of the first early return."""

    steps: int
    events: int
    returns: int
    first_early_return: float | None


@check("steps.events", needs=("run.finite",), time_factor=2.0, only_for=3)
def events(subject: Subject) -> CheckOutcome:
    """Check what steps say without event mode, and a run with early return and the declared event mode."""
    if subject.kinds[0] != "CoSimulation":
        return skipped("The FMU is not for Co-Simulation.")
    if problem := in_fresh_process(_find_unexpected_event, subject):
        return failed(problem, clause=_UNUSED)
    has_mode = subject.has_flag("hasEventMode", "CoSimulation")
    run: _EventRun = in_fresh_process(_run_with_events, subject, has_mode)
    if run.first_early_return is not None and not subject.has_flag(RETURNS_EARLY, "CoSimulation"):
        at = f"t = {run.first_early_return:.9g} s"
        message = f"fmi3DoStep returned early at {at}, but {RETURNS_EARLY} is not set."
        return failed(message, clause=quote("events.announced"))
    if not has_mode and run.events:
        message = "fmi3DoStep asked for event mode, but hasEventMode is not set."
        return failed(message, clause=_UNUSED)
    allowed = "event mode and early return" if has_mode else "early return"
    message = f"{run.steps} steps with {allowed} allowed: {run.events} events, {run.returns} early returns."
    return passed(message)


def _find_unexpected_event(subject: Subject) -> str:
    """Return what a step says that a host without event mode does not expect; empty if there is nothing."""
    instance = HostedInstance(subject)
    run_instance(instance, make_experiment(subject, _STEPS))
    return instance.unexpected_event


def _run_with_events(subject: Subject, has_mode: bool) -> _EventRun:
    instance = HostedInstance(subject, events=has_mode, allows_early_return=True)
    run_instance(instance, make_experiment(subject, _STEPS))
    instance.close()
    events = instance.events
    assert events is not None
    return _EventRun(events.steps, events.events, events.returns, events.first_early_return)
