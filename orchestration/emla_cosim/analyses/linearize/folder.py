"""The output folder of a linearization."""

from ...views.folder import Folder
from ...views.pages.plain import to_plain
from .pictures import draw_bode, draw_nyquist
from .result import LinearizeResult

RECORD, TABLE, BODE, NYQUIST = "linearize.json", "responses.csv", "bode.png", "nyquist.png"


class LinearizeFolder(Folder):
    """`linearize.json` with margins or matrices; `responses.csv`, `bode.png`, `nyquist.png` of responses."""

    what = "linearization"
    files = (RECORD, TABLE)
    pictures = (BODE, NYQUIST)
    record_file = RECORD

    def keep(self, result: LinearizeResult, plots: bool) -> None:
        """Write all files. Raises RunError."""
        if not result.responses:
            self.remove((TABLE, *self.pictures))
        self.write_json(RECORD, to_plain(result.record))
        if not result.responses:
            return
        self.write(TABLE, result.table.write_csv().encode())
        if plots:
            self.draw(BODE, draw_bode(result))
        if plots and result.margins:
            self.draw(NYQUIST, draw_nyquist(result))
