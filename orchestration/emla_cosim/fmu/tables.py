"""Tables: FMUs of this project with data over time as outputs, which are known in advance.

`inputs` makes them of files. A package that another tool or an earlier run has written contains them, too.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .file import FmuFile

MODEL = "DataTable"
"""Model name of tables."""


SPANS = ("begin", "end", "mean")
"""What an output did in the last step: the line from its begin to its end, and its mean."""


def is_table(file: "FmuFile") -> bool:
    """Return whether an FMU is a table."""
    return file.description.modelName == MODEL


def find_span_references(file: "FmuFile", outputs: Sequence[str]) -> list[NDArray[np.uint32]]:
    """Return the value references of the local variables with `SPANS` of these outputs, one array for each.

    The list is empty for FMUs that are not tables, and for tables of discrete variables.
    """
    names = [[f"step.{span}.{output}" for output in outputs] for span in SPANS]
    if not is_table(file) or not all(name in file.variables for each in names for name in each):
        return []
    return [np.array([file.variables[n].valueReference for n in each], dtype=np.uint32) for each in names]
