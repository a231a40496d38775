"""Runs through the default experiment."""

import numpy as np

from ..check import check
from ..host.drive import driven
from ..host.experiment import experiment
from ..host.instance import Instance
from ..subject import Subject
from ..verdict import Clause, Outcome, failed, passed


@check(
    "run.completes",
    "The default experiment runs",
    Clause("4.2.2", "The computation of a time step is started."),
    "The log says why; try the FMU with the step size and the start values that its author uses.",
    needs=("instance.created",),
)
def completes(subject: Subject) -> Outcome:
    """It can be initialized, stepped with inputs that move, terminated and freed."""
    instance, course = Instance(subject), experiment(subject)
    driven(instance, course)
    instance.close()
    return passed(f"{len(course.times) - 1} steps of {course.step:g} s were done.")


@check(
    "run.finite",
    "Outputs are numbers all along",
    Clause("2.1.3", "fmi2Error ... the simulation cannot be continued with this FMU instance"),
    "A step that gives no numbers should answer fmi2Discard or fmi2Error, and say in the log why.",
    needs=("run.completes",),
)
def finite(subject: Subject) -> Outcome:
    """No output becomes NaN or infinite while calls are answered with fmi2OK."""
    found = driven(Instance(subject), experiment(subject))
    wrong = ~np.isfinite(found.values)
    if wrong.any():
        k = int(np.argmax(wrong.any(axis=1)))
        name = found.names[int(np.argmax(wrong[k]))]
        return failed(f"{name} is {found.values[k][wrong[k]][0]} at t = {found.times[k]:.9g} s.")
    return passed(f"{len(found.names)} outputs are finite at {len(found.times)} times.")
