"""The folder of a sweep: a part for each finished chunk, merged to one table at the end."""

import contextlib
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars

from ...base.errors import CommandError
from ...base.files import UNFINISHED, read_text, report_write_errors, write_atomically
from ...views.folder import Folder
from ..variants.data import PROBLEM, STATUS, VARIANT, Chunk, to_parquet
from ..variants.measures import Measures
from .pictures import PICTURES

TABLE, RECORD, SERIES, PARTS = "variants.parquet", "sweep.json", "series", "parts"
WORST = "worst.txt"
DESIGN = "design.parquet"
"""In `PARTS`: the columns of all variants that are known before they run."""

COMPLETED, UNFINISHED_SWEEP = "completed", "unfinished"

_OURS = re.compile(rf"[0-9]{{9,}}\.parquet|{re.escape(DESIGN)}|{re.escape(UNFINISHED)}.*")
"""Names of parts, finished or being written."""

_NUMBERED = "[0-9]*.parquet"
"""Pattern of parts."""

_ENDS = {
    VARIANT: polars.Int64,
    STATUS: polars.String,
    PROBLEM: polars.String,
    "end_s": polars.Float64,
}


class SweepFolder(Folder):
    """The files of a sweep: `variants.parquet`, `series/`, `sweep.json`, and `parts/` while incomplete."""

    what = "sweep"
    files = (TABLE, WORST, RECORD)
    pictures = tuple(f"{kind}.png" for kind in PICTURES)
    inner = (PARTS, SERIES)
    record_file = RECORD

    def check(self, identity: Mapping[str, Any], resume: bool) -> None:
        """Check that a sweep with this identity can start or resume here.

        Raises:
            CommandError: The folder has an unfinished sweep and `resume` is not set, or a different sweep.
        """
        found = self.record()
        self._check_places(begun=bool(found))
        if resume and not found:
            raise CommandError(f"'{self.path}' has no sweep to resume; run without --resume.")
        if resume and (differing := _describe_difference(found.get("identity"), identity)):
            raise CommandError(
                f"the sweep in '{self.path}' cannot be resumed: it has different {differing}; "
                "name another folder."
            )
        if not resume and found and not self.is_complete and not self.overwrite:
            raise CommandError(
                f"'{self.path}' has an unfinished sweep; --resume continues it, --overwrite replaces it, or "
                "name another folder."
            )

    def _check_places(self, begun: bool) -> None:
        """Raise CommandError if an inner folder has files that do not belong to a sweep."""
        for name in (PARTS, SERIES):
            place = self._place / name
            with report_write_errors(self.path):
                there = list(place.iterdir()) if place.is_dir() else []
            strange = [file for file in there if not begun or not _OURS.fullmatch(file.name)]
            if strange or place.is_symlink() or (place.exists() and not place.is_dir()):
                raise CommandError(
                    f"'{self.path / name}' does not belong to a sweep; move it, or name another folder."
                )

    @property
    def is_complete(self) -> bool:
        """Whether the folder has a complete sweep."""
        return self.record().get("status") == COMPLETED

    def check_room(self, variants: int, figures: int, values_each: int) -> None:
        """Raise CommandError if the disk is too small. `values_each` counts values over time per variant."""
        needed = 8 * variants * (figures + values_each)
        with report_write_errors(self.path):
            free = shutil.disk_usage(self._place).free
        if needed > free:
            raise CommandError(
                f"the results of {variants} variants take up to {needed / 2**30:.3g} GiB, but "
                f"'{self.path}' has {free / 2**30:.3g} GiB left; keep fewer signals, or rows further apart."
            )

    def begin(self, record: Mapping[str, Any], about: polars.DataFrame, resume: bool) -> None:
        """Start a sweep, or resume it (see `check`).

        Args:
            record: Content of sweep.json.
            about: Columns by variant that are known before the run.
            resume: Whether to keep finished variants.

        Raises:
            RunError: Writing fails.
        """
        with report_write_errors(self.path):
            if not resume:
                for name in (PARTS, SERIES):
                    self._remove_parts(name)
                self.remove((*self.pictures, TABLE, WORST))
            # the record first: without it, the parts would be files of the user's
            earlier = self.record() if resume else {}
            self.write_json(RECORD, {**earlier, **record, "status": UNFINISHED_SWEEP})
            for name in (PARTS, SERIES):
                (self._place / name).mkdir(exist_ok=True)
            with write_atomically(self._place / PARTS / DESIGN) as stream:
                stream.write(to_parquet(about))
            for file in (self._place / SERIES).glob("*.parquet"):  # of chunks whose part was not written
                if not (self._place / PARTS / file.name).exists():
                    file.unlink()

    def _remove_parts(self, name: str) -> None:
        """Remove a folder of parts, but keep other files in it. May raise OSError."""
        files = sorted((self._place / name).glob("*.parquet"), key=lambda file: file.name != DESIGN)
        for file in files:  # the design first: `read_unfinished` then notices
            if _OURS.fullmatch(file.name):
                file.unlink()
        with contextlib.suppress(OSError):
            (self._place / name).rmdir()

    def record(self) -> dict[str, Any]:
        """Read sweep.json; return nothing if there is no record. Raise CommandError if it cannot be read."""
        return self.record_of(self._place) if self.has_own_record() else {}

    @staticmethod
    def record_of(folder: Path) -> dict[str, Any]:
        """Read sweep.json in a folder. Raise CommandError if it cannot be read."""
        try:
            found = json.loads(read_text(folder / RECORD, "the record of the sweep"))
        except ValueError as error:
            raise CommandError(f"'{folder / RECORD}' cannot be read: {error}.") from error
        if not isinstance(found, dict):
            raise CommandError(f"'{folder / RECORD}' is not the record of a sweep.")
        return found

    def write_record(self, entries: Mapping[str, Any]) -> None:
        """Add entries to sweep.json. Raise RunError if writing fails."""
        self.write_json(RECORD, {**self.record(), **entries})

    def keep(self, chunk: Chunk, measures: Measures) -> None:
        """Write the results of a chunk atomically. Raise RunError if writing fails."""
        name = f"{chunk.outcomes[0].number:09d}.parquet"
        with report_write_errors(self.path):
            if chunk.series is not None:  # before the part: a series without a part does not count
                with write_atomically(self._place / SERIES / name) as stream:
                    stream.write(chunk.series)
            with write_atomically(self._place / PARTS / name) as stream:
                stream.write(to_parquet(_frame(chunk, measures)))

    def finished(self) -> set[int]:
        """Return the numbers of finished variants. Raise CommandError if a part cannot be read."""
        parts = self._parts()
        return set() if parts is None else set(parts[VARIANT])

    def merge(self, about: polars.DataFrame, measures: Measures) -> None:
        """Write variants.parquet: `about` (columns by variant) joined with the results of all parts."""
        parts = self._parts()
        if parts is None:
            parts = _frame(Chunk([], 0.0), measures)
        found = about.join(parts, on=VARIANT, how="inner").sort(VARIANT)
        self.write(TABLE, to_parquet(found))

    def close(self, whole: bool, wall_s: float) -> None:
        """Record the duration in s and the status. If all variants are done, remove the parts."""
        earlier = self.record()
        spent = earlier.get("wall_s", 0.0) + wall_s
        self.write_record({"wall_s": spent, "status": COMPLETED if whole else UNFINISHED_SWEEP})
        if whole:
            with contextlib.suppress(OSError):
                self._remove_parts(PARTS)
            with contextlib.suppress(OSError):
                (self._place / SERIES).rmdir()  # where there are none

    def _parts(self) -> polars.DataFrame | None:
        files = sorted((self._place / PARTS).glob(_NUMBERED))
        tables = [self._part(file) for file in files]
        return polars.concat(tables, how="vertical") if tables else None

    def _part(self, file: Path) -> polars.DataFrame:
        try:
            return polars.read_parquet(file)
        except Exception as error:
            raise CommandError(
                f"'{self.path / PARTS / file.name}' cannot be read; remove it to run its variants again."
            ) from error


def read_unfinished(folder: Path, figures: Sequence[str]) -> tuple[polars.DataFrame, list[Path]] | None:
    """Read the finished variants of a sweep that runs, or that was killed.

    Args:
        folder: The folder of the sweep.
        figures: Names of the figures.

    Returns:
        The table so far, and the files of its signals; None if the parts are gone: the sweep is complete.
    """
    parts = sorted((folder / PARTS).glob(_NUMBERED))
    empty = polars.DataFrame(schema=_ENDS | dict.fromkeys(figures, polars.Float64))
    try:
        tables = [polars.read_parquet(file) for file in parts] or [empty]
        about = polars.read_parquet(folder / PARTS / DESIGN)
    except FileNotFoundError:
        return None
    signals = [file for part in parts if (file := folder / SERIES / part.name).exists()]
    return about.join(polars.concat(tables), on=VARIANT, how="inner").sort(VARIANT), signals


def _frame(chunk: Chunk, measures: Measures) -> polars.DataFrame:
    rows = [(o.number, o.status, o.problem, o.end_s) for o in chunk.outcomes]
    ends = polars.DataFrame(rows, schema=_ENDS, orient="row")
    columns = [
        polars.Series(
            name,
            [o.figures.get(name) for o in chunk.outcomes],
            polars.Boolean if name in measures.truths else polars.Float64,
            strict=False,
        )
        for name in measures.names
    ]
    return ends.with_columns(columns)


def _describe_difference(before: Any, now: Mapping[str, Any]) -> str:
    """Return the names of differences between two identities, or an empty string."""
    if not isinstance(before, Mapping):
        return "contents"
    names = sorted(set(before) | set(now))
    found = [n for n in names if before.get(n) != json.loads(json.dumps(now.get(n)))]
    return " and ".join(found)
