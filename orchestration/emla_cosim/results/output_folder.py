"""The output folder of a run: its files by name, the sinks that fill them, and their state."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from ..errors import CommandError
from ..units import LinearTransformation
from .csv_file import CsvFile, Position
from .metrics import JointMetrics, MetricsSink
from .plots import FIGURES, plot_run
from .recorder import Recorder, Selection

RESULTS, METRICS, RECORD = "results.csv", "metrics.json", "run.json"


class OutputFolder:
    """A folder for the results of one run; an earlier run's files stay until a `Recording` begins."""

    def __init__(self, path: Path) -> None:
        """Make the folder and see that it can be written; CommandError if not."""
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=path):
                pass
        except OSError as error:
            raise CommandError(f"the output folder '{path}' cannot be written: {error.strerror}.") from error

    @property
    def results(self) -> Path:
        """The file of recorded rows."""
        return self.path / RESULTS

    def clear(self, keep_results: bool) -> None:
        """Remove what an earlier run left under the same names. May raise OSError."""
        removed = [METRICS, RECORD, *(f"{figure}.png" for figure in FIGURES)]
        for name in removed if keep_results else [RESULTS, *removed]:
            (self.path / name).unlink(missing_ok=True)

    def write_json(self, name: str, content: object) -> None:
        """Write one of the JSON files. May raise OSError."""
        (self.path / name).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")

    def draw(self, joints: Sequence[str], done: Callable[[str], None]) -> list[Path]:
        """Draw the pictures of these joints; returns their files. May raise OSError."""
        return plot_run(self.results, joints, self.path, done)


class Recording:
    """Everything that takes rows while a run goes on: results.csv with every n-th row, and the metrics.

    `selected` are the positions of the signals that results.csv holds, `shown` what is recorded in
    another unit, see `Recorder`. `after` is the memory of an earlier recording that this one continues.
    """

    def __init__(
        self,
        folder: OutputFolder,
        joints: Sequence[str],
        names: Sequence[str],
        every: int,
        after: Mapping[str, Any] | None = None,
        selected: Sequence[int] | None = None,
        shown: Mapping[int, LinearTransformation] | None = None,
    ) -> None:
        """Begin the files; raises OSError."""
        folder.clear(keep_results=after is not None)
        position = Position(**after["results"]) if after is not None else None
        chosen = range(len(names)) if selected is None else selected
        self._csv_file = CsvFile(folder.results, [names[i] for i in chosen], every, position)
        self._metrics = MetricsSink(joints, names)
        if after is not None:
            self._metrics.remember(after["metrics"])
        table = self._csv_file if selected is None else Selection(self._csv_file, selected)
        self.recorder = Recorder(1 + len(names), [table, self._metrics], shown=shown)

    def memory(self) -> dict[str, Any]:
        """Plain data from which another recording can continue. May raise OSError."""
        self.recorder.flush()
        return {"results": asdict(self._csv_file.position), "metrics": self._metrics.memory()}

    def metrics(self) -> dict[str, JointMetrics]:
        """Metrics by joint of all that was recorded."""
        return self._metrics.results()
