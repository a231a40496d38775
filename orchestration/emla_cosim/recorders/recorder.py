"""The interface of all recorders, and the buffer that passes rows to them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..base.arrays import Vector
from ..base.errors import RunError
from ..base.units import LinearTransformation, SiUnit
from ..master.algorithms.continuous_connections import ContinuousConnection
from ..master.stepping.stepping_base import Stepping
from ..master.stepping.timing import CommunicationPoints
from ..sandbox import black_box
from ..system.bond import Bond


@dataclass(frozen=True)
class Outline:
    """What recorders know before the first row.

    Args:
        names: Names of the signals. Rows have the time in s, then these signals.
        units: Units of the signals.
        times: The communication points of the run.
        recorded: Positions of the signals to keep.
        every: Every `every`-th row is kept.
        parameters: Numeric parameters of the components, by full name.
        roles: Names of signals or parameters by role, such as `lift.x_L`.
        criteria: The user's criteria for the verdicts on joints.
        exchanged: The continuous connections.
        bonds: The power bonds by name.
        watched: Whether steps have any length and not all have a row; `Stepping.watch` gets all.
        halved: Whether each step is done in two halves.
    """

    names: Sequence[str]
    units: Sequence[SiUnit | None]
    times: CommunicationPoints
    recorded: Sequence[int]
    every: int = 1
    parameters: Mapping[str, float] = field(default_factory=dict)
    roles: Mapping[str, str] = field(default_factory=dict)
    criteria: Mapping[str, float | str] = field(default_factory=dict)
    exchanged: Sequence[ContinuousConnection] = ()
    bonds: Mapping[str, Bond] = field(default_factory=dict)
    watched: bool = False
    halved: bool = False


class Pause(Protocol):
    """A run between two stretches of steps."""

    @property
    def stepping(self) -> Stepping:
        """The stepping of the run."""
        ...

    @property
    def shown(self) -> Mapping[int, LinearTransformation]:
        """Transformations of signals that recorders get in another unit, by position."""
        ...

    @property
    def over(self) -> bool:
        """Whether the last step is done."""
        ...

    def memory(self) -> Mapping[str, Any]:
        """Pass all rows to the recorders, and return their states by key."""
        ...


class Recorder:
    """Take the rows of a run block by block. The methods of this base class do nothing.

    `begin` is called first, and `end` last, also after errors. `begin`, `write` and `end` may raise OSError.
    Checkpoints keep the result of `memory`, which must be plain data, under `key`. A run that continues from
    a checkpoint passes it to `begin`.
    """

    key = ""

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Begin a run, or continue from a recorder with this `memory`."""

    def write(self, rows: Vector) -> None:
        """Take one row or more: time, then all signals. Copy what you keep; the array is reused."""

    def pause(self, run: Pause) -> None:
        """Called between steps, several times per second, and after the last step."""

    def end(self) -> None:
        """Finish pending work after the run."""

    def memory(self) -> Any:
        """Return the state as plain data, from which another recorder can continue; None without one."""


class RecordingError(RunError):
    """A recorder failed."""


BLOCK_ROWS, BLOCK_SIZE = 2000, 2**24
"""Number of rows in a block for the recorders, and its largest size in bytes."""


class RowBuffer:
    """A buffer of rows that the stepping fills. Full blocks are passed to the recorders.

    Its size does not depend on the length of the run, and hardly on the number of signals.

    Args:
        width: Number of values in a row.
        recorders: The recorders.
        every: Every `every`-th communication point is recorded.
        block_rows: Largest number of rows in a block.
        shown: Transformations of signals that recorders get in another unit, by position.
    """

    def __init__(
        self,
        width: int,
        recorders: Sequence[Recorder],
        every: int = 1,
        block_rows: int = BLOCK_ROWS,
        shown: Mapping[int, LinearTransformation] | None = None,
    ) -> None:
        self.every = every
        self._recorders = recorders
        self._shown = shown or {}
        block_rows = max(min(block_rows, BLOCK_SIZE // (8 * width)), 1)
        memory = black_box.reserve_rows(block_rows * width * 8)
        self._block = np.frombuffer(memory).reshape(block_rows, width)
        self._present = black_box.current_activity()
        self._filled = 0

    def room(self, most: int) -> Vector:
        """Return free rows to fill: at least one, at most `most`."""
        return self._block[self._filled : self._filled + most]

    def commit(self, count: int) -> None:
        """Take the first `count` of the free rows as filled. Raises RecordingError."""
        self._filled += count
        self._present.filled, self._present.recorded = self._filled, 0
        if self._filled == len(self._block):
            self.flush()

    def recover(self) -> float | None:
        """Take the rows that an ended process left in this memory, and return the last time in s."""
        waiting = self._present.filled + self._present.recorded if self._present.room else 0
        if not waiting:
            return None
        last = float(self._block[waiting - 1, 0])
        self.commit(waiting)
        return last

    def flush(self) -> None:
        """Pass the filled rows to the recorders. Raises RecordingError."""
        rows, self._filled = self._block[: self._filled], 0
        if len(rows):
            self._present.filled = 0
            for signal, transformation in self._shown.items():
                column = rows[:, 1 + signal]
                column[:] = transformation.factor * column + transformation.offset
            rows = rows.view()
            rows.flags.writeable = False  # all recorders get the same array
            self._each(lambda recorder: recorder.write(rows))

    def end(self) -> None:
        """Pass the remaining rows to the recorders, and end all of them. Raises RecordingError."""
        try:
            self.flush()
        finally:
            self._each(lambda recorder: recorder.end())

    def _each(self, call: Callable[[Recorder], None]) -> None:
        """Call every recorder, also after a failure, then raise the first failure."""
        failure: BaseException | None = None
        for recorder in self._recorders:
            try:
                with recording(recorder):
                    call(recorder)
            except BaseException as error:
                failure = failure or error
        if failure is not None:
            raise failure


@contextmanager
def recording(recorder: Recorder) -> Iterator[None]:
    """Turn an OSError of a recorder into a RecordingError that names its file."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise RecordingError(f"{recorder} cannot be written: {reason}.") from error
