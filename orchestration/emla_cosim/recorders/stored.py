"""The table of a run that was kept in a folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import polars

from ..base.arrays import Vector
from ..base.errors import CommandError
from .csv_file import columns_of, read_csv

_REFERENCE = "the run to compare with"


@dataclass(frozen=True)
class StoredRun:
    """A table of results on disk: `names` of its columns, without time; sentences call it `what`."""

    path: Path
    names: Sequence[str]
    what: str = _REFERENCE

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Columns by name, `time` in s among them if it is named. Raises CommandError.

        Of more than `most` rows only every n-th may be given.
        """
        try:
            if self.path.suffix == ".parquet":
                frame = polars.read_parquet(self.path, columns=list(names))
                every = 1 if most is None else max(-(-len(frame) // most), 1)
                return {name: frame[name].cast(polars.Float64).to_numpy()[::every] for name in names}
            return read_csv(self.path, names, most)
        except Exception as error:  # polars has many kinds
            raise _unreadable(self.path, self.what, error) from error


def stored_run(place: Path, what: str = _REFERENCE) -> StoredRun:
    """The run in a folder of results, or in a table of its own; CommandError where there is none.

    Sentences call it `what`.
    """
    kept = [place / "results.csv", place / "results.parquet"] if place.is_dir() else [place]
    path = next((p for p in kept if p.exists()), None)
    if path is None:
        missing = "has no results.csv or results.parquet" if place.is_dir() else "is not there"
        raise CommandError(f"{what}, '{place}', {missing}.")
    if not path.is_file():
        raise CommandError(f"{what}, '{path}', cannot be read: it is no file.")
    try:
        names = _columns(path)
    except Exception as error:
        raise _unreadable(path, what, error) from error
    if names[:1] != ["time"] or len(names) < 2:
        raise CommandError(f"{what}, '{path}', must have 'time' as its first column, and signals.")
    return StoredRun(path, names[1:], what)


def _columns(path: Path) -> list[str]:
    if path.suffix == ".parquet":
        return list(polars.read_parquet_schema(path))
    return columns_of(path)


def _unreadable(path: Path, what: str, error: Exception) -> CommandError:
    reason = getattr(error, "strerror", None) or str(error).splitlines()[0].rstrip(".")
    return CommandError(f"{what}, '{path}', cannot be read: {reason}.")
