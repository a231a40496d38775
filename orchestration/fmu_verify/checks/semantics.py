"""Run FMPy's validator on the model description if no other check reports a problem."""

import fmpy
from fmpy.validation import validate_model_description

from emla_cosim.fmu.document import find_attribute_fault

from ..check import CheckOutcome, Verdict, check, noted, passed
from ..messages import shorten_sentence
from ..subject import Subject
from . import description, structure, units, variables

_PRECISE_CHECKS = (
    description.capabilities,
    variables.types,
    units.defined,
    variables.names,
    variables.attributes,
    variables.aliases,
    variables.presence,
    structure.outputs,
    structure.derivatives,
    structure.initial_unknowns,
    structure.dependencies,
)


@check(
    "description.semantics",
    needs=("description.schema",),
    time_factor=3.0,  # it also repeats other checks
)
def semantics(subject: Subject) -> CheckOutcome:
    """Report problems that only FMPy's validator finds."""
    if any(check_.examine(subject).verdict != Verdict.PASSED for check_ in _PRECISE_CHECKS):
        return passed("Other checks report problems; FMPy would repeat them.")
    try:
        description_ = subject.read_description()
    except MemoryError:
        raise
    except Exception as error:
        fault = find_attribute_fault(subject.path) or str(error)
        return noted(f"FMPy cannot read the model description: {shorten_sentence(fault).rstrip('.')}.")
    try:
        lines_of_fmpy = validate_model_description(description_, validate_model_structure=True)
    except KeyError as error:  # of FMPy (0.3.32), for units that are not defined
        return noted(f"FMPy cannot validate the model description: {type(error).__name__} {error}.")
    lines = tuple(shorten_sentence(f"FMPy reports: {line.strip().rstrip('.')}.") for line in lines_of_fmpy)
    if lines:
        return noted(lines[0], details=lines)
    return passed(f"FMPy {fmpy.__version__} reports no further problem.")
