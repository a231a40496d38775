"""The output folder of a sizing."""

from collections.abc import Iterable
from pathlib import Path

from ...views.folder import Folder
from ...views.pages.plain import to_plain
from .pictures import draw_pictures, name_picture
from .result import SizeResult

RECORD, TABLE, CYCLES, PAGE = "size.json", "limits.csv", "cycles.csv", "size.html"


class SizeFolder(Folder):
    """`size.json`, `limits.csv`, `cycles.csv`, plots of each joint, and `size.html`.

    Args:
        path: The folder.
        overwrite: Whether to replace files that emla did not write.
        plots: Whether to draw plots.
        report: Whether to write the page.
    """

    what = "sizing"
    files = (RECORD, TABLE, CYCLES)
    pictures = (PAGE,)
    record_file = RECORD

    def __init__(self, path: Path, overwrite: bool, plots: bool, report: bool) -> None:
        super().__init__(path, overwrite)
        self._plots, self._report = plots, report

    def check_pictures(self, joints: Iterable[str]) -> None:
        """Raise CommandError if plots of these joints would replace files that emla did not write."""
        self.check_files(map(name_picture, joints) if self._plots else ())

    def keep(self, result: SizeResult) -> None:
        """Write all files. Raises RunError."""
        self.write_json(RECORD, to_plain(result.record))
        self.write(TABLE, result.table.write_csv().encode())
        self.write(CYCLES, result.cycles.write_csv().encode())
        if self._plots:
            for name, figure in draw_pictures(result):
                self.draw(name, figure)
        if self._report:
            from .page import render_page  # importing it loads jinja2

            self.write(PAGE, render_page(result).encode())
