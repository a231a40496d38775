"""Progress of a run, told to whoever listens."""

from typing import Any

from ..base.progress import Progress
from .recorder import Outline, Pause, Recorder


class ProgressRecorder(Recorder):
    """Tells how many steps are done."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """The task of simulating begins."""
        self._told = 0
        self._progress.begin("simulating", outline.times.steps)

    def pause(self, run: Pause) -> None:
        """So many steps more are done."""
        times = run.stepping.times
        reached = round((run.stepping.time - times.start) / times.step)
        self._progress.advance(reached - self._told)
        self._told = reached
