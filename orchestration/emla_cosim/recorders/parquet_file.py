"""results.parquet: the same table in columns, with the units of the signals."""

import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import polars

from ..arrays import Vector
from .recorder import Outline
from .table import Table

PART = 2**22
"""Numbers in a part; so many are held in memory."""

UNITS = "units"
"""The entry of the file's metadata that has the units of its columns, as a JSON object."""


class ParquetFile(Table):
    """Writes a table to a Parquet file: closed parts while the run goes on, one file in the end.

    The parts are in a folder beside the file, `results.parquet.parts`, as long as the run goes on.
    """

    quick_memory = False  # it writes a part

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._parts = self.path.with_name(f"{self.path.name}.parts")

    def __str__(self) -> str:
        return str(self.path)

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Begin a folder of parts, of which an earlier file is the first where a run continues it."""
        super().begin(outline, memory)
        units = {n: str(outline.units[i]) for n, i in zip(self.names[1:], outline.recorded, strict=True)}
        self._metadata = {UNITS: json.dumps({"time": "s"} | {n: u for n, u in units.items() if u != "None"})}
        self._blocks: list[polars.DataFrame] = []
        self._held = self._count = self._rows = 0
        earlier = self._earlier(int(memory["kept"])) if memory is not None else None
        shutil.rmtree(self._parts, ignore_errors=True)
        self._parts.mkdir()
        if earlier is not None:
            self._hold(earlier)

    def append(self, rows: Vector) -> None:
        """Hold these rows, and write a part when there are many."""
        self._hold(polars.from_numpy(rows.copy(), schema=self.names))

    def end(self) -> None:
        """Append the last row if it was not due, and make one file of the parts."""
        super().end()
        self._close_part()
        unfinished = self._parts / "all"
        parts = sorted(self._parts.glob("*.parquet"))
        if parts:
            polars.scan_parquet(parts).sink_parquet(unfinished, metadata=self._metadata)
        else:
            empty = polars.DataFrame(schema=dict.fromkeys(self.names, polars.Float64))
            empty.write_parquet(unfinished, metadata=self._metadata)
        unfinished.replace(self.path)
        shutil.rmtree(self._parts, ignore_errors=True)

    def memory(self) -> Any:
        """How many rows came, and how many were kept; the latter are on disk now."""
        self._close_part()
        return {**super().memory(), "kept": self._rows}

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Columns by name; one that the file does not have is left out."""
        table = polars.scan_parquet(self.path)
        chosen = [n for n in names if n in self.names]
        frame = table.select(chosen)
        if most is not None:
            frame = frame.gather_every(max(-(-self._rows // most), 1))
        found = frame.collect()
        return {n: found[n].to_numpy() for n in chosen}

    def _hold(self, block: polars.DataFrame) -> None:
        self._blocks.append(block)
        self._rows += len(block)
        self._held += block.width * len(block)
        if self._held >= PART:
            self._close_part()

    def _close_part(self) -> None:
        if self._blocks:
            part = self._parts / f"{self._count:06}"
            polars.concat(self._blocks).write_parquet(part)
            part.rename(part.with_suffix(".parquet"))
            self._blocks, self._held, self._count = [], 0, self._count + 1

    def _earlier(self, rows: int) -> polars.DataFrame | None:
        """The first rows of what an earlier run left, if it had these columns and so many rows."""
        for source in self._left():
            try:
                found = polars.read_parquet(source)
            except (OSError, polars.exceptions.PolarsError):
                continue
            if found.columns == self.names and len(found) >= rows:
                return found.head(rows)
        return None

    def _left(self) -> Iterator[Path | list[Path]]:
        """Where rows of an earlier run may be: in its file, or in the parts of one that was ended."""
        yield self.path
        if parts := sorted(self._parts.glob("*.parquet")):
            yield parts
