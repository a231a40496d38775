"""The output folder of a tuning."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...views.folder import Folder
from ...views.pages.plain import to_plain
from ..frame.scenario_text import format_scenario
from .pictures import draw_picture
from .result import TuneResult

BEST, RECORD, HISTORY, PICTURE = "best.toml", "tune.json", "history.csv", "tuning.png"


class TuneFolder(Folder):
    """`best.toml`, a scenario with the best gains; `history.csv`; `tune.json`; `tuning.png`."""

    what = "tuning"
    files = (BEST, RECORD, HISTORY)
    pictures = (PICTURE,)
    record_file = RECORD

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
        described = f"Gains found by the tuning {result.name}"
        self.write_json(RECORD, to_plain(record))
        self.write(BEST, format_scenario(described, scenario, result.best.set).encode())
        self.write(HISTORY, result.history.write_csv().encode())

    def draw_result(self, result: TuneResult) -> Path:
        """Draw the picture, and return its file. Raises RunError."""
        return self.draw(PICTURE, draw_picture(result))
