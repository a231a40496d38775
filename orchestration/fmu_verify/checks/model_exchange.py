"""Checks of Model Exchange: integration, and agreement with Co-Simulation."""

import numpy as np

from ..check import check
from ..host.experiment import FEWEST_STEPS, Experiment, make_experiment, read_span
from ..host.hosted_instance import CallError, HostedInstance
from ..host.instance_runs import run_alone, run_instance
from ..messages import judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, noted, passed, skipped, unjudged
from ._sameness import describe_differences
from .iteration import explain_endless

_WITH_CLOCKS = "Models with Clocks are not integrated; their co-simulation is examined."


@check("model_exchange.runs", needs=("instance.created",), time_factor=2.0)
def runs(subject: Subject) -> CheckOutcome:
    """Check that the model can be initialized, integrated with events, terminated and freed."""
    if "ModelExchange" not in subject.kinds:
        return skipped("The FMU is not for Model Exchange.")
    if subject.has_clocks:
        return unjudged(_WITH_CLOCKS)
    try:
        trajectory = run_alone(subject, kind="ModelExchange")
    except CallError as error:
        return explain_endless(error)
    instance = HostedInstance(subject, kind="ModelExchange")
    run_instance(instance, make_experiment(subject, FEWEST_STEPS))
    instance.close()
    states = len(subject.description.derivatives)
    return passed(f"{states} states were integrated to t = {trajectory.times[-1]:.9g} s.")


@check("model_exchange.split", needs=("model_exchange.runs",), time_factor=3.0)
def split(subject: Subject) -> CheckOutcome:
    """Compare a run with one that enters event mode more often.

    Events near a communication point may fall on either side of it, so only many different rows count.
    """
    course = make_experiment(subject)
    inputs = {name: np.full(len(course.times), v[0]) for name, v in course.inputs.items()}
    start, step, count = read_span(subject)
    stride = step * max(1, count // (len(course.times) - 1))
    times = start + stride * np.arange(float(len(course.times)))
    frequent = run_alone(subject, Experiment(times, inputs), "ModelExchange")
    rare_inputs = {name: v[::_STRIDE] for name, v in inputs.items()}
    rare_times = start + _STRIDE * stride * np.arange(float(len(times[::_STRIDE])))
    rare = run_alone(subject, Experiment(rare_times, rare_inputs), "ModelExchange")
    # the FMU may end one of the runs early
    rows = min(len(rare.times), len(frequent.times[::_STRIDE]))
    frequent_values, rare_values = frequent.values[::_STRIDE][:rows], rare.values[:rows]
    scale = np.maximum(np.ptp(frequent_values, axis=0), np.ptp(rare_values, axis=0))
    different_fraction = (np.abs(frequent_values - rare_values) > _MAX_DIFFERENCE * scale).mean(axis=0)
    where = "where the host enters event mode"
    lines = [
        f"{name} differs in {part:.0%} of the rows {where} more often, with constant inputs."
        for name, part in zip(frequent.names, different_fraction, strict=True)
        if part > _MAX_DIFFERENT_FRACTION
    ]
    fine = f"{len(frequent.names)} outputs are the same {where} {_STRIDE} times as often."
    return judge_problems((), fine, lines)


_STRIDE = 5
_MAX_DIFFERENCE = 5e-3
_MAX_DIFFERENT_FRACTION = 0.3


@check("model_exchange.agrees", needs=("model_exchange.runs", "run.finite"), time_factor=3.0)
def agrees(subject: Subject) -> CheckOutcome:
    """Note outputs that differ between both kinds: the standard does not require that they agree."""
    if "CoSimulation" not in subject.kinds:
        return skipped("The FMU is not for Co-Simulation.")
    slave, model = run_alone(subject, kind="CoSimulation"), run_alone(subject, kind="ModelExchange")
    rows = min(len(slave.times), len(model.times))  # one may end the run early
    far, most = describe_differences(model, slave, rows)
    if far:
        lines = tuple(f"{line}." for line in far)
        message = f"{len(far)} of {len(slave.names)} outputs differ between Model Exchange and Co-Simulation"
        return noted(f"{message}: {lines[0]}", details=lines)
    return passed(f"Both kinds agree within {most:.1g} of each output's range.")
