"""Summarize what `emla verify` finds in FMUs of vendors.

    python -m docs.good_fmus REPORT.json...

The reports are those of `emla verify FMU... --json REPORT.json`. The result is a table: for each check that
failed or warned, the number of FMUs, the tools that made them, and the sections whose sentences are broken.
"""

import json
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

_WORSE = ("failed", "warning")
_TOOLS = {
    "openmodelica": "OpenModelica",
    "dymola": "Dymola",
    "20-sim": "20-sim",
    "overture": "Overture",
    "reference": "Reference-FMUs",
    "cosimate": "CosiMate",
    "simulink": "Simulink",
    "matlab": "Simulink",
    "pythonfmu": "PythonFMU",
    "unifmu": "UniFMU",
    "hopsan": "Hopsan",
    "an unnamed tool": "unnamed",
    "none": "unnamed",
}


def main() -> None:
    """Print the table of all reports."""
    print(summarize(json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]))


def summarize(reports: Iterable[dict[str, Any]]) -> str:
    """Return a table of all findings, and how many FMUs have none."""
    examined = [one for report in reports for one in report["examined"]]
    rows: dict[tuple[int, str], list[tuple[str, str]]] = defaultdict(list)
    clean = 0
    for one in examined:
        found = [f for f in one["findings"] if f["verdict"] in _WORSE]
        clean += not found
        for f in found:
            clause = f["clause"]
            where = f"{clause['document']} {clause['section']}".removeprefix("FMI 2.0.4 ")
            rows[_WORSE.index(f["verdict"]), f["check"]].append((find_tool(one), where))
    lines = [
        f"{len(examined)} FMUs, {clean} without a finding.",
        "",
        "| Verdict | Check | FMUs | Made by | Broken sentence in |",
        "|---|---|---|---|---|",
    ]
    for (verdict, check), cases in sorted(rows.items(), key=lambda row: (row[0][0], -len(row[1]), row[0][1])):
        tools, places = (", ".join(sorted({case[k] for case in cases})) for k in (0, 1))
        lines.append(f"| {_WORSE[verdict]} | `{check}` | {len(cases)} | {tools} | {places} |")
    return "\n".join(lines)


def find_tool(examined: dict[str, Any]) -> str:
    """Return the short name of the tool that made an FMU; the first word of its own name if it is unknown."""
    made_by = examined["facts"].get("made by", "unreadable")
    known = (short for part, short in _TOOLS.items() if part in made_by.lower())
    return next(known, made_by.split()[0])


if __name__ == "__main__":
    main()
