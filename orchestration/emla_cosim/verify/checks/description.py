"""The model description: readable, and as the schema and the standard want it."""

from ..check import check
from ..subject import DESCRIPTION, Subject
from ..verdict import Clause, Outcome, failed, passed


@check(
    "description.readable",
    "The model description can be read",
    Clause("2.3", "modelDescription.xml // Description of model (required file)"),
    "Export the FMU again; `modelDescription.xml` has to be well-formed XML of FMI 2.0.",
    needs=("archive.safe",),
)
def readable(subject: Subject) -> Outcome:
    """There is one, it is XML of FMI 2.0, and says what the FMU is for."""
    try:
        version = subject.tree.get("fmiVersion")
    except Exception as error:
        return failed(f"{DESCRIPTION} cannot be read: {' '.join(str(error).split())}.")
    if version != "2.0":
        return failed(
            f"It is an FMI {version} FMU; this verifies FMI 2.0.",
            hint=f"Use a tool for FMI {version}, or export the model for FMI 2.0.",
        )
    try:
        kinds = subject.kinds
    except Exception as error:
        return failed(f"{DESCRIPTION} cannot be read: {' '.join(str(error).split())}.")
    if not kinds:
        return failed(f"{DESCRIPTION} has neither a CoSimulation nor a ModelExchange element.")
    return passed(f"It describes {subject.description.modelName}, for {' and '.join(kinds)}.")
