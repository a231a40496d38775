"""The interface of all recorders."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from ..base.arrays import SignalType, Texts, Vector
from ..base.errors import RunError
from ..base.progress import Progress
from ..base.units import LinearTransformation, SiUnit
from ..master.stepping.stepping_base import Stepping
from ..master.stepping.timing import CommunicationPoints


@dataclass(frozen=True)
class RunLayout:
    """What a recorder needs to know before the first row.

    Each row has the time in s, then all signals, as doubles: Booleans are 0 or 1, enumerations the numbers of
    their values, and Strings positions in `texts`, or NaN in rows in which they were not read.

    Attributes:
        names: full names of the signals.
        units: units of the signals.
        times: start, stop and communication points, in s.
        recorded: positions of the signals to keep, in the order of their columns.
        steps_per_row: keep every n-th row.
        parameters: parameters of the components, by full name; Booleans are 0 or 1, Strings are left out.
        roles: signal by joint and role, such as `lift.x_L`.
        criteria: values of the option `criteria`.
        multiples: step multiples by component, without those that are 1.
        types: types of the signals by name; Real for those without an entry.
        texts: the texts of the run.
        notes: what a reader should know before the run, without full stops.
    """

    names: Sequence[str]
    units: Sequence[SiUnit | None]
    times: CommunicationPoints
    recorded: Sequence[int]
    steps_per_row: int = 1
    parameters: Mapping[str, float] = field(default_factory=dict)
    roles: Mapping[str, str] = field(default_factory=dict)
    criteria: Mapping[str, float | str] = field(default_factory=dict)
    multiples: Mapping[str, int] = field(default_factory=dict)
    types: Mapping[str, SignalType] = field(default_factory=dict)
    texts: Texts = field(default_factory=Texts)
    notes: Sequence[str] = ()

    @property
    def text_columns(self) -> list[int]:
        """Positions in a row of the signals that are Strings."""
        texts = {name for name, signal_type in self.types.items() if signal_type.is_text}
        return [1 + i for i, name in enumerate(self.names) if name in texts]


class Pause(Protocol):
    """A run between two stretches of steps."""

    @property
    def stepping(self) -> Stepping:
        """The stepping of the run."""
        ...

    @property
    def transformations(self) -> Mapping[int, LinearTransformation]:
        """Transformations of signals that recorders get in another unit, by position."""
        ...

    @property
    def over(self) -> bool:
        """Whether the last step is done."""
        ...

    def state_dict(self) -> Mapping[str, Any]:
        """Pass all rows to the recorders, and return their states by key when all are stored."""
        ...


class Recorder:
    """Base class of recorders, which receive the rows of a run in blocks. This one ignores them.

    `begin` is called first and `end` last, whatever happens between. They and `write` may raise OSError.
    Checkpoints keep what `state_dict` returns under `key`; `begin` gets it when a run continues there.

    Examples:
        >>> import emla_cosim as ec
        >>> class Peak(ec.Recorder):
        ...     value = 0.0
        ...
        ...     def begin(self, layout, state=None):
        ...         self.column = 1 + layout.names.index("lift.plant.v_L")
        ...
        ...     def write(self, rows):
        ...         self.value = max(self.value, abs(rows[:, self.column]).max())
        >>> peak = Peak()
        >>> result = ec.load("lift", stop_time=0.01).prepare().run(recorders=[peak])
        >>> bool(peak.value > 0.0)
        True
    """

    key = ""

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Begin a run, or continue one.

        Args:
            layout: names, units and times of the rows.
            state: what `state_dict` returned where the run continues; None for a new run.
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

    def state_dict(self) -> Any:
        """Return plain data from which a recorder can continue, or None."""

    def map_rows(self, size: int) -> Any:
        """Return memory of `size` bytes for rows, which another process can read; None without such memory.

        It is called before `begin`. The first recorder that has memory provides it.
        """

    def release(self, most: int) -> None:
        """Store rows that are lost with the process, unless they are among the last `most` rows received."""


class RecordingError(RunError):
    """A recorder failed."""


@contextmanager
def recording(recorder: Recorder) -> Iterator[None]:
    """Turn an OSError of a recorder into a RecordingError that names its file."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise RecordingError(f"{recorder} cannot be written: {reason}.") from error


class ProgressRecorder(Recorder):
    """Report notes on the run, and then the number of finished steps."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Report the notes, and that the simulation starts."""
        for note in layout.notes:
            self._progress.note(f"Note: {note}.")
        self._reported = 0
        self._progress.begin("simulating", layout.times.steps)

    def pause(self, run: Pause) -> None:
        """Report the steps since the last call."""
        times = run.stepping.times
        reached = round((run.stepping.time - times.start) / times.step)
        self._progress.advance(reached - self._reported)
        self._reported = reached
