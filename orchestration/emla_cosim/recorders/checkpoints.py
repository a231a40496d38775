"""Checkpoints of a run: when they are written, what they belong to, and whether one fits."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.errors import CommandError, RunError
from ..master.stepping.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from ..master.stepping.timing import CommunicationPoints
from .recorder import Pause, Recorder

INTERVAL = 60.0
"""Wall time in s between two checkpoints while a run goes on."""


class Checkpoints(Recorder):
    """Writes checkpoints of a run to one file: now and then, and at the end.

    `identity` is what must be the same for a run to be continued, by the names it has in messages. The
    file is at `place`, wherever FMUs may go; messages call it `path`.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], place: Path) -> None:
        self.path = path
        self._place = place
        self.identity = identity
        self._last = time.monotonic()

    def pause(self, run: Pause) -> None:
        """Write one if the last is long ago, or stepping is over; RunError where that fails."""
        if run.over or time.monotonic() - self._last >= INTERVAL:
            self._save(run)

    def _save(self, run: Pause) -> None:
        notes = {"identity": self.identity, "time": run.stepping.time, "recorders": run.memory()}
        try:
            save_checkpoint(self._place, run.stepping, notes)
        except OSError as error:
            raise RunError(
                f"the checkpoint '{self.path}' cannot be written: {error.strerror or error}."
            ) from error
        self._last = time.monotonic()


def find_resumable_checkpoint(
    path: Path, identity: Mapping[str, Any], times: CommunicationPoints, folder: Path
) -> Checkpoint:
    """The checkpoint to continue from, its path relative to `folder`.

    Raises CommandError where it does not belong to this run.
    """
    checkpoint = load_checkpoint(path, folder)
    try:
        was, reached = checkpoint.notes["identity"], checkpoint.notes["time"]
        if not (isinstance(was, dict) and isinstance(reached, (int, float))):
            raise TypeError
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
