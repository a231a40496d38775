"""One signal beside its reference, and whether it stays in the tube."""

from dataclasses import dataclass

from ...base.arrays import Vector
from .tube import Tube


@dataclass(frozen=True)
class Comparison:
    """One signal at `time` in s, with its `reference` at `reference_time`, both in `unit`.

    `lower` and `upper` are the tube's edges at `time`. `worst` is the largest difference from the
    reference that no shift in time within the tube explains, at `worst_at`; `left_at` is the
    first time outside of the tube, None if there is none. `tube` is how wide the tube is.
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
