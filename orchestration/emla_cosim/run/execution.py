"""One run going on: stepping, what takes its rows, and how it ends."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from ..base.errors import RunError
from ..base.units import LinearTransformation
from ..master.run_loop import simulate
from ..master.stepping.checkpoint import Checkpoint
from ..master.stepping.pacing import Pacing
from ..master.stepping.stepping_base import Stepping
from ..recorders.recorder import Outline, Recorder, RecordingError, RowBuffer, recording
from ..sandbox.interruption import catch_interrupts

FLUSH_INTERVAL = 1.0
"""Wall time in s after which rows go to the recorders even if there are few."""


class Run:
    """A run from its first row to its end: `begin`, `advance` once or more, `end`.

    A failure ends it without being raised: `error` then has it, with the sentence that says why. After
    an interruption `error` is None and `interrupted` is true.
    """

    def __init__(
        self,
        stepping: Stepping,
        outline: Outline,
        recorders: Sequence[Recorder],
        shown: Mapping[int, LinearTransformation],
        pacing: Pacing | None = None,
        resumed: Checkpoint | None = None,
    ) -> None:
        """Take a stepping whose algorithm is set up; see `RowBuffer` for `shown`."""
        self.stepping = stepping
        self.pacing = pacing
        self.error: RunError | None = None
        self.interrupted = False
        self.over = False
        """Whether the last step is done."""
        self.wall_s = 0.0
        self.shown = shown
        self._outline, self._resumed = outline, resumed
        self._waiting, self._recorders = list(recorders), list[Recorder]()
        self._buffer = RowBuffer(1 + len(outline.names), self._recorders, shown=shown)
        self._flushed = time.monotonic()
        self._paced = False
        self._first = (0, stepping.times.start)

    @property
    def steps(self) -> int:
        """Steps that this run made, which may have continued another one."""
        return self.stepping.steps - self._first[0]

    @property
    def simulated_s(self) -> float:
        """Time that passed in this run, in s."""
        return self.stepping.time - self._first[1]

    @property
    def problem(self) -> str | None:
        """The sentence that says why the run ended early; None where it did not."""
        if self.error is not None:
            return str(self.error)
        return f"interrupted at t = {self.stepping.time:.6g} s." if self.interrupted else None

    def memory(self) -> dict[str, Any]:
        """What the recorders remember, by their keys, when all rows so far have reached them."""
        self._buffer.flush()
        found = {}
        for recorder in self._recorders:
            if recorder.key:
                with recording(recorder):
                    found[recorder.key] = recorder.memory()
        return found

    def begin(self, stop_time: float | None) -> None:
        """Initialize and record the first row, or continue where a checkpoint is.

        `stop_time` is what slaves are told, in s; None where states must outlive it.
        """
        with self._end_on_failure(), self._report_bad_checkpoint():
            memories = self._resumed.notes["recorders"] if self._resumed is not None else {}
            for recorder in self._waiting:
                with recording(recorder):
                    recorder.begin(self._outline, memories.get(recorder.key))
                self._recorders.append(recorder)
            self.stepping.algorithm.initialize(self.stepping.times.start, stop_time)
            if self._resumed is None:
                self.stepping.record(self._buffer)
            else:
                self._resumed.restore(self.stepping)
            self._first = (self.stepping.steps, self.stepping.time)

    def advance(self, until: float, interrupted: Callable[[], bool] | None = None) -> None:
        """Step to a time in s, or as far as it goes; without `interrupted`, Ctrl-C ends it between steps."""
        if self.error is not None:
            return
        self.interrupted = False
        began = time.perf_counter()
        with self._end_on_failure(), contextlib.ExitStack() as held:
            asked = interrupted or held.enter_context(catch_interrupts())
            self._pause()
            if self.pacing is not None and not self._paced:
                self._paced = True
                self.pacing.begin(self.stepping.time)
            simulate(self.stepping, self._buffer, asked, self.pacing, self._pause, until)
            self.interrupted = not self.stepping.reached(until)
        self.wall_s += time.perf_counter() - began

    def end(self) -> None:
        """Give the recorders what is left, and end them."""
        began = time.perf_counter()
        self.over = True
        try:
            if self.error is None:
                with self._end_on_failure():
                    self._pause()
        finally:
            with self._end_on_failure():
                self._buffer.end()
        self.wall_s += time.perf_counter() - began

    def abandon(self) -> None:
        """Give the recorders what is left, and end them, where something else is being raised."""
        if not self.over:
            with contextlib.suppress(Exception):
                self._buffer.end()

    def _pause(self) -> None:
        if time.monotonic() - self._flushed >= FLUSH_INTERVAL:
            self._buffer.flush()
            self._flushed = time.monotonic()
        for recorder in self._recorders:
            with recording(recorder):
                recorder.pause(self)

    @contextlib.contextmanager
    def _report_bad_checkpoint(self) -> Iterator[None]:
        """Whatever a checkpoint brings about that is whole but was not made by a run is its fault."""
        try:
            yield
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            if self._resumed is None:
                raise
            raise RunError(f"the checkpoint is not one of this run: {error!r}.") from error

    @contextlib.contextmanager
    def _end_on_failure(self) -> Iterator[None]:
        try:
            yield
        except RecordingError as error:
            self.error = self.error or error
        except MemoryError as error:
            self._fail(RunError("there is not enough memory."), error)
        except RunError as error:
            self._fail(error, error)

    def _fail(self, error: RunError, cause: Exception) -> None:
        """Something other than a recorder ends the run."""
        if self.error is None:
            at, stepped = self.stepping.time, isinstance(cause, RunError) and self.stepping.steps > 0
            warning = self.stepping.algorithm.warning() if stepped else None
            said = str(error) if warning is None else f"{error} {warning}"
            self.error = RunError(f"the run ended at t = {at:.6g} s: {said}", time=at, **error.fields)
            self.error.__cause__ = cause
