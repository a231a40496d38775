"""What a tuning leaves in its folder."""

import contextlib
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..errors import CommandError
from ..files import place_of, writing_to, written_whole
from ..locking import alone
from ..results.style import save
from .picture import drawn
from .result import TuneResult

BEST, RECORD, HISTORY, PICTURE = "best.toml", "tune.json", "history.csv", "tuning.png"


class TuneFolder:
    """`best.toml`, a scenario with the best gains; `history.csv`; `tune.json`; `tuning.png`."""

    def __init__(self, path: Path) -> None:
        """Nothing is made yet."""
        self.path = path

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """No other run writes here meanwhile; CommandError where one does, or the folder cannot be made."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise CommandError(f"the output folder '{self.path}' cannot be written: {reason}.") from error
        for name in (BEST, RECORD, HISTORY, PICTURE):
            place_of(self.path / name, "the file of the tuning")
        with alone(self.path):
            yield

    def keep(self, result: TuneResult, record: Mapping[str, Any], scenario: Mapping[str, Any] | None) -> None:
        """Write what is there so far, but for the picture. Raises RunError.

        `scenario` is what makes a scenario file of the gains; None where only Python has the scenario.
        """
        with writing_to(self.path):
            best = {**(scenario or {}), "set": {**(scenario or {}).get("set", {}), **result.best.set}}
            self._write(BEST, _toml({"description": f"Gains found by the tuning {result.name}", **best}))
            self._write(RECORD, json.dumps(_plain(record), indent=2) + "\n")
            self._write(HISTORY, result.history.write_csv())

    def draw(self, result: TuneResult) -> Path:
        """Draw the picture. Raises RunError."""
        with writing_to(self.path), written_whole(self.path / PICTURE) as stream:
            save(drawn(result), stream)
        return self.path / PICTURE

    def _write(self, name: str, text: str) -> None:
        with written_whole(self.path / name) as stream:
            stream.write(text.encode())


def _plain(value: Any) -> Any:
    """Data with null where a number does not exist: JSON has no NaN."""
    if isinstance(value, Mapping):
        return {str(name): _plain(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, (str, int, float, bool, type(None))) else str(value)


def _toml(content: Mapping[str, Any]) -> str:
    """Plain data as TOML: keys first, then tables, whose names are quoted."""
    lines = [f"{key} = {_inline(value)}" for key, value in content.items() if not isinstance(value, Mapping)]
    for name, table in content.items():
        if isinstance(table, Mapping) and table:
            lines += ["", f"[{name}]", *(f"{json.dumps(key)} = {_inline(x)}" for key, x in table.items())]
    return "\n".join([*lines, ""])


def _inline(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_inline(x)}" for k, x in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, (bool, int, float)):
        return json.dumps(value)
    return json.dumps(str(value), ensure_ascii=False)
