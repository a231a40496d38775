"""The comparison of one signal with its reference."""

from dataclasses import dataclass

from ...base.arrays import Vector
from .tube import Tube


@dataclass(frozen=True)
class Comparison:
    """One signal with its reference and the tube around it.

    Attributes:
        signal: full name.
        unit: unit of the values.
        time: times of the signal in s, shape (n,).
        values: values of the signal, shape (n,).
        reference_time: times of the reference in s, shape (m,).
        reference: values of the reference, shape (m,).
        lower: lower edge of the tube at `time`, shape (n,).
        upper: upper edge of the tube at `time`, shape (n,).
        worst: largest difference that no shift in time within the tube explains.
        worst_at: its time in s.
        left_at: first time outside of the tube in s; None if the signal stays inside.
        tube: size of the tube.
    """

    signal: str
    unit: str
    time: Vector
    values: Vector
    reference_time: Vector
    reference: Vector
    lower: Vector
    upper: Vector
    tube: Tube
    worst: float
    worst_at: float
    left_at: float | None

    @property
    def inside(self) -> bool:
        """Whether the signal stays in its tube."""
        return self.left_at is None
