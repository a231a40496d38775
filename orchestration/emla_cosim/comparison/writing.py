"""What a comparison leaves in its folder: rows, tables, what repeats each run, and pictures."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.files import writing_to, written_whole
from ..run.run_record import plain, versions
from ..sweeps.place import Place
from ..views.plots.style import save
from .contest import Contest
from .pictures import NAMES
from .result import CompareResult

CSV, MARKDOWN, RECORD = "comparison.csv", "comparison.md", "comparison.json"


class CompareFolder(Place):
    """The folder of a comparison; see `Place` for errors."""

    what = "comparison"
    files = (CSV, MARKDOWN, RECORD, *(f"{picture}.png" for picture in NAMES))

    def write(self, result: CompareResult, record: Mapping[str, Any]) -> None:
        """Write all but pictures, each file whole; those of an earlier comparison go. Raises RunError."""
        contents = {
            CSV: result.rows.write_csv().encode(),
            MARKDOWN: result.markdown().encode(),
            RECORD: (json.dumps(record, indent=2) + "\n").encode(),
        }
        with writing_to(self.path):
            for picture in NAMES:
                (self._place / f"{picture}.png").unlink(missing_ok=True)
            for name, content in contents.items():
                with written_whole(self._place / name) as stream:
                    stream.write(content)


def draw(result: CompareResult, folder: Path) -> list[Path]:
    """Draw all pictures of a result into a folder, and return their files. Raises RunError."""
    found = list[Path]()
    with writing_to(folder):
        for name, figure in result.figures().items():
            found.append(folder / f"{name}.png")
            with written_whole(found[-1]) as stream:
                save(figure, stream)
    return found


def record_of(contest: Contest, result: CompareResult) -> dict[str, Any]:
    """All that repeats the comparison: versions, options, systems, and the start values of each run."""
    return {
        "name": result.name,
        "table": result.table,
        "status": "completed" if result.complete else "unfinished",
        "entrants": list(result.entrants),
        "options": plain(contest.options),
        "notes": list(result.notes),
        "wall_s": result.wall_s,
        "versions": dict(versions()),
        "systems": [group.identity for group in contest.groups],
        "runs": [
            {
                "run": number,
                "scenario": heat.scenario,
                "case": heat.case.name,
                "joints": list(heat.joints),
                "controller": heat.entrant.called,
                "gains": heat.entrant.gains,
                "seed": heat.seed,
                "system": heat.group,
                "set": plain(heat.own["set"]),
                "fault": [str(fault) for fault in heat.own.get("fault", ())],
                "command": shlex.join(command) if (command := contest.command(number)) else None,
            }
            for number, heat in enumerate(contest.heats)
        ],
    }
