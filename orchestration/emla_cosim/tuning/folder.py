"""What a tuning leaves in its folder."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.files import writing_to, written_whole
from ..sweeps.place import Place
from ..views.plots.style import save
from .picture import drawn
from .result import TuneResult

BEST, RECORD, HISTORY, PICTURE = "best.toml", "tune.json", "history.csv", "tuning.png"


class TuneFolder(Place):
    """`best.toml`, a scenario with the best gains; `history.csv`; `tune.json`; `tuning.png`."""

    what = "tuning"
    files = (BEST, RECORD, HISTORY, PICTURE)

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
        with writing_to(self.path), written_whole(self._place / PICTURE) as stream:
            save(drawn(result), stream)
        return self.path / PICTURE

    def _write(self, name: str, text: str) -> None:
        with written_whole(self._place / name) as stream:
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
