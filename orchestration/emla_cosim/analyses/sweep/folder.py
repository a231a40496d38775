"""The folder of a sweep: a part for each finished chunk, merged to one table at the end."""

import contextlib
import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import polars

from ...base.errors import CommandError, RunError
from ...base.files import UNFINISHED, report_write_errors, write_atomically
from ..frame.outputs import AnalysisFolder
from ..variants.measures import VARIANT, Chunk, Measures, to_parquet
from .result import (
    COMPLETED,
    DESIGN,
    ENDS,
    NUMBERED,
    PARTS,
    RECORD,
    SERIES,
    UNFINISHED_SWEEP,
    SweepResult,
    make_result,
    read_parts,
    read_record,
)

_SWEEP_FILES = re.compile(rf"[0-9]{{9,}}\.parquet|{re.escape(DESIGN)}|{re.escape(UNFINISHED)}.*")
"""Names of parts, finished or being written."""


class SweepFolder(AnalysisFolder[SweepResult]):
    """The output folder of a sweep; it has `parts/` while the sweep is not complete."""

    inner = (PARTS, SERIES)
    _start_record: Mapping[str, Any]
    """The record when the variants began to run."""

    def check(self, identity: Mapping[str, Any], resume: bool) -> None:
        """Check that a sweep with this identity can start or resume here.

        Raises:
            CommandError: The folder has an unfinished sweep and `resume` is not set, a different sweep, or
                an inner folder with files that do not belong to a sweep.
        """
        record = self._record()
        for name in self.inner:
            path = self._real_path / name
            with report_write_errors(self.path):
                files = list(path.iterdir()) if path.is_dir() else []
            strange = [file for file in files if not record or not _SWEEP_FILES.fullmatch(file.name)]
            if strange or path.is_symlink() or (path.exists() and not path.is_dir()):
                raise CommandError(
                    f"'{self.path / name}' does not belong to a sweep; move it, or name another folder."
                )
        if resume and not record:
            raise CommandError(f"'{self.path}' has no sweep to resume; run without --resume.")
        if resume and (differing := _describe_difference(record.get("identity"), identity)):
            raise CommandError(
                f"the sweep in '{self.path}' cannot be resumed: it has different {differing}; "
                "name another folder."
            )
        if not resume and record and not self.is_complete and not self.overwrite:
            raise CommandError(
                f"'{self.path}' has an unfinished sweep; --resume continues it, --overwrite replaces it, or "
                "name another folder."
            )

    @property
    def is_complete(self) -> bool:
        """Whether the folder has a complete sweep."""
        return self._record().get("status") == COMPLETED

    def _record(self) -> dict[str, Any]:
        return read_record(self._real_path) if self.has_own_record() else {}

    def check_room(self, variants: int, figures: int, values_each: int) -> None:
        """Raise CommandError if the disk is too small. `values_each` counts values over time per variant."""
        needed = 8 * variants * (figures + values_each)
        with report_write_errors(self.path):
            free = shutil.disk_usage(self._real_path).free
        if needed > free:
            raise CommandError(
                f"the results of {variants} variants take up to {needed / 2**30:.3g} GiB, but "
                f"'{self.path}' has {free / 2**30:.3g} GiB left; keep fewer signals, or rows further apart."
            )

    def begin(self, record: Mapping[str, Any], about: polars.DataFrame, resume: bool) -> None:
        """Write the record and the columns that are known before the variants run.

        Args:
            record: The record, without status.
            about: These columns, by variant.
            resume: Whether to keep finished variants.

        Raises:
            RunError: Writing fails.
        """
        with report_write_errors(self.path):
            if not resume:
                for name in (PARTS, SERIES):
                    self._remove_parts(name)
                self.remove(self.outputs.tables)
                self.remove_drawn(self.pictures)
            # the record first: without it, the parts would be files of the user's
            earlier = self._record() if resume else {}
            self._start_record = {**earlier, **record, "status": UNFINISHED_SWEEP}
            self.write_json(RECORD, self._start_record)
            for name in (PARTS, SERIES):
                (self._real_path / name).mkdir(exist_ok=True)
            with write_atomically(self._real_path / PARTS / DESIGN) as stream:
                stream.write(to_parquet(about))
            for file in (self._real_path / SERIES).glob("*.parquet"):  # of chunks whose part was not written
                if not (self._real_path / PARTS / file.name).exists():
                    file.unlink()

    def _remove_parts(self, name: str) -> None:
        """Remove a folder of parts, but keep other files in it. May raise OSError."""
        files = sorted((self._real_path / name).glob("*.parquet"), key=lambda file: file.name != DESIGN)
        for file in files:  # the design first: `read_sweep` then notices
            if _SWEEP_FILES.fullmatch(file.name):
                file.unlink()
        with contextlib.suppress(OSError):
            (self._real_path / name).rmdir()

    def keep_chunk(self, chunk: Chunk, measures: Measures) -> None:
        """Write the series and the table of a chunk, each atomically. Raise RunError if writing fails."""
        name = f"{chunk.outcomes[0].number:09d}.parquet"
        with report_write_errors(self.path):
            if chunk.series is not None:  # before the part: a series without a part does not count
                with write_atomically(self._real_path / SERIES / name) as stream:
                    stream.write(chunk.series)
            with write_atomically(self._real_path / PARTS / name) as stream:
                stream.write(to_parquet(_tabulate_chunk(chunk, measures)))

    def list_finished(self) -> set[int]:
        """Return the numbers of finished variants. Raise CommandError if a part cannot be read."""
        numbers = set[int]()
        for file in (self._real_path / PARTS).glob(NUMBERED):
            try:
                numbers.update(polars.read_parquet(file)[VARIANT])
            except Exception as error:
                raise CommandError(
                    f"'{self.path / PARTS / file.name}' cannot be read; remove it to run its variants again."
                ) from error
        return numbers

    def finish(self, is_complete: bool, wall_s: float) -> None:
        """Merge the parts to the table, and write the record. If all variants are done, remove the parts.

        Args:
            is_complete: Whether all variants are done.
            wall_s: Further duration in s.

        Raises:
            RunError: Writing fails.
        """
        record = {**self._start_record, "wall_s": self._start_record.get("wall_s", 0.0) + wall_s}
        if (parts := read_parts(self._real_path, record["figures"])) is None:
            raise RunError(f"the output folder '{self.path}' changed while emla ran: its parts are gone.")
        result = make_result(self.path, record, *parts)
        self.keep(replace(result, complete=is_complete), is_final=False)
        if is_complete:  # from now on the table counts
            self.write_json(RECORD, {**self._record(), "status": COMPLETED})
            with contextlib.suppress(OSError):
                self._remove_parts(PARTS)
            with contextlib.suppress(OSError):
                (self._real_path / SERIES).rmdir()  # where there are none


def _tabulate_chunk(chunk: Chunk, measures: Measures) -> polars.DataFrame:
    """Return a table with a row for each outcome: number, status, problem, end and figures."""
    rows = [(o.number, o.status, o.problem, o.end_s) for o in chunk.outcomes]
    types = {n: polars.Boolean if n in measures.truths else polars.Float64 for n in measures.names}
    columns = [
        polars.Series(name, [o.figures.get(name) for o in chunk.outcomes], kind, strict=False)
        for name, kind in types.items()
    ]
    return polars.DataFrame(rows, schema=ENDS, orient="row").with_columns(columns)


def _describe_difference(earlier: Any, current: Mapping[str, Any]) -> str:
    """Return the names of differences between two identities, or an empty string."""
    if not isinstance(earlier, Mapping):
        return "contents"
    names = sorted(set(earlier) | set(current))
    return " and ".join(n for n in names if earlier.get(n) != json.loads(json.dumps(current.get(n))))
