"""What a picture shows, apart from how it is drawn: panels of lines over time, with limits."""

from dataclasses import dataclass

from ..arrays import Vector


@dataclass(frozen=True)
class ShownLine:
    """A line over the time of its panel, in a colour of `style`."""

    label: str
    values: Vector
    color: str
    dashed: bool = False


@dataclass(frozen=True)
class ShownPanel:
    """Lines over `time` in s; `column` is what they are of, `label` what they measure, with its unit.

    `limits` are ranges that are not to be left, as label, lowest and highest value; None where there is no
    such end.
    """

    column: str
    label: str
    time: Vector
    lines: tuple[ShownLine, ...]
    limits: tuple[tuple[str, float | None, float | None], ...] = ()
