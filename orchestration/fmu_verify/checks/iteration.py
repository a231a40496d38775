"""Check that event iterations end."""

from ..check import check
from ..host.experiment import make_experiment
from ..host.fresh_process import EndedError, in_fresh_process
from ..host.hosted_instance import CallError, EndlessIterationError, HostedInstance
from ..host.instance_runs import keep_run, run_instance
from ..subject import Subject
from ..verdict import CheckOutcome, blocked, failed, passed, skipped

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
            if where := in_fresh_process(_find_endless, subject, kind):
                return failed(f"The event iteration {where} does not end: each update asks for another one.")
        except (CallError, EndedError) as error:  # other checks report it
            gaps.append(f"Event iterations as {kind} were looked at only until a call went wrong. {error}")
    return passed("All event iterations that were seen end.", gaps=tuple(gaps))


def explain_endless(error: CallError) -> CheckOutcome:
    """Return the outcome of a check that needs event iterations to end; raise errors of another kind."""
    if not isinstance(error, EndlessIterationError):
        raise error
    return blocked(f"It needs {NAME}, which failed.")


def _find_endless(subject: Subject, kind: str) -> str:
    """Return where an event iteration does not end; empty if all do."""
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
