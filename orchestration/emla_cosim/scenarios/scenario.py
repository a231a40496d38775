"""What a scenario is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..system.model import System


@dataclass(frozen=True)
class Scenario:
    """A system and how it is run: times in s, the algorithm by name; None where nobody said.

    `settings` are further ones by the names of `Settings`; `notes` are sentences for the user on
    what was read but means nothing. FMUs of a package are in the folder `unpacked` meanwhile.
    """

    name: str
    description: str
    system: System
    stop_time: float | None
    step_size: float | None
    algorithm: str = "gauss-seidel"
    start_time: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
    unpacked: Path | None = None
