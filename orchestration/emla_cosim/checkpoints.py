"""Checkpoints of a run: when they are written, what they belong to, and whether one fits."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .errors import CommandError, RunError
from .master.assembly import Assembly
from .master.stepping.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from .master.stepping.stepping import Stepping
from .master.stepping.timing import Timing
from .results.output_folder import Recording
from .settings import Settings
from .system.model import System

INTERVAL = 60.0
"""Wall time in s between two checkpoints while a run goes on."""


def run_identity(
    system: System, assembly: Assembly, algorithm: str, settings: Settings, times: Timing
) -> dict[str, Any]:
    """What must be the same for a run to be continued, by the names it has in messages."""
    return {
        "FMUs": {name: file.sha256 for name, file in assembly.files.items()},
        "components": [c.name for c in system.components],
        "values set": {
            f"{c.name}.{n}": str(v) for c in system.components for n, v in sorted(c.parameters.items())
        },
        "mappings": {f"{c.name}.{n}": str(a) for c in system.components for n, a in c.aliases.items()},
        "connections": [f"{x} {x.transformation}" for x in system.connections],
        "algorithm": algorithm,
        "extrapolation": settings.extrapolation,
        "coupling tolerance": settings.coupling_tolerance,
        "error tolerance": settings.error_tolerance,
        "step multiples": dict(settings.multiples),
        "order": list(settings.order),
        "start time": times.start,
        "step size": times.step,
        "output interval": settings.output_interval,
    }


def resumable(path: Path, identity: Mapping[str, Any], times: Timing) -> Checkpoint:
    """The checkpoint to continue from; CommandError where it does not belong to this run."""
    checkpoint = load_checkpoint(path)
    try:
        was, reached = checkpoint.notes["identity"], checkpoint.notes["time"]
    except (KeyError, TypeError) as error:
        raise CommandError(f"'{path}' is not a checkpoint of a run.") from error
    for what, value in identity.items():
        if was.get(what) != value:
            raise CommandError(_difference(path, what, was.get(what), value))
    if reached >= times.stop:
        raise CommandError(
            f"the checkpoint '{path}' is at t = {reached:.9g} s already; give a later stop time than "
            f"{times.stop:.9g} s."
        )
    return checkpoint


def _difference(path: Path, what: str, was: Any, value: Any) -> str:
    if isinstance(was, dict) and isinstance(value, dict):
        names = [n for n in {**was, **value} if was.get(n) != value.get(n)]
        return f"the checkpoint '{path}' was made with other {what}, of {', '.join(names[:5])}."
    if isinstance(value, list):
        return f"the checkpoint '{path}' was made with other {what}."
    return f"the checkpoint '{path}' was made with the {what} {was}, this run has {value}."


@dataclass
class Checkpoints:
    """Writes checkpoints of a run to one file; without a path it does nothing."""

    path: Path | None
    identity: Mapping[str, Any]
    _last: float = field(default_factory=time.monotonic)

    def save_when_due(self, stepping: Stepping, recording: Recording) -> None:
        """Write one if the last is long ago; see `save`."""
        if time.monotonic() - self._last >= INTERVAL:
            self.save(stepping, recording)

    def save(self, stepping: Stepping, recording: Recording) -> None:
        """Write where the run is. Raises RunError where that fails; OSError from the recording."""
        if self.path is None:
            return
        notes = {"identity": self.identity, "time": stepping.time, "recording": recording.memory()}
        try:
            save_checkpoint(self.path, stepping, notes)
        except OSError as error:
            raise RunError(
                f"the checkpoint '{self.path}' cannot be written: {error.strerror or error}."
            ) from error
        self._last = time.monotonic()
