"""What one pair of axes shows, apart from how a picture or a page draws it."""

from dataclasses import dataclass

from ..base.arrays import Vector
from ..base.colors import BLUE


@dataclass(frozen=True)
class Line:
    """Values over `time` in s; the label is empty where the axes say what they are."""

    label: str
    time: Vector
    values: Vector
    color: str = BLUE
    dashed: bool = False


@dataclass(frozen=True)
class Band:
    """What lies between `lower` and `upper`, behind the lines."""

    label: str
    time: Vector
    lower: Vector
    upper: Vector


@dataclass(frozen=True)
class Limit:
    """What values should not leave, in the unit of the axes; None where there is no such end."""

    label: str
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Plot:
    """Lines over time, all in the quantity and unit of `label`; what is beyond `limits` is shaded.

    `column` is what they are of; a page zooms plots of one column together.

    Only pages draw the others. `mark` is a time to look at, on the first line, and `since` the time from
    which all is otherwise; both with the words for it. With `against`, an index of the lines, everything can
    also be shown as its difference from that line.
    """

    label: str
    lines: tuple[Line, ...]
    band: Band | None = None
    mark: tuple[float, str] | None = None
    since: tuple[float, str] | None = None
    against: int | None = None
    limits: tuple[Limit, ...] = ()
    column: str = ""
