"""The default experiment."""

import math
from collections.abc import Iterator, Mapping

from ..check import check
from ..messages import judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, skipped


@check(
    "description.experiment",
    "The default experiment can be run",
    Clause(
        "2.2.5",
        "However, it is convenient for a user that startTime, stopTime, tolerance and stepSize have already "
        "a meaningful default value for the model at hand.",
    ),
    "Give a start before the stop, and a step and a tolerance above zero.",
    needs=("description.schema",),
)
def experiment(subject: Subject) -> CheckOutcome:
    """Its times are numbers, it stops after it starts, and its step is positive."""
    element = subject.tree.find("DefaultExperiment")
    if element is None:
        return skipped("It has no default experiment.")
    given = {name: float(text) for name, text in element.attrib.items()}
    fine = ", ".join(f"{name} {value:g}" for name, value in given.items())
    return judge_problems((), f"It has {fine or 'nothing said'}.", list(_doubts(given)))


def _doubts(given: Mapping[str, float]) -> Iterator[str]:
    for name, value in given.items():
        if not math.isfinite(value):
            yield f"{name} is {value}, which is no number."
    start, stop = given.get("startTime", 0.0), given.get("stopTime", math.inf)
    if stop <= start:
        yield f"It stops at {stop:g} s, which is not after its start at {start:g} s."
    for name in ("stepSize", "tolerance"):
        if given.get(name, 1.0) <= 0.0:
            yield f"{name} is {given[name]:g}; it should be positive."
