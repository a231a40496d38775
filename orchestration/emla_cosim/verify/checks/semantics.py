"""What fmpy says of the model description, where no other check has found anything."""

import fmpy
from fmpy.validation import validate_model_description

from ..check import check
from ..saying import judged
from ..subject import Subject
from ..verdict import Clause, Outcome, Verdict, passed, warned
from . import description, starts, structure, types, units, variables

_SAY_IT_BETTER = (
    description.capabilities,
    types.types,
    units.defined,
    variables.names,
    variables.attributes,
    starts.presence,
    structure.outputs,
    structure.derivatives,
    structure.initial_unknowns,
    structure.dependencies,
)


@check(
    "description.semantics",
    "FMPy finds nothing else",
    Clause(
        "2.2",
        "All static information related to an FMU is stored in the text file modelDescription.xml in XML "
        "format.",
    ),
    "Tools that are based on FMPy may refuse the FMU.",
    needs=("description.schema",),
)
def semantics(subject: Subject) -> Outcome:
    """What FMPy's validator says that no other check does."""
    if any(one.examine(subject).verdict == Verdict.FAILED for one in _SAY_IT_BETTER):
        return passed("What FMPy could say, other checks have said.")
    try:
        read = subject.description
    except MemoryError:
        raise
    except Exception as error:
        return warned(f"FMPy cannot read the model description: {' '.join(str(error).split()).rstrip('.')}.")
    flat = read.variableNamingConvention != "structured"  # fmpy takes none for structured
    found = validate_model_description(read, not flat, validate_model_structure=True)
    doubts = [f"FMPy says: {' '.join(line.split()).rstrip('.')}." for line in found]
    return judged((), f"FMPy {fmpy.__version__} finds nothing else.", doubts)
