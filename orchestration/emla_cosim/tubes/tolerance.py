"""How wide tubes are to be, as people write it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerance:
    """How far off a signal may be: relative to its range, in its own unit, and in time in s.

    None leaves a part to the default: 1e-3 of the range, nothing more, half a reference interval. The
    tube is as wide as `relative` and `absolute` together.
    """

    relative: float | None = None
    absolute: float | None = None
    time: float | None = None
