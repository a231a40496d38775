"""The settings of an examination."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from emla_cosim.base.tolerances import Tolerance


@dataclass(frozen=True)
class Recording:
    """What `verify` records as a reference, and where.

    Args:
        folder: folder of the reference files.
        inputs: CSV file with inputs over time. Default: inputs of the given shape within their ranges.
        shape: shape of the inputs, such as "steps".
        stop: stop time in s. Default: that of the default experiment of the FMU.
        step: step size in s. Default: that of the default experiment of the FMU.
        values: start values by name.
        overwrite: replace existing files.
    """

    folder: Path
    inputs: Path | None = None
    shape: str = "steps"
    stop: float | None = None
    step: float | None = None
    values: dict[str, Any] = field(default_factory=dict)
    overwrite: bool = False

    def files(self, name: str) -> list[Path]:
        """Return the paths of the reference files of an FMU."""
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
        fail_on: What makes an FMU fail in addition to failed checks: `warning`, `skip`.
        must_run: Names, groups or patterns of checks that must not be skipped.
    """

    only: Sequence[str] = ()
    skip: Sequence[str] = ()
    reference: Path | None = None
    tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    seconds: float = 10.0
    memory: int = 2 * 2**30
    recording: Recording | None = None
    fail_on: Sequence[str] = ()
    must_run: Sequence[str] = ()
