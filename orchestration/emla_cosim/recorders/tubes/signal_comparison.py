"""The comparison of one signal with its reference."""

from dataclasses import dataclass

from ...base.arrays import Vector
from .tube import Tube


@dataclass(frozen=True)
class Comparison:
    """One signal with its reference.

    Args:
        signal: Name of the signal.
        unit: Unit of all values.
        time: Times of the signal in s, shape (n,).
        values: The signal, shape (n,).
        reference_time: Times of the reference in s, shape (m,).
        reference: The reference, shape (m,).
        lower: Lower edge of the tube at `time`, shape (n,).
        upper: Upper edge of the tube at `time`, shape (n,).
        tube: Width of the tube.
        worst: Largest difference that a shift in time within the tube does not explain.
        worst_at: Time of that difference in s.
        left_at: First time outside the tube in s; None without one.
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
