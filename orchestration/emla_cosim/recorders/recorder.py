"""The interface of all recorders, and how rows come to them."""

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
    """What a recorder needs to know before the first row.

    Each row has the time in s, then all signals.

    Attributes:
        names: full names of the signals.
        units: units of the signals.
        times: start, stop and communication points, in s.
        recorded: positions of the signals to keep.
        every: keep every n-th row.
        parameters: numeric parameters of the components, by full name.
        roles: signal by joint and role, such as `lift.x_L`.
        criteria: values of the option `criteria`.
        exchanged: connections that carry continuous signals.
        bonds: power bonds by name.
        watched: whether steps have any length and not each of them has a row; `Stepping.watch` gets all.
        halved: whether each of these steps is done in two halves.
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
    """A run while nothing is stepped."""

    @property
    def stepping(self) -> Stepping:
        """Where the run is, and all that it remembers."""
        ...

    @property
    def shown(self) -> Mapping[int, LinearTransformation]:
        """Signals, by position, that recorders get in another unit."""
        ...

    @property
    def over(self) -> bool:
        """Whether the last step is done."""
        ...

    def memory(self) -> Mapping[str, Any]:
        """What all recorders remember, by their keys; all rows have reached them then."""
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


class RecordingError(RunError):
    """A recorder that could not take what it was given."""


BLOCK_ROWS, BLOCK_SIZE = 2000, 2**24
"""How many rows wait until they go to the recorders, and how many bytes they may have."""


class RowBuffer:
    """Room for rows that the stepping fills; full blocks go to the recorders.

    Every `every`-th communication point is to be recorded. Memory stays the same however long the
    run is, and hardly grows with the signals of a row. `shown` has signals, by position, that are passed on
    in another unit.
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
        """Free rows to fill, at least one and at most so many."""
        return self._block[self._filled : self._filled + most]

    def commit(self, count: int) -> None:
        """So many of them are filled. Raises RecordingError."""
        self._filled += count
        self._present.filled, self._present.recorded = self._filled, 0
        if self._filled == len(self._block):
            self.flush()

    def recover(self) -> float | None:
        """Take the rows that a process left waiting in this memory; the time of the last in s."""
        waiting = self._present.filled + self._present.recorded if self._present.room else 0
        if not waiting:
            return None
        last = float(self._block[waiting - 1, 0])
        self.commit(waiting)
        return last

    def flush(self) -> None:
        """Pass on what is there. Raises RecordingError."""
        rows, self._filled = self._block[: self._filled], 0
        if len(rows):
            self._present.filled = 0
            for signal, transformation in self._shown.items():
                column = rows[:, 1 + signal]
                column[:] = transformation.factor * column + transformation.offset
            rows = rows.view()
            rows.flags.writeable = False  # they go to the others too
            self._each(lambda recorder: recorder.write(rows))

    def end(self) -> None:
        """Pass on what is left and end the recorders, every one of them. Raises RecordingError."""
        try:
            self.flush()
        finally:
            self._each(lambda recorder: recorder.end())

    def _each(self, call: Callable[[Recorder], None]) -> None:
        """Call every recorder, also after one that fails; the first failure is raised then."""
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
    """Turn an OSError of a recorder into a RecordingError that names what could not be written."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise RecordingError(f"{recorder} cannot be written: {reason}.") from error
