"""Checks of Model Exchange: integration, and agreement with Co-Simulation."""

from ..check import check
from ..host.experiment import make_experiment
from ..host.hosted_instance import CallError, HostedInstance
from ..host.instance_runs import run_alone, run_instance
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, fmi3, noted, own_rule, passed, skipped
from ._sameness import differing
from .iteration import explain_endless

_WITH_CLOCKS = "Models with Clocks are not integrated; their co-simulation is examined."


@check(
    "model_exchange.runs",
    "The model can be integrated",
    Clause(
        "3.2.3",
        "Every implementation of the FMI must support calling sequences of the functions according to the "
        "following state chart",
        in_3=fmi3(
            "3.2",
            "The state machine in [...] defines the allowed calling sequences for FMI for Model Exchange.",
        ),
    ),
    "Integrate the model with another tool and look at the call that fails.",
    needs=("instance.created",),
    time_factor=2.0,
)
def runs(subject: Subject) -> CheckOutcome:
    """Check that the model can be initialized, integrated with events, terminated and freed."""
    if "ModelExchange" not in subject.kinds:
        return skipped("The FMU is not for Model Exchange.")
    if subject.has_clocks:
        return skipped(_WITH_CLOCKS, gaps=(_WITH_CLOCKS,))
    instance, course = HostedInstance(subject, kind="ModelExchange"), make_experiment(subject)
    try:
        found = run_instance(instance, course)
    except CallError as error:
        return explain_endless(error)
    instance.close()
    states = len(subject.description.derivatives)
    return passed(f"{states} states were integrated to t = {found.times[-1]:.9g} s.")


@check(
    "model_exchange.agrees",
    "Model Exchange and Co-Simulation agree",
    own_rule("model_exchange.agrees", "Both kinds give the same outputs. The standard does not require it."),
    "Integrate with shorter internal steps, or document how the two differ.",
    needs=("model_exchange.runs", "run.finite"),
    time_factor=3.0,
)
def agrees(subject: Subject) -> CheckOutcome:
    """Note outputs that differ between both kinds: the standard does not require that they agree."""
    if "CoSimulation" not in subject.kinds:
        return skipped("The FMU is not for Co-Simulation.")
    slave, model = run_alone(subject, kind="CoSimulation"), run_alone(subject, kind="ModelExchange")
    rows = min(len(slave.times), len(model.times))  # one may end the run early
    far, most = differing(model, slave, rows)
    if far:
        lines = tuple(f"{line}." for line in far)
        return noted(
            f"{len(far)} of {len(slave.names)} outputs differ between Model Exchange and Co-Simulation: "
            f"{lines[0]}",
            details=lines,
        )
    return passed(f"Both kinds agree within {most:.1g} of each output's range.")
