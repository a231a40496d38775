"""Check that a run does not depend on the order of values and the length of steps."""

from collections.abc import Sequence

import numpy as np

from ..check import check
from ..host.experiment import MOST_STEPS, Experiment, make_experiment
from ..host.fresh_process import in_fresh_process
from ..host.hosted_instance import HostedInstance
from ..host.instance_runs import OutputTrajectory, list_outputs, run_alone, walk
from ..messages import join_few_names
from ..subject import Subject
from ..verdict import CheckOutcome, Verdict, noted, passed, quote, skipped, warned
from ._sameness import compare_runs, describe_differences

_MOST_CALLS, _FEWEST_STEPS = 50_000, 2
"""Most calls of a run with values exchanged one by one, and its fewest steps."""


@check("exchange.order", needs=("run.deterministic",), time_factor=4.0)
def order(subject: Subject) -> CheckOutcome:
    """Check that setting inputs and reading outputs one by one, in both orders, gives the same run."""
    steps = _MOST_CALLS // (len(subject.of_causality("input", "output")) or 1)
    course = make_experiment(subject, min(max(steps, _FEWEST_STEPS), MOST_STEPS))
    expected = run_alone(subject, course)
    for description, backwards in (("one by one", False), ("one by one in reverse", True)):
        actual = in_fresh_process(_run_one_by_one, subject, course, backwards)
        outcome = compare_runs(actual, expected, f"A run with values exchanged {description}")
        if outcome.verdict != Verdict.PASSED:
            return outcome
    return passed(f"Exchanging values one by one, in both orders, gave the same {len(expected.times)} rows.")


def _run_one_by_one(subject: Subject, course: Experiment, backwards: bool) -> OutputTrajectory:
    instance, names = HostedInstance(subject), list_outputs(subject)

    def order_of(all_names: Sequence[str]) -> list[str]:
        return list(all_names)[::-1] if backwards else list(all_names)

    def set_inputs(k: int) -> None:
        values = course.at(k)
        for name in order_of(list(values)):
            instance.set({name: values[name]})

    def read_outputs() -> list[float]:
        first = {n: instance.get([n])[0] for n in order_of(names)}
        values_read_last = {n: instance.get([n])[0] for n in order_of(names)} if backwards else first
        return [values_read_last[n] for n in names]

    set_inputs(0)
    instance.initialize(None, float(course.times[0]))
    rows = [read_outputs()]
    rows += [read_outputs() for _ in walk(instance, course.times[:-1], course.step, set_inputs)]
    values = np.array(rows, dtype=float).reshape(len(rows), len(names))
    return OutputTrajectory(course.times[: len(rows)], names, values)


@check("steps.split", needs=("run.deterministic", "run.finite"), time_factor=4.0)
def split(subject: Subject) -> CheckOutcome:
    """Check that half steps with held inputs work, and note outputs that do not end where whole ones do."""
    if subject.kinds[0] != "CoSimulation":
        return skipped("The FMU is for Model Exchange: the host integrates it.")
    if not subject.has_capability("canHandleVariableCommunicationStepSize"):
        return skipped("canHandleVariableCommunicationStepSize is not set.")
    course = make_experiment(subject)
    times = course.times[0] + 0.5 * course.step * np.arange(2 * len(course.times) - 1)
    held_inputs = {name: np.repeat(v, 2)[:-1] for name, v in course.inputs.items()}  # for two half steps
    full_steps, half_steps = run_alone(subject, course), run_alone(subject, Experiment(times, held_inputs))
    rows = min(len(full_steps.times), (len(half_steps.times) + 1) // 2)  # the FMU may end the run early
    values = half_steps.values[: 2 * rows : 2]
    every_other = OutputTrajectory(full_steps.times[:rows], full_steps.names, values)
    different, most = describe_differences(full_steps, every_other, rows)
    if different and (same := _list_without_size(subject, course)):
        names = join_few_names(same)
        count = _STEPS_WITHOUT_INPUTS
        message = f"These are the same after {count} half steps as after {count} whole ones: {names}."
        return warned(message, clause=quote("exchange.size"))
    if different:
        lines = tuple(f"{line} with half steps." for line in different)
        # the standard does not require it, and a state may be sampled once per step on purpose
        return noted(
            f"{len(different)} of {len(full_steps.names)} outputs depend on the step size: {lines[0]}",
            details=lines,
        )
    return passed(f"Half steps and whole steps agree within {most:.1g} of each output's range.")


_STEPS_WITHOUT_INPUTS = 20


def _list_without_size(subject: Subject, course: Experiment) -> list[str]:
    """Return continuous outputs that change as much in half steps as in whole ones, with constant inputs."""
    inputs = {name: np.full(_STEPS_WITHOUT_INPUTS + 1, v[0]) for name, v in course.inputs.items()}
    full_steps, half_steps = (
        run_alone(
            subject,
            Experiment(course.times[0] + np.arange(_STEPS_WITHOUT_INPUTS + 1) * part * course.step, inputs),
        )
        for part in (1.0, 0.5)
    )
    if len(full_steps.times) != len(half_steps.times):
        return []
    is_moving = np.mean(np.diff(full_steps.values, axis=0) != 0.0, axis=0) > 0.5
    is_close = np.isclose(full_steps.values, half_steps.values, rtol=1e-9, atol=0.0).all(axis=0)
    return [
        name
        for name, is_same in zip(full_steps.names, is_moving & is_close, strict=True)
        if is_same and subject.variables[name].variability in (None, "continuous")
    ]
