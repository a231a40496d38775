"""What a user may say about an examination."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ..recorders.tubes.tolerance import Tolerance

if TYPE_CHECKING:
    from .references.recording import Recording


@dataclass(frozen=True)
class Settings:
    """What is checked, against what, and what an FMU may use meanwhile.

    `only` and `skip` are names of checks or patterns of them. `reference` is a folder of reference
    files; without one those beside the FMU are taken. `tolerance` says how wide tubes are. `seconds`
    is the time that one check may take, `memory` the bytes it may have. With a `recording` references
    are made, and nothing else is done.
    """

    only: Sequence[str] = ()
    skip: Sequence[str] = ()
    reference: Path | None = None
    tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    seconds: float = 10.0
    memory: int = 2 * 2**30
    recording: "Recording | None" = None
