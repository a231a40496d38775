"""What a picture shows, apart from how it is drawn."""

from dataclasses import dataclass

from ...base.arrays import Vector


@dataclass(frozen=True)
class ShownLine:
    """Values at the times of a panel; the label is empty where the panel says what they are."""

    label: str
    values: Vector
    color: str
    dashed: bool


@dataclass(frozen=True)
class ShownPanel:
    """Lines over `time` in s, in the quantity and unit of `label`; `column` is what they are of.

    `limits` are labels, and what values should not be below and above, None where there is no such end.
    """

    column: str
    label: str
    time: Vector
    lines: tuple[ShownLine, ...]
    limits: tuple[tuple[str, float | None, float | None], ...] = ()
