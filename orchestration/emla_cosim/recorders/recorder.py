"""The interface of all recorders, and the buffer that passes rows to them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..base.arrays import Vector
from ..base.errors import RunError
from ..base.signal_types import SignalType, Texts
from ..base.units import LinearTransformation, SiUnit
from ..master.algorithms.continuous_connections import ContinuousConnection
from ..master.stepping.stepping_base import Stepping
from ..master.stepping.timing import CommunicationPoints
from ..sandbox import black_box
from ..system.bond import Bond


@dataclass(frozen=True)
class Outline:
    """What a recorder needs to know before the first row.

    Each row has the time in s, then all signals, as doubles: Booleans are 0 or 1, enumerations the numbers of
    their values, and Strings positions in `texts`, or NaN in rows in which they were not read.

    Attributes:
        names: full names of the signals.
        units: units of the signals.
        times: start, stop and communication points, in s.
        recorded: positions of the signals to keep, in the order of their columns.
        every: keep every n-th row.
        parameters: parameters of the components, by full name; Booleans are 0 or 1, Strings are left out.
        roles: signal by joint and role, such as `lift.x_L`.
        criteria: values of the option `criteria`.
        exchanged: connections that carry continuous signals.
        bonds: power bonds by name.
        watched: whether steps have any length and not each of them has a row; `Stepping.watch` gets all.
        halved: whether each of these steps is done in two halves.
        types: types of the signals by name; Real for those without an entry.
        texts: the texts of the run.
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
    types: Mapping[str, SignalType] = field(default_factory=dict)
    texts: Texts = field(default_factory=Texts)

    @property
    def text_columns(self) -> list[int]:
        """Positions in a row of the signals that are Strings."""
        texts = {name for name, found in self.types.items() if found.is_text}
        return [1 + i for i, name in enumerate(self.names) if name in texts]


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

    def memory(self, now: bool = False) -> Mapping[str, Any]:
        """Pass all rows to the recorders, and return their states by key, `now` or when all are stored."""
        ...


class Recorder:
    """Base class of recorders, which receive the rows of a run in blocks. This one ignores them.

    `begin` is called first and `end` last, whatever happens between. They and `write` may raise OSError.
    Checkpoints keep what `memory` returns under `key`; `begin` gets it when a run continues there.

    Examples:
        >>> import emla_cosim as ec
        >>> class Peak(ec.Recorder):
        ...     value = 0.0
        ...
        ...     def begin(self, outline, memory=None):
        ...         self.column = 1 + outline.names.index("lift.plant.v_L")
        ...
        ...     def write(self, rows):
        ...         self.value = max(self.value, abs(rows[:, self.column]).max())
        >>> peak = Peak()
        >>> result = ec.load("lift", stop_time=0.01).prepare().run(recorders=[peak])
        >>> bool(peak.value > 0.0)
        True
    """

    key = ""

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Begin a run, or continue one.

        Args:
            outline: names, units and times of the rows.
            memory: what `memory` returned where the run continues; None for a new run.
        """

    def write(self, rows: Vector) -> None:
        """Receive rows.

        Args:
            rows: array of shape (n, 1 + signals): time in s, then all signals. It is reused; copy what you
                keep.
        """

    def pause(self, run: Pause) -> None:
        """Do other work while nothing is stepped: called a few times per second, and at the end."""

    def end(self) -> None:
        """End the run and finish pending work."""

    def memory(self) -> Any:
        """Return plain data from which a recorder can continue, or None."""

    def memory_now(self) -> Any:
        """Return `memory` without waiting for threads, for a process that shares the memory of this one."""
        return self.memory()


class RecordingError(RunError):
    """A recorder failed."""


BLOCK_ROWS, BLOCK_SIZE = 4000, 2**24
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
        texts: Positions in a row of Strings. A row that has one is passed on at once, because another process
            that finishes this run has no texts.
    """

    def __init__(
        self,
        width: int,
        recorders: Sequence[Recorder],
        every: int = 1,
        block_rows: int = BLOCK_ROWS,
        shown: Mapping[int, LinearTransformation] | None = None,
        texts: Sequence[int] = (),
    ) -> None:
        self.every = every
        self._recorders = recorders
        self._shown, self._texts = shown or {}, list(texts)
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
        if self._filled == len(self._block) or self._has_texts():
            self.flush()

    def _has_texts(self) -> bool:
        return bool(self._texts) and bool(np.isfinite(self._block[self._filled - 1, self._texts]).any())

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
