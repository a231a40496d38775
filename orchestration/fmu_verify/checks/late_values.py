"""Check that values which are set after initialization have an effect."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from fmpy.model_description import ModelVariable

from emla_cosim.base.wording import format_count

from ..check import check
from ..host.experiment import span
from ..host.fresh_process import in_separate_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.other_values import other_of, same, settable, show
from ..messages import join_few_names, judge_problems, list_left_out
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, skipped
from ._clauses import KEPT
from ._steps import walk
from ._time import take_in_time

_STEPS = 6
_MORE_STEPS = 60
"""Steps of a longer run, before a value counts as one without effect: a controller may sample rarely."""

_WHEN = (1, 2, 3)
"""Steps before which a value is set."""

_MOST = 100
_MOST_RESULTS = 300

Rows = list[list[str]]


class _Late(NamedTuple):
    """What is wrong with a variable: it lacks an effect, or has it some steps later than at the start."""

    name: str
    delay: int | None


@check(
    "values.late",
    "Values that are set between steps have an effect",
    Clause(
        "2.2.7",
        'Whenever a parameter or input signal with variability = "tunable" changes, an event is triggered '
        "externally (ModelExchange), or the change is performed at the next Communication Point "
        "(Co-Simulation)",
        in_3=KEPT,
    ),
    "Compute with the present value of each input and tunable parameter in each step, not with a copy of it.",
    needs=("run.deterministic", "run.finite"),
    time_factor=3.0,
)
def late(subject: Subject) -> CheckOutcome:
    """Set each input and tunable parameter after some steps, if it has an effect when it is set at first.

    Values are compared with those that were set, and results with a run without the change.
    """
    every = [
        v
        for v in settable(subject, "input", "parameter", tunable=True, most=None)
        if other_of(v) is not None and not v.clocks
    ]
    every_result = _list_results(subject)
    results = every_result[:_MOST_RESULTS]
    if not every or not results:
        return skipped("It has no tunable parameter and no input with another valid value, or no output.")
    judged, found, lost = 0, list[_Late](), list[str]()
    plain = in_separate_process(_run, subject, results, None, 0, _STEPS)[0]
    for variable in take_in_time(every[:_MOST], subject.settings.seconds):
        with suppress(CallError):  # the model does not bear this value
            found += _look(subject, variable, results, plain, lost)
            judged += 1
    gaps = list_left_out(judged, len(every), "inputs and tunable parameters were set between steps.")
    gaps += list_left_out(len(results), len(every_result), "outputs and derivatives were compared.")
    without = [one.name for one in found if one.delay is None]
    problems = list(lost)
    if without:
        problems.append(
            f"{join_few_names(without)} changes nothing if it is set after initialization, although it does "
            "if it is set before."
        )
    problems += [
        f"{one.name} has its effect {format_count(one.delay, 'step', 'steps')} later if it is set between "
        "steps than at the start."
        for one in found
        if one.delay is not None
    ]
    fine = f"Of {judged} inputs and tunable parameters, all that have an effect at the start have it later."
    return judge_problems((), fine, problems, gaps)


def _list_results(subject: Subject) -> list[str]:
    """Return outputs of all types, and state derivatives."""
    found = subject.description.modelVariables
    names = [v.name for v in found if v.causality == "output" and not v.clocks]
    slopes = [v.name for v in found if v.derivative is not None]
    return list(dict.fromkeys([*names, *slopes]))


def _look(
    subject: Subject, variable: ModelVariable, results: list[str], plain: Rows, lost: list[str]
) -> Iterator[_Late]:
    """Yield what is wrong with a variable; `lost` gets it if its value is not kept."""
    first = in_separate_process(_run, subject, results, variable, 0, _STEPS)[0]
    at_start = _find_effect(first, plain, 0)
    if at_start is None or not any(one != two for one, two in zip(first[2:], plain[2:], strict=False)):
        return  # nothing, or only in initial values that vanish
    delays = list[int | None]()
    for when in _WHEN:
        rows, value = in_separate_process(_run, subject, results, variable, when, _STEPS)
        if when == _WHEN[0] and not same(value, other_of(variable)):
            lost.append(
                f"{variable.name} is {show(value)} after it was set to {show(other_of(variable))} later."
            )
            return
        delays.append(_find_effect(rows, plain, when))
    if set(delays) == {None}:
        longer = in_separate_process(_run, subject, results, None, 0, _MORE_STEPS)[0]
        rows, _ = in_separate_process(_run, subject, results, variable, _WHEN[0], _MORE_STEPS)
        if _find_effect(rows, longer, _WHEN[0]) is None and len(rows) > _STEPS:
            yield _Late(variable.name, None)
        return
    (delay, *others) = delays
    # one that samples its inputs rarely has other delays after each step
    if delay is not None and others == [delay] * len(others) and delay > max(at_start, 1):
        yield _Late(variable.name, delay - max(at_start, 1))


def _find_effect(rows: Rows, plain: Rows, when: int) -> int | None:
    """Return the number of steps after which rows differ, counted from a step; None if they do not."""
    for k, (one, two) in enumerate(zip(rows, plain, strict=False)):
        if one != two:
            return k - when
    return None


def _run(
    subject: Subject, results: list[str], variable: ModelVariable | None, when: int, steps: int
) -> tuple[Rows, Any]:
    """Return results after initialization and each step, and the value of a variable after it was set.

    It is set before the step `when`, counted from 0; before initialization for 0.
    """
    start, step, count = span(subject)
    changes = {} if variable is None else {variable.name: other_of(variable)}
    instance = HostedInstance(subject)
    instance.initialize(changes if when == 0 else None, start)
    rows, values = [[str(v) for v in instance.get(results)]], [None]

    def change(k: int) -> None:
        if k == when and changes and k:
            instance.set(changes)
            values[:] = instance.get(list(changes))

    times = (start + k * step for k in range(min(count, steps, subject.most_steps)))
    rows += [[str(v) for v in instance.get(results)] for _ in walk(instance, times, step, change)]
    instance.free()
    return rows, values[0]
