"""Report the progress of a run."""

from typing import Any

from ..base.progress import Progress
from .recorder import Outline, Pause, Recorder


class ProgressRecorder(Recorder):
    """Report notes on the run, and then the number of finished steps."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Report the begin of the simulation."""
        for note in outline.notes:
            self._progress.note(f"Note: {note}.")
        self._reported = 0
        self._progress.begin("simulating", outline.times.steps)

    def pause(self, run: Pause) -> None:
        """Report the steps since the last call."""
        times = run.stepping.times
        reached = round((run.stepping.time - times.start) / times.step)
        self._progress.advance(reached - self._reported)
        self._reported = reached
