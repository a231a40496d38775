"""Check values at the edges of a run: in initialization mode, after its end, and between two steps."""

import math
from collections.abc import Iterator

from ..check import check
from ..host.experiment import make_experiment
from ..host.hosted_instance import HostedInstance
from ..host.instance_runs import list_outputs, step_instance
from ..host.other_values import are_same, choose_other, format_value
from ..messages import judge_problems, list_left_out
from ..subject import Subject
from ..verdict import CheckOutcome, skipped

_STEPS = 5
_MAX_VARIABLES = 300


@check("values.initial", needs=("run.finite",))
def initial(subject: Subject) -> CheckOutcome:
    """Read outputs in initialization mode; those of Clocks may begin with the first tick."""
    instance, course = HostedInstance(subject), make_experiment(subject, 1)
    output_names = [n for n in list_outputs(subject) if not subject.variables[n].clocks]
    names = output_names[:_MAX_VARIABLES]
    tolerance, start = subject.interface.tolerance, float(course.times[0])
    instance.begin_initialization(start, None, tolerance, lambda: instance.set(course.at(0)))
    values = dict(zip(names, instance.get(names), strict=True))
    instance.free()
    infinite = {name: value for name, value in values.items() if not math.isfinite(value)}
    warnings = [f"{name} is {value:g} in initialization mode." for name, value in infinite.items()]
    gaps = list_left_out(len(names), len(output_names), "outputs were read in initialization mode.")
    return judge_problems((), f"{len(names)} outputs are finite in initialization mode.", warnings, gaps)


@check("values.final", needs=("run.finite",))
def final(subject: Subject) -> CheckOutcome:
    """Compare values before and after `fmi2Terminate`."""
    if subject.has_clocks:
        return skipped("Values of clocked variables need not be readable between ticks.")
    instance, course = HostedInstance(subject), make_experiment(subject, _STEPS)
    variables = subject.description.modelVariables
    variable_names = [v.name for v in variables if v.causality in ("output", "input", "parameter")]
    names = variable_names[:_MAX_VARIABLES]
    instance.initialize(course.at(0), float(course.times[0]))
    step_instance(instance, course)
    if instance.terminated:
        return skipped("It asked to end the run.")
    before = instance.get(names)
    instance.terminate()
    after = instance.get(names)
    instance.free()
    changed = [
        f"{name} is {format_value(new)} after fmi2Terminate; before it was {format_value(old)}."
        for name, old, new in zip(names, before, after, strict=True)
        if not are_same(new, old) and not (old != old and new != new)
    ]
    gaps = list_left_out(len(names), len(variable_names), "values were compared.")
    return judge_problems(changed, f"{len(names)} values are the same after fmi2Terminate.", (), gaps)


@check("values.direct", needs=("run.finite",))
def direct(subject: Subject) -> CheckOutcome:
    """Set inputs between steps, and read the outputs that are declared to change with them at once."""
    if subject.kinds[0] != "CoSimulation" or subject.has_clocks:
        return skipped("The FMU is for Model Exchange, or has Clocks.")
    all_pairs = [*_list_pairs(subject)]
    pairs = all_pairs[:_MAX_VARIABLES]
    if not pairs:
        return skipped("No output has a constant or fixed factor of an input.")
    instance, course = HostedInstance(subject), make_experiment(subject, 3)
    instance.initialize(course.at(0), float(course.times[0]))
    step_instance(instance, course)
    warnings = list[str]()
    for known, names in pairs:
        (old,), before = instance.get([known]), instance.get(names)
        variable = subject.variables[known]
        other_value = choose_other(variable)
        is_other = are_same(other_value, old)
        instance.set({known: float(str(variable.start)) if is_other else other_value})
        after = instance.get(names)
        instance.set({known: old})
        warnings += [
            f"{name} stays {format_value(value)} when {known} is set between steps, on which it is declared "
            "to depend by a constant factor."
            for name, value, new in zip(names, before, after, strict=True)
            if value == new
        ]
    instance.free()
    gaps = list_left_out(len(pairs), len(all_pairs), "inputs were set.")
    return judge_problems((), f"Outputs follow {len(pairs)} inputs at once.", warnings, gaps)


def _list_pairs(subject: Subject) -> Iterator[tuple[str, list[str]]]:
    """Yield inputs and the outputs that depend on them by a constant or fixed factor."""
    outputs_by_input = dict[str, list[str]]()
    # elements of arrays of FMI 3.0 have no kinds: each may depend on all others
    for unknown in subject.read_description().outputs:
        if unknown.variable is None:
            continue
        kinds = unknown.dependenciesKind or ()
        for known, kind in zip(unknown.dependencies or (), kinds, strict=False):
            reals = [subject.variables.get(v.name) for v in (known, unknown.variable)]
            if known.causality != "input" or any(v is None or v.type != "Real" for v in reals):
                continue
            if kind in ("constant", "fixed") and choose_other(subject.variables[known.name]) is not None:
                outputs_by_input.setdefault(known.name, []).append(unknown.variable.name)
    yield from outputs_by_input.items()
