"""The content of a table FMU: columns of numbers over time, and outputs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..units import SiUnit

INTERPOLATIONS = ("held", "linear", "cubic")
"""Interpolation between two rows: the value of the first one, a straight line, a cubic spline."""

ENDS = ("hold", "repeat", "stop")
"""What follows the last row: its value until the end, the first row again, or the end of the run."""

Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class TableColumn:
    """Numbers at the times of a table, and their interpolation, one of `INTERPOLATIONS`."""

    values: Numbers
    interpolation: str = "linear"


@dataclass(frozen=True)
class TableOutput:
    """An output: `factor` times a column, or its time derivative of this order (0 to 2), plus `offset`.

    `column` is its position in the table, `unit` that of the output.
    """

    name: str
    column: int
    order: int = 0
    factor: float = 1.0
    offset: float = 0.0
    unit: SiUnit | None = None
    description: str = ""


@dataclass(frozen=True)
class TableContent:
    """Columns at two or more times in s, the outputs, and one of `ENDS`.

    Times increase, except that two rows may have the same time: the columns jump there.
    """

    times: Numbers
    columns: Sequence[TableColumn]
    outputs: Sequence[TableOutput]
    end: str = "hold"
