"""Check event mode and early return of FMI 3.0 co-simulation, and that iterations end."""

from typing import NamedTuple

from ..check import CheckOutcome, blocked, check, failed, passed, quote, skipped
from ..host.experiment import keep_run, make_experiment, run_instance
from ..host.hosted_instance import RETURNS_EARLY, CallError, EndlessIterationError, HostedInstance
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process

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
    """Run an instance that may return early from steps, and use event mode if it has it."""
    instance = HostedInstance(subject, events=has_mode, allows_early_return=True)
    run_instance(instance, make_experiment(subject, _STEPS))
    instance.close()
    events = instance.events
    assert events is not None
    return _EventRun(events.steps, events.events, events.returns, events.first_early_return)


NAME = "events.iteration"


@check(NAME, needs=("instance.created",), time_factor=2.0)
def iteration(subject: Subject) -> CheckOutcome:
    """Run the FMU with its events, and look whether updates of discrete states ask for more without end."""
    has_mode = subject.version == 3 and subject.has_flag("hasEventMode", "CoSimulation")
    kinds = [k for k in subject.run_kinds if k == "ModelExchange" or (k == "CoSimulation" and has_mode)]
    if not kinds:
        return skipped("It has no event mode.")
    gaps = list[str]()
    for kind in kinds:
        try:
            if where := in_fresh_process(_find_endless_iteration, subject, kind):
                return failed(f"The event iteration {where} does not end: each update asks for another one.")
        except (CallError, EndedError) as error:  # other checks report it
            gaps.append(f"Event iterations as {kind} were looked at only until a call went wrong. {error}")
    return passed("All event iterations that were seen end.", gaps=tuple(gaps))


def make_endless_outcome(error: CallError) -> CheckOutcome:
    """Return the outcome of a check that needs event iterations to end; raise errors of another kind."""
    if not isinstance(error, EndlessIterationError):
        raise error
    return blocked(f"It needs {NAME}, which failed.")


def _find_endless_iteration(subject: Subject, kind: str) -> str:
    """Return where an event iteration does not end; empty if all do. Keep the run for other checks."""
    uses_mode = True if kind == "CoSimulation" else None
    instance, course = HostedInstance(subject, kind=kind, events=uses_mode), make_experiment(subject)
    try:
        trajectory = run_instance(instance, course)
    except EndlessIterationError:
        start = instance.step_began
        return "of the initialization" if start is None else f"in the step from t = {start:.9g} s"
    if kind == "ModelExchange" or subject.has_clocks:  # other checks run it with the same options
        keep_run(subject, course, kind, trajectory)
    return ""
