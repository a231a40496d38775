"""The output folder of a tuning."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.files import report_write_errors
from ..base.ownership import has_entries
from ..views.folder import Folder
from ..views.pages.plain import to_plain
from .pictures import draw_picture
from .result import TuneResult

BEST, RECORD, HISTORY, PICTURE = "best.toml", "tune.json", "history.csv", "tuning.png"


class TuneFolder(Folder):
    """`best.toml`, a scenario with the best gains; `history.csv`; `tune.json`; `tuning.png`."""

    what = "tuning"
    files = (BEST, RECORD, HISTORY)
    pictures = (PICTURE,)
    record_file, is_record = RECORD, has_entries("plan", "best", "runs")

    def keep(self, result: TuneResult, record: Mapping[str, Any], scenario: Mapping[str, Any] | None) -> None:
        """Write all files but the picture.

        Args:
            result: The result so far.
            record: The content of `tune.json`.
            scenario: The content of a scenario file, to which the gains are added; None for a scenario that
                exists only in Python.

        Raises:
            RunError: A file cannot be written.
        """
        with report_write_errors(self.path):
            best = {**(scenario or {}), "set": {**(scenario or {}).get("set", {}), **result.best.set}}
            described = {"description": f"Gains found by the tuning {result.name}", **best}
            self.write(BEST, _toml(described).encode())
            self.write_json(RECORD, to_plain(record))
            self.write(HISTORY, result.history.write_csv().encode())

    def draw_result(self, result: TuneResult) -> Path:
        """Draw the picture, and return its file. Raises RunError."""
        with report_write_errors(self.path):
            return self.draw(PICTURE, draw_picture(result))


def _toml(content: Mapping[str, Any]) -> str:
    """Return plain data as TOML: keys first, then tables with quoted names."""
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
