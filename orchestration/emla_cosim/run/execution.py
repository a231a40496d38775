"""The current run: steps, recorders, and how it ends."""

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..base.errors import RunError
from ..base.interruption import catch_interrupts
from ..base.units import LinearTransformation, SiUnit
from ..master.coupling.estimate import ALLOWANCE, SHARE, CouplingError
from ..master.instances.fmu_instance import EndRequestedError
from ..master.run_loop import MOST_STEPS, simulate
from ..master.stepping.checkpoint import Checkpoint
from ..master.stepping.profiler import PACING, Profiler
from ..master.stepping.step_size_control import FixedSteps
from ..master.stepping.stepping_base import RowSink, Stepping
from ..recorders.bond_energies import BondEnergies
from ..recorders.metrics import MetricsRecorder
from ..recorders.recorder import Recorder, RecordingError, RunLayout, recording
from ..recorders.row_buffer import RowBuffer
from .coupling_summary import EARLIER_RUN, CouplingSummary
from .requirements import Requirement, StopCondition, StoppingRows, describe_stop
from .run_record import RunDefinition
from .run_setup import RunPlan

FLUSH_INTERVAL = 1.0
"""Longest wall time in s between two transfers of rows to the recorders."""


@dataclass(eq=False)
class ActiveRun:
    """A run: `begin`, `advance` once or more, `end`.

    A failure does not raise: it ends the run, and `error` has the message. After an interruption `error` is
    None and `interrupted` is true.

    Attributes:
        conditions: The conditions of `stop_when`. The first row that meets one ends the run.
        fallback: A remark on the signals that are recorded because no FMU has an output.
        stepping: What does the steps; its algorithm is set up.
        transformations: Transformations of signals that recorders get in another unit, by position.
        metrics: The recorder of the metrics, which is also among `recorders`.
        energies: The energies of the requested bonds, maybe of none.
        resumed: The checkpoint from which the run continues.
        profiler: What measures the run from its first step on.
        interrupted: Whether Ctrl-C ended the last `advance`.
        requested_end: What an FMU answered that ended the run by its own wish, which is not a failure.
        over: Whether `end` was called.
        wall_s: Wall time of the steps in s.
    """

    plan: RunPlan
    definition: RunDefinition
    conditions: Sequence[StopCondition]
    fallback: str | None
    stepping: Stepping
    coupling: CouplingSummary
    layout: RunLayout
    transformations: Mapping[int, LinearTransformation]
    metrics: MetricsRecorder
    energies: BondEnergies
    recorders: Sequence[Recorder]
    resumed: Checkpoint | None
    profiler: Profiler | None
    error: RunError | None = field(default=None, init=False)
    interrupted: bool = field(default=False, init=False)
    requested_end: EndRequestedError | None = field(default=None, init=False)
    over: bool = field(default=False, init=False)
    wall_s: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._begun_recorders = list[Recorder]()
        self._buffer = RowBuffer(
            1 + len(self.layout.names),
            self._begun_recorders,
            transformations=self.transformations,
            texts=self.layout.text_columns,
            map_rows=self._map_rows,
        )
        self._stopping = StoppingRows(self._buffer, self.conditions) if self.conditions else None
        self._rows: RowSink = self._buffer if self._stopping is None else self._stopping
        self._last_flush = time.monotonic()
        self._is_paced = False
        self._first = (0, self.plan.times.start)
        self._has_first_row = False
        if self.profiler is not None:
            for recorder in self.recorders:
                name = recorder.key or type(recorder).__name__
                self.profiler.measure_methods(name, recorder, "write", "pause", "state_dict", "end")
            if self.plan.pacing is not None:
                self.profiler.measure_methods(PACING, self.plan.pacing, "wait")

    @property
    def units(self) -> dict[str, SiUnit | None]:
        """Units of the signals by name."""
        return dict(zip(self.layout.names, self.layout.units, strict=True))

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
        """Message on the failure or the interruption that ended the run, or None; see also `early_end`."""
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
        if self.profiler is None or not self.steps:
            return None
        return self.profiler.report(self.wall_s)

    def state_dict(self) -> dict[str, Any]:
        """Pass all rows to the recorders, and return their memories by key."""
        self._buffer.flush()
        memories = {}
        for recorder in self._begun_recorders:
            if recorder.key:
                with recording(recorder):
                    memories[recorder.key] = recorder.state_dict()
        return memories

    def begin(self) -> None:
        """Initialize and record the first row, or continue from a checkpoint."""
        times, options = self.plan.times, self.plan.options
        # the states in a checkpoint would limit a continued run to the stop time of this run
        stop_time = times.stop if times.steps and options.checkpoint is None else None
        with self._end_on_failure(), self._report_bad_checkpoint():
            memories = self.resumed.notes["recorders"] if self.resumed is not None else {}
            for recorder in self.recorders:
                with recording(recorder):
                    recorder.begin(self.layout, memories.get(recorder.key))
                self._begun_recorders.append(recorder)  # others get no rows, and are not ended
            self.stepping.algorithm.initialize(times.start, stop_time)
            if self.resumed is None:
                self.stepping.record(self._rows)
            else:
                self.resumed.restore(self.stepping)
            self._first = (self.stepping.steps, self.stepping.time)
            self._has_first_row = True
            if self.profiler is not None:
                self.profiler.restart(self.stepping.loop)

    def advance(self, until: float) -> None:
        """Step to a time in s, or until a failure, an early end or Ctrl-C; a run that ended takes no step."""
        if self.error is not None or self.early_end is not None:
            return
        self.interrupted = False
        start, pacing = time.perf_counter(), self.plan.pacing
        with self._end_on_failure(), catch_interrupts() as is_interrupted:
            self._pause()
            if pacing is not None and not self._is_paced:
                self._is_paced = True  # real time does not count the initialization
                pacing.begin(self.stepping.time)
            simulate(
                self.stepping,
                self._rows,
                lambda: self.stopped is not None or is_interrupted(),
                pacing,
                self._pause,
                until,
                # a condition ends the run at the first row that meets it, so it sees each step
                MOST_STEPS if self._stopping is None else 1,
            )
            self.interrupted = self.stopped is None and not self.stepping.reached(until)
        self.wall_s += time.perf_counter() - start

    def end(self) -> None:
        """Pass the remaining rows to the recorders, and end them."""
        start = time.perf_counter()
        self.over = True  # first, so that `discard` does not end recorders a second time
        try:
            if self.error is None:
                with self._end_on_failure():
                    self._pause()
        finally:
            with self._end_on_failure():
                self._buffer.end()
            if self.profiler is not None:
                self.profiler.close()
        self.wall_s += time.perf_counter() - start

    def discard(self) -> None:
        """End the recorders after another error. Ignore their own errors."""
        if self.profiler is not None:
            self.profiler.close()
        if not self.over:
            with contextlib.suppress(Exception):
                self._buffer.end()

    def close(self) -> None:
        """Free what the run holds of the FMU instances."""
        close_stepping(self.stepping)

    def _map_rows(self, size: int) -> Any:
        """Return memory for rows from the first recorder that has some."""
        return next((m for recorder in self.recorders if (m := recorder.map_rows(size)) is not None), None)

    def _pause(self) -> None:
        """Call `pause` of the recorders, after passing rows to them if `FLUSH_INTERVAL` is over."""
        if time.monotonic() - self._last_flush >= FLUSH_INTERVAL:
            self._buffer.flush()
            self._last_flush = time.monotonic()
        for recorder in self._begun_recorders:
            with recording(recorder):
                recorder.pause(self)

    @contextlib.contextmanager
    def _report_bad_checkpoint(self) -> Iterator[None]:
        """Report any error from a readable checkpoint with wrong content as an error of the checkpoint."""
        try:
            yield
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            if self.resumed is None:
                raise
            raise RunError(f"the checkpoint does not fit this run: {error!r}.") from error

    @contextlib.contextmanager
    def _end_on_failure(self) -> Iterator[None]:
        """Store a failure, or the wish of an FMU to end the run, instead of raising it."""
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
        """Store an error outside of the recorders with its time, if it is the first one of the run."""
        if self.error is None:
            at, stepped = self.stepping.time, isinstance(cause, RunError) and self.stepping.steps > 0
            # before the first step, the algorithm cannot have caused it
            warning = self.stepping.algorithm.warning() if stepped else None
            text = str(error) if warning is None else f"{error} {warning}"
            self.error = RunError(f"the run ended at t = {at:.6g} s: {text}", time=at, **error.fields)
            self.error.__cause__ = cause


def close_stepping(stepping: Stepping) -> None:
    """Free what a stepping and its algorithm hold of the FMU instances."""
    stepping.close()
    stepping.algorithm.close()


class CouplingEstimates:
    """Estimates the errors of runs one after another.

    A run that repeats the last one has its estimate. Many short runs save up their shares of time for one.

    Attributes:
        has_failed: Whether an FMU failed in the last call of `estimate`.
    """

    def __init__(self) -> None:
        self._key: tuple[object, ...] = ()
        self._last, self._saved_s = CouplingError(), 0.0
        self.has_failed = False

    def estimate(self, run: ActiveRun) -> CouplingError:
        """Return the coupling error of a run that has ended, or why it is not estimated.

        The FMUs of the run cannot be used afterwards.
        """
        self.has_failed, stepping = False, run.stepping
        estimate = stepping.estimate if isinstance(stepping, FixedSteps) else None
        if estimate is None or run.problem is not None or run.requested_end is not None:
            return run.coupling.without_estimate()
        key = str(stepping.algorithm), stepping.times, run.definition.system, run.steps
        if key == self._key:
            return self._last
        share = SHARE * run.wall_s
        # preparing a first run with such steps takes far longer; the runs that follow save up their shares
        allowed = share + (ALLOWANCE if key[:2] != self._key[:2] else self._saved_s)
        self._saved_s = 0.0 if allowed >= ALLOWANCE else allowed
        if allowed < ALLOWANCE:
            return CouplingError(not_estimated=EARLIER_RUN)
        self._last = estimate.estimate(allowed, run.wall_s / max(run.steps, 1))
        self._key, self.has_failed = key, self._last.is_fault
        return self._last
