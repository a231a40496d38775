"""Content of one pair of axes, independent of how it is drawn."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..base.arrays import Vector
from ..base.colors import BLUE


@dataclass(frozen=True)
class Line:
    """Values over `time` in s. The label is empty if the axes' label is enough.

    With `is_stepped`, each value is drawn until the next one.
    """

    label: str
    time: Vector
    values: Vector
    color: str = BLUE
    dashed: bool = False
    is_stepped: bool = False


@dataclass(frozen=True)
class Band:
    """The area between `lower` and `upper`, behind the lines."""

    label: str
    time: Vector
    lower: Vector
    upper: Vector


@dataclass(frozen=True)
class Limit:
    """Range that values should stay in, in the unit of the axes; None for an open end."""

    label: str
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Plot:
    """Lines over time with the quantity and unit of `label`. The area beyond `limits` is shaded.

    `items` are names for values, such as those of an enumeration, which the axis shows.
    `column` is their subject; plots with the same subject zoom together on a page. `part` is the part of the
    time that they show, if it is not the whole; a plot of another part zooms by itself.

    The other attributes are for pages. `mark` is a time on the first line, and `since` the time from which
    conditions differ, both with a text. With `shows_all`, the axes show also values far from the band.
    """

    label: str
    lines: tuple[Line, ...]
    band: Band | None = None
    mark: tuple[float, str] | None = None
    since: tuple[float, str] | None = None
    shows_all: bool = False
    limits: tuple[Limit, ...] = ()
    column: str = ""
    part: str = ""
    items: Mapping[int, str] = field(default_factory=dict)
