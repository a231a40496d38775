"""The settings of an examination."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..recorders.tubes.tolerance import Tolerance


@dataclass(frozen=True)
class Recording:
    """How to record reference files.

    Attributes:
        folder: Folder for the files.
        inputs: CSV file of inputs. Default: generated inputs.
        shape: Shape of generated inputs: `steps`, `ramps` or `chirps`.
        stop: Stop time in s. Default: that of the FMU's default experiment.
        step: Step size in s. Default: that of the FMU's default experiment.
        values: Start values by name.
        overwrite: Whether to replace existing files.
    """

    folder: Path
    inputs: Path | None = None
    shape: str = "steps"
    stop: float | None = None
    step: float | None = None
    values: dict[str, Any] = field(default_factory=dict)
    overwrite: bool = False

    def files(self, name: str) -> list[Path]:
        """Return the paths for an FMU with this name."""
        return [self.folder / f"{name}_{kind}" for kind in ("in.csv", "ref.csv", "ref.opt", "ref.toml")]


@dataclass(frozen=True)
class Settings:
    """The selection of checks, the references, and the limits.

    Attributes:
        only: Names, groups or patterns of checks to run; all if empty.
        skip: Names, groups or patterns of checks to skip.
        reference: Folder of reference files. Default: next to the FMU.
        tolerance: Width of tubes by name or pattern.
        seconds: Time limit of a check in s.
        memory: Memory limit of a check in bytes.
        recording: Record references instead of running checks.
    """

    only: Sequence[str] = ()
    skip: Sequence[str] = ()
    reference: Path | None = None
    tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    seconds: float = 10.0
    memory: int = 2 * 2**30
    recording: Recording | None = None
