"""Check values at the edges of a run: in initialization mode, after its end, and between two steps."""

import math
from collections.abc import Iterator
from typing import Any

from ..check import check
from ..host.experiment import make_experiment
from ..host.hosted_instance import HostedInstance
from ..host.instance_runs import outputs, step_instance
from ..host.other_values import other_of, same, show
from ..messages import judge_problems, list_left_out
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, fmi3, own_rule, skipped

_STEPS = 5
_MOST = 300


@check(
    "values.initial",
    "Outputs are finite in initialization mode",
    Clause(
        "4.2.4",
        "Note that in Initialization Mode input variables can be set with fmi2SetXXX and output variables "
        "can be retrieved with fmi2GetXXX interleaved",
        in_3=fmi3("2.2.4", "The output argument values are defined."),
    ),
    "Compute outputs in initialization mode from start values and inputs: hosts read them to solve loops.",
    needs=("run.finite",),
)
def initial(subject: Subject) -> CheckOutcome:
    """Read outputs in initialization mode; those of Clocks may begin with the first tick."""
    instance, course = HostedInstance(subject), make_experiment(subject, 1)
    every = [n for n in outputs(subject) if not subject.variables[n].clocks]
    names = every[:_MOST]
    tolerance, start = subject.interface.tolerance, float(course.times[0])
    instance.begin_initialization(start, None, tolerance, lambda: instance.set(course.at(0)))
    found = dict(zip(names, instance.get(names), strict=True))
    instance.free()
    wrong = [
        f"{name} is {value:g} in initialization mode."
        for name, value in found.items()
        if not math.isfinite(value)
    ]
    gaps = list_left_out(len(names), len(every), "outputs were read in initialization mode.")
    return judge_problems((), f"{len(names)} outputs are finite in initialization mode.", wrong, gaps)


@check(
    "values.final",
    "Values stay after the end of a run",
    Clause(
        "2.1.6",
        "After calling this function, the final values of all variables can be inquired with the "
        "fmi2GetXXX(..) functions.",
        in_3=fmi3(
            "2.3.8",
            "In this state, the final values of all variables at the final time of a simulation can be "
            "retrieved.",
        ),
    ),
    "Keep all values in fmi2Terminate; free them in fmi2FreeInstance.",
    needs=("run.finite",),
)
def final(subject: Subject) -> CheckOutcome:
    """Compare values before and after `fmi2Terminate`."""
    if subject.has_clocks:
        return skipped("Values of clocked variables need not be readable between ticks.")
    instance, course = HostedInstance(subject), make_experiment(subject, _STEPS)
    every = [
        v.name for v in subject.description.modelVariables if v.causality in ("output", "input", "parameter")
    ]
    names = every[:_MOST]
    instance.initialize(course.at(0), float(course.times[0]))
    step_instance(instance, course)
    if instance.terminated:
        return skipped("It asked to end the run.")
    before = instance.get(names)
    instance.terminate()
    after = instance.get(names)
    instance.free()
    changed = [
        f"{name} is {show(new)} after fmi2Terminate; before it was {show(old)}."
        for name, old, new in zip(names, before, after, strict=True)
        if not same(new, old) and not (old != old and new != new)
    ]
    gaps = list_left_out(len(names), len(every), "values were compared.")
    return judge_problems(changed, f"{len(names)} values are the same after fmi2Terminate.", (), gaps)


@check(
    "values.direct",
    "Outputs follow inputs that they directly depend on",
    Clause(
        "2.2.8",
        "Attribute dependencies defines the dependencies of the outputs from the knowns at the current super "
        "dense time instant in Event and in Continuous-Time Mode (ModelExchange) and at the current "
        "Communication Point (CoSimulation).",
        in_3=own_rule(
            "values.direct",
            "An output with a constant or fixed factor of an input changes with it at a communication point.",
        ),
    ),
    "Compute the output in fmi2GetXXX from the present input, or remove the input from its dependencies.",
    needs=("run.finite",),
)
def direct(subject: Subject) -> CheckOutcome:
    """Set inputs between steps, and read the outputs that are declared to change with them at once."""
    if subject.kinds[0] != "CoSimulation" or subject.has_clocks:
        return skipped("The FMU is for Model Exchange, or has Clocks.")
    every = [*_list_pairs(subject)]
    pairs = every[:_MOST]
    if not pairs:
        return skipped("No output has a constant or fixed factor of an input.")
    instance, course = HostedInstance(subject), make_experiment(subject, 3)
    instance.initialize(course.at(0), float(course.times[0]))
    step_instance(instance, course)
    late = list[str]()
    for known, names in pairs:
        (old,), before = instance.get([known]), instance.get(names)
        instance.set({known: _other(subject, known, old)})
        after = instance.get(names)
        instance.set({known: old})
        late += [
            f"{name} stays {show(value)} when {known} is set between steps, on which it is declared to "
            "depend by a constant factor."
            for name, value, new in zip(names, before, after, strict=True)
            if value == new
        ]
    instance.free()
    gaps = list_left_out(len(pairs), len(every), "inputs were set.")
    return judge_problems((), f"Outputs follow {len(pairs)} inputs at once.", late, gaps)


def _other(subject: Subject, name: str, value: Any) -> Any:
    """Return the start value, another one, whichever is not the present value."""
    variable = subject.variables[name]
    other = other_of(variable)
    return float(str(variable.start)) if same(other, value) else other


def _list_pairs(subject: Subject) -> Iterator[tuple[str, list[str]]]:
    """Yield inputs and the outputs that depend on them by a constant or fixed factor."""
    found = dict[str, list[str]]()
    # elements of arrays of FMI 3.0 have no kinds: each may depend on all others
    for unknown in subject.read_description().outputs:
        if unknown.variable is None:
            continue
        kinds = unknown.dependenciesKind or ()
        for known, kind in zip(unknown.dependencies or (), kinds, strict=False):
            reals = [subject.variables.get(v.name) for v in (known, unknown.variable)]
            if known.causality != "input" or any(v is None or v.type != "Real" for v in reals):
                continue
            if kind in ("constant", "fixed") and other_of(subject.variables[known.name]) is not None:
                found.setdefault(known.name, []).append(unknown.variable.name)
    yield from found.items()
