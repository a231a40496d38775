"""Check event mode and early return of FMI 3.0 co-simulation."""

import math

from ..check import check
from ..host.event_mode import EventRun
from ..host.experiment import make_experiment
from ..host.fresh_process import in_fresh_process
from ..host.hosted_instance import HostedInstance
from ..host.instance_runs import run_instance
from ..subject import Subject
from ..verdict import CheckOutcome, failed, fmi3, passed, skipped

_STEPS = 100

_UNUSED = fmi3(
    "4.2.1",
    "eventHandlingNeeded = fmi3True must not be signalled, if the importer indicates to not support "
    "EventMode by eventModeUsed = fmi3False.",
)
_ANNOUNCED = fmi3(
    "4.4",
    "If this flag is false, the importer can assume that the FMU computes the fmi3DoStep as instructed up "
    "until currentCommunicationPoint + communicationStepSize.",
)
_REACHED = fmi3("4.2.1", "The time reached is specified in lastSuccessfulTime.")


@check(
    "steps.events",
    "Event mode and early return are used as declared",
    fmi3(
        "4.2", "The state machine in [...] defines the allowed calling sequences for FMI for Co-Simulation."
    ),
    "Handle events inside of fmi3DoStep without event mode. Declare hasEventMode and "
    "mightReturnEarlyFromDoStep.",
    needs=("run.finite",),
    time_factor=2.0,
    only_for=3,
)
def events(subject: Subject) -> CheckOutcome:
    """Check what steps say without event mode, and a run with early return and the declared event mode."""
    if subject.kinds[0] != "CoSimulation":
        return skipped("The FMU is not for Co-Simulation.")
    if claim := in_fresh_process(_claim, subject):
        return failed(claim, clause=_UNUSED)
    has_mode = subject.has_flag("hasEventMode", "CoSimulation")
    run: EventRun = in_fresh_process(_run_with_events, subject, has_mode)
    if run.early is not None and not subject.has_flag("mightReturnEarlyFromDoStep", "CoSimulation"):
        said = (
            f"fmi3DoStep returned early at t = {run.early:.9g} s, but mightReturnEarlyFromDoStep is not set."
        )
        return failed(said, clause=_ANNOUNCED)
    if not has_mode and run.events:
        said = "fmi3DoStep asked for event mode, but hasEventMode is not set."
        return failed(said, clause=_UNUSED)
    if run.astray is not None:
        begin, end, reached = run.astray
        said = f"fmi3DoStep from t = {begin:.9g} s to {end:.9g} s returned early at t = {reached:.9g} s."
        return failed(said, clause=_REACHED)
    with_what = "event mode and early return" if has_mode else "early return"
    early = 0 if run.early is None else run.returns
    return passed(f"{run.steps} steps with {with_what} allowed: {run.events} events, {early} early returns.")


def _claim(subject: Subject) -> str:
    """Return what a step says that a host without event mode does not expect; empty if there is nothing."""
    instance = HostedInstance(subject)
    run_instance(instance, make_experiment(subject, _STEPS))
    return instance.claim


def _run_with_events(subject: Subject, has_mode: bool) -> EventRun:
    instance, course = HostedInstance(subject, events=has_mode, early=True), make_experiment(subject, _STEPS)
    run = EventRun()
    instance.initialize(course.at(0), float(course.times[0]))
    if has_mode:
        run.handle_events(instance)
        run.leave_event_mode(instance)
    for k in range(len(course.times) - 1):
        if has_mode and k:  # discrete inputs change in event mode only
            run.enter_event_mode(instance)
            instance.set(course.at(k))
            run.handle_events(instance)
            run.leave_event_mode(instance)
        elif k:
            instance.set(course.at(k))
        run.step(instance, float(course.times[k]), float(course.times[k + 1]), has_mode)
        if run.terminated or run.astray is not None or not math.isfinite(run.reached):
            break
    instance.close()
    return run
