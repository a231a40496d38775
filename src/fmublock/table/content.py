"""The content of a table FMU: columns of numbers over time, and outputs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..units import SiUnit

MODEL = "DataTable"
"""The model name and identifier of all table FMUs."""

INTERPOLATIONS = ("held", "linear", "cubic")
"""Interpolation between two rows: the value of the first one, a straight line, a cubic spline."""

TYPES = {"Real": "R", "Integer": "I", "Enumeration": "I", "Boolean": "B"}
"""Types of outputs, with the letter by which the C code knows them."""

ENDS = ("hold", "repeat", "stop")
"""What follows the last row: its value until the end, the first row again, or the end of the run."""

SPANS = ("begin", "end", "mean")
"""What an output of the type Real did in the last step: the line from its begin to its end, and its mean.

In a step with a jump inside, all three are the mean. Local variables have these values, see `span_name`.
"""

Numbers = NDArray[np.float64]


def span_name(output: str, span: str) -> str:
    """Return the name of the local variable with one of `SPANS` of an output."""
    return f"step.{span}.{output}"


@dataclass(frozen=True)
class TableColumn:
    """Numbers at the times of a table, and their interpolation, one of `INTERPOLATIONS`."""

    values: Numbers
    interpolation: str = "linear"


@dataclass(frozen=True)
class TableOutput:
    """An output: `factor` times a column, or its time derivative of this order (0 to 2), plus `offset`.

    `column` is its position in the table, `unit` that of the output. `type` is one of `TYPES`; outputs of
    other types than Real have held columns of their values. `items` are the names of an enumeration's values.
    """

    name: str
    column: int
    order: int = 0
    factor: float = 1.0
    offset: float = 0.0
    unit: SiUnit | None = None
    description: str = ""
    type: str = "Real"
    items: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TableContent:
    """Columns at two or more times in s, the outputs, and one of `ENDS`.

    Times increase, except that two rows may have the same time: the columns jump there. All outputs have
    types with the same letter in `TYPES`. `name` is that of the model; the identifier is `MODEL` always.
    `fmi` is the version of FMI.
    """

    times: Numbers
    columns: Sequence[TableColumn]
    outputs: Sequence[TableOutput]
    end: str = "hold"
    name: str = MODEL
    fmi: int = 2

    @property
    def letter(self) -> str:
        """The letter of the outputs' types in `TYPES`."""
        (letter,) = {TYPES[output.type] for output in self.outputs} or {"R"}
        return letter

    @property
    def has_spans(self) -> bool:
        """Whether local variables say what the outputs did in the last step; see `SPANS`."""
        return self.letter == "R" and self.fmi == 2
