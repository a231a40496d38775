"""Write checkpoints during a run, and check whether a checkpoint fits a run."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.errors import CommandError
from ..base.output_files import OutputFile
from ..master.stepping.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from ..master.stepping.timing import CommunicationPoints
from .recorder import Pause, Recorder

INTERVAL = 60.0
"""Wall time in s between two checkpoints."""


class Checkpoints(Recorder):
    """Write checkpoints of a run to one file: at intervals, and at the end.

    Args:
        file: The file.
        identity: What must be the same to continue a run, by its names in messages.
    """

    def __init__(self, file: OutputFile, identity: Mapping[str, Any]) -> None:
        self.file, self.identity = file, identity
        self._last = time.monotonic()

    def pause(self, run: Pause) -> None:
        """Write a checkpoint if one is due, or if stepping is over; RunError if that fails."""
        if not run.over and time.monotonic() - self._last < INTERVAL:
            return
        notes = {"identity": self.identity, "time": run.stepping.time, "recorders": run.state_dict()}
        save_checkpoint(self.file, run.stepping, notes)
        self._last = time.monotonic()


def find_resumable_checkpoint(
    path: Path, identity: Mapping[str, Any], times: CommunicationPoints, folder: Path
) -> Checkpoint:
    """Return the checkpoint to continue from.

    Args:
        path: The file, relative to `folder`.
        identity: What must be the same, by its names in messages.
        times: The communication points of the run.
        folder: The folder.

    Raises:
        CommandError: The file is not a checkpoint of this run, or is already at the stop time.
    """
    checkpoint = load_checkpoint(path, folder)
    try:
        was, reached = checkpoint.notes["identity"], checkpoint.notes["time"]
        if not (isinstance(was, dict) and isinstance(reached, (int, float))):
            raise TypeError
    except (KeyError, TypeError) as error:
        raise CommandError(f"'{path}' is not a checkpoint of a run.") from error
    # entries of both: an earlier version may have known fewer of them
    for key in {**was, **identity}:
        before, value = was.get(key), identity.get(key)
        if before != value:
            raise CommandError(_describe_difference(path, key, before, value))
    if reached >= times.stop:
        raise CommandError(
            f"the checkpoint '{path}' is already at t = {reached:.9g} s. Set a stop time later than that; "
            f"it is {times.stop:.9g} s."
        )
    return checkpoint


def _describe_difference(path: Path, key: str, was: Any, value: Any) -> str:
    """Return the message on an entry of the identity that differs: `was` in the checkpoint, `value` now."""
    if isinstance(was or value, dict):
        was, value = was or {}, value or {}
        names = [n for n in {**was, **value} if was.get(n) != value.get(n)]
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        return f"the checkpoint '{path}' has other {key}, of {', '.join(names[:5])}{more}."
    if isinstance(value, list):
        return f"the checkpoint '{path}' has other {key}."
    return f"the checkpoint '{path}' has the {key} {was}, but this run has {value}."
