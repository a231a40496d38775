"""Check the default experiment."""

import math
from collections.abc import Iterator, Mapping

from ..check import check
from ..messages import judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, in_both, skipped


@check(
    "description.experiment",
    "The default experiment can be run",
    in_both(
        "2.2.5",
        "2.4.6",
        "However, it is convenient for a user that startTime, stopTime, tolerance and stepSize have already "
        "a meaningful default value for the model at hand.",
    ),
    "Set the start before the stop, and a positive step and tolerance.",
    needs=("description.schema",),
)
def experiment(subject: Subject) -> CheckOutcome:
    """Check that times are finite, the stop is after the start, and the step is positive."""
    element = subject.tree.find("DefaultExperiment")
    if element is None:
        return skipped("The FMU has no default experiment.")
    given = {name: float(text) for name, text in element.attrib.items() if "}" not in name}
    fine = ", ".join(f"{name} {value:g}" for name, value in given.items())
    return judge_problems((), f"The default experiment has {fine or 'no attributes'}.", list(_doubts(given)))


def _doubts(given: Mapping[str, float]) -> Iterator[str]:
    for name, value in given.items():
        if not math.isfinite(value):
            yield f"{name} is {value}; it must be a finite number."
    start, stop = given.get("startTime", 0.0), given.get("stopTime", math.inf)
    if stop <= start:
        yield f"stopTime is {stop:g} s, which is not after startTime, {start:g} s."
    for name in ("stepSize", "tolerance"):
        if given.get(name, 1.0) <= 0.0:
            yield f"{name} is {given[name]:g}; it should be positive."
