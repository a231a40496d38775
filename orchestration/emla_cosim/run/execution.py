"""One run: steps, recorders, and how it ends."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from ..base.errors import RunError
from ..base.interruption import catch_interrupts
from ..base.units import LinearTransformation
from ..master.instances.fmu_instance import EndRequestedError
from ..master.run_loop import simulate
from ..master.stepping.checkpoint import Checkpoint
from ..master.stepping.pacing import Pacing
from ..master.stepping.profiler import PACING, Profiler
from ..master.stepping.stepping_base import RowSink, Stepping
from ..recorders.recorder import Outline, Recorder, RecordingError, recording
from ..recorders.row_buffer import RowBuffer
from .requirements import Requirement, StopCondition, StoppingRows, describe_stop

FLUSH_INTERVAL = 1.0
"""Longest wall time in s between two transfers of rows to the recorders."""


class Run:
    """A run: `begin`, `advance` once or more, `end`.

    A failure does not raise: it ends the run, and `error` has the message. After an interruption `error` is
    None and `interrupted` is true.
    """

    def __init__(
        self,
        stepping: Stepping,
        outline: Outline,
        recorders: Sequence[Recorder],
        shown: Mapping[int, LinearTransformation],
        pacing: Pacing | None = None,
        resumed: Checkpoint | None = None,
        conditions: Sequence[StopCondition] = (),
        profiler: Profiler | None = None,
    ) -> None:
        """Take a stepping whose algorithm is set up; see `RowBuffer` for `shown`.

        The profiler, if there is one, measures the run from its first step on.

        The run ends at the first row that meets one of the `conditions`. With some, it makes single steps.
        """
        self.stepping = stepping
        self.pacing = pacing
        self.error: RunError | None = None
        self.interrupted = False
        self.requested_end: EndRequestedError | None = None
        """What an FMU answered that ended the run by its own wish, which is no failure."""
        self.over = False
        """Whether `end` was called."""
        self.wall_s = 0.0
        self.shown = shown
        self._outline, self._resumed, self._profiler = outline, resumed, profiler
        self._waiting, self._recorders = list(recorders), list[Recorder]()
        self._buffer = RowBuffer(
            1 + len(outline.names),
            self._recorders,
            shown=shown,
            texts=outline.text_columns,
            map_rows=self._map_rows,
        )
        self._stopping = StoppingRows(self._buffer, conditions) if conditions else None
        self._rows: RowSink = self._buffer if self._stopping is None else self._stopping
        self._flushed = time.monotonic()
        self._paced = False
        self._first = (0, stepping.times.start)
        self._has_first_row = False
        if profiler is not None:
            for recorder in recorders:
                name = recorder.key or type(recorder).__name__
                profiler.watch(name, recorder, "write", "pause", "memory", "end")
            if pacing is not None:
                profiler.watch(PACING, pacing, "wait")

    @property
    def steps(self) -> int:
        """Number of steps of this run, without those before its checkpoint."""
        return self.stepping.steps - self._first[0]

    @property
    def simulated_s(self) -> float:
        """Simulated time of this run in s, without that before its checkpoint."""
        return self.stepping.time - self._first[1]

    @property
    def problem(self) -> str | None:
        """Message that says why the run ended early, or None."""
        if self.error is not None:
            return str(self.error)
        return f"interrupted at t = {self.stepping.time:.6g} s." if self.interrupted else None

    @property
    def stopped(self) -> tuple[Requirement, float] | None:
        """The condition that ended the run and its time in s, or None."""
        return None if self._stopping is None else self._stopping.met

    @property
    def early_end(self) -> str | None:
        """Message on a condition or an FMU that ended the run before its stop time, or None."""
        if self.stopped is not None:
            return describe_stop(*self.stopped)
        if self.requested_end is not None:
            return f"the run ended at t = {self.stepping.time:.6g} s: {self.requested_end}"
        return None

    def profile(self) -> dict[str, Any] | None:
        """Return where the time went; None without a profiler, or before the first step."""
        if self._profiler is None or not self.steps:
            return None
        return self._profiler.report(self.wall_s)

    def memory(self) -> dict[str, Any]:
        """Pass all rows to the recorders, and return their memories by key."""
        self._buffer.flush()
        found = {}
        for recorder in self._recorders:
            if recorder.key:
                with recording(recorder):
                    found[recorder.key] = recorder.memory()
        return found

    def begin(self, stop_time: float | None) -> None:
        """Initialize and record the first row, or continue from a checkpoint.

        Args:
            stop_time: Stop time that the FMUs receive, in s; None if a checkpoint may be continued beyond it.
        """
        with self._end_on_failure(), self._report_bad_checkpoint():
            memories = self._resumed.notes["recorders"] if self._resumed is not None else {}
            for recorder in self._waiting:
                with recording(recorder):
                    recorder.begin(self._outline, memories.get(recorder.key))
                self._recorders.append(recorder)
            self.stepping.algorithm.initialize(self.stepping.times.start, stop_time)
            if self._resumed is None:
                self.stepping.record(self._rows)
            else:
                self._resumed.restore(self.stepping)
            self._first = (self.stepping.steps, self.stepping.time)
            self._has_first_row = True
            if self._profiler is not None:
                self._profiler.restart(self.stepping.loop)

    def advance(self, until: float, interrupted: Callable[[], bool] | None = None) -> None:
        """Step to a time in s, or until a failure.

        Args:
            until: Time in s.
            interrupted: Function that says whether to stop. Default: stop after Ctrl-C.
        """
        if self.error is not None or self.stopped is not None or self.requested_end is not None:
            return
        self.interrupted = False
        began = time.perf_counter()
        with self._end_on_failure(), contextlib.ExitStack() as held:
            asked = interrupted or held.enter_context(catch_interrupts())
            self._pause()
            if self.pacing is not None and not self._paced:
                self._paced = True
                self.pacing.begin(self.stepping.time)
            if self._stopping is None:
                simulate(self.stepping, self._rows, asked, self.pacing, self._pause, until)
            else:
                ends = partial(self._ends, asked)
                simulate(self.stepping, self._rows, ends, self.pacing, self._pause, until, longest=1)
            self.interrupted = self.stopped is None and not self.stepping.reached(until)
        self.wall_s += time.perf_counter() - began

    def end(self) -> None:
        """Pass the remaining rows to the recorders, and end them."""
        began = time.perf_counter()
        self.over = True
        try:
            if self.error is None:
                with self._end_on_failure():
                    self._pause()
        finally:
            with self._end_on_failure():
                self._buffer.end()
            self._end_profile()
        self.wall_s += time.perf_counter() - began

    def _end_profile(self) -> None:
        if self._profiler is not None:
            self._profiler.close()

    def abandon(self) -> None:
        """End the recorders after another error. Ignore their own errors."""
        self._end_profile()
        if not self.over:
            with contextlib.suppress(Exception):
                self._buffer.end()

    def _map_rows(self, size: int) -> Any:
        """Return memory for rows from the first recorder that has some."""
        return next((m for recorder in self._waiting if (m := recorder.map_rows(size)) is not None), None)

    def _ends(self, asked: Callable[[], bool]) -> bool:
        return self.stopped is not None or asked()

    def _pause(self) -> None:
        if time.monotonic() - self._flushed >= FLUSH_INTERVAL:
            self._buffer.flush()
            self._flushed = time.monotonic()
        for recorder in self._recorders:
            with recording(recorder):
                recorder.pause(self)

    @contextlib.contextmanager
    def _report_bad_checkpoint(self) -> Iterator[None]:
        """Report any error from a readable checkpoint with wrong content as an error of the checkpoint."""
        try:
            yield
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            if self._resumed is None:
                raise
            raise RunError(f"the checkpoint does not fit this run: {error!r}.") from error

    @contextlib.contextmanager
    def _end_on_failure(self) -> Iterator[None]:
        try:
            yield
        except RecordingError as error:
            self.error = self.error or error
        except MemoryError as error:
            self._fail(RunError("there is not enough memory."), error)
        except EndRequestedError as error:
            if self._has_first_row:
                self.requested_end = self.requested_end or error
            else:
                self._fail(error, error)
        except RunError as error:
            self._fail(error, error)

    def _fail(self, error: RunError, cause: Exception) -> None:
        """End the run because of an error outside of the recorders."""
        if self.error is None:
            at, stepped = self.stepping.time, isinstance(cause, RunError) and self.stepping.steps > 0
            warning = self.stepping.algorithm.warning() if stepped else None
            said = str(error) if warning is None else f"{error} {warning}"
            self.error = RunError(f"the run ended at t = {at:.6g} s: {said}", time=at, **error.fields)
            self.error.__cause__ = cause
