"""The content of a table FMU: columns, outputs, and the file with its numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import BuildError
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


_MAGIC = b"EMLATBL2"
_GUID_BYTES = 40
"""Bytes for the 38 letters of a GUID and zeros, in whole doubles."""


def pack_table(table: TableContent, guid: str) -> bytes:
    """Return the file: magic, count of numbers, the numbers (little-endian doubles), their checksum.

    The numbers begin with the GUID's letters; `guid` may be empty.

    Raises:
        BuildError: A column has no finite spline.
    """
    numbers = np.concatenate(
        [np.frombuffer(guid.encode().ljust(_GUID_BYTES, b"\0"), "<f8"), *_collect_parts(table)]
    )
    words = numbers.astype("<f8", copy=False).view("<u8")
    weights = 2 * np.arange(len(words), dtype=np.uint64) + np.uint64(1)
    total = np.sum(words * weights, dtype=np.uint64)  # modulo 2^64
    return _MAGIC + np.uint64(len(words)).tobytes() + words.tobytes() + total.tobytes()


def _collect_parts(table: TableContent) -> list[Numbers]:
    times = table.times
    head = [len(times), len(table.columns), len(table.outputs), ENDS.index(table.end), table.has_spans]
    kinds = [INTERPOLATIONS.index(c.interpolation) for c in table.columns]
    outputs = [x for o in table.outputs for x in (o.column, o.order, o.factor, o.offset or -0.0)]
    rows = np.empty((len(times), len(table.columns), 2))
    for i, column in enumerate(table.columns):
        rows[:, i, 0] = column.values
        rows[:, i, 1] = _compute_slopes(table, column)
    return [np.array([*head, *kinds, *outputs], dtype=float), times, rows.ravel(), _build_index(times)]


def _compute_slopes(table: TableContent, column: TableColumn) -> Numbers:
    """Return the slopes of the cubic spline of continuous curvature through a column.

    Its ends are "not a knot". If the table repeats and its last value equals the first, the spline is
    periodic. Rows with the same time divide the column into splines of their own.
    """
    slopes = np.zeros_like(column.values)
    if column.interpolation != "cubic":
        return slopes
    from scipy.interpolate import CubicSpline  # slow

    values, starts = column.values, np.flatnonzero(np.diff(table.times) == 0.0) + 1
    is_periodic = table.end == "repeat" and len(values) > 2 and values[0] == values[-1] and not starts.size
    try:
        with np.errstate(all="ignore"):
            for part in np.split(np.arange(len(values)), starts):
                if len(part) > 1:
                    spline = CubicSpline(
                        table.times[part], values[part], bc_type="periodic" if is_periodic else "not-a-knot"
                    )
                    slopes[part] = spline(table.times[part], 1)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise BuildError(f"cubic spline interpolation failed: {error}") from error
    if not np.isfinite(slopes).all():
        raise BuildError("cubic spline interpolation failed: non-finite slopes.")
    return slopes


def _build_index(times: Numbers) -> Numbers:
    """Divide the time into as many equal parts as there are rows, and return the row at each beginning."""
    starts = times[0] + np.arange(len(times)) * ((times[-1] - times[0]) / len(times))
    rows = np.searchsorted(times, starts, side="right") - 1
    return np.clip(rows, 0, len(times) - 2).astype(float)
