"""Instances: made, and freed."""

from ..check import check
from ..host.instance import Instance
from ..subject import Subject
from ..verdict import Clause, Outcome, passed


@check(
    "instance.created",
    "An instance can be made and freed",
    Clause("2.1.5", "The function returns a new instance of an FMU."),
    "The log says why; a GUID in the library that is not that of modelDescription.xml is the usual reason.",
    needs=("binaries.loads",),
)
def created(subject: Subject) -> Outcome:
    """fmi2Instantiate gives an instance, and fmi2FreeInstance takes it back."""
    Instance(subject).free()
    return passed("An instance was made and freed.")
