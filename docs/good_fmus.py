"""Summarize what `emla verify` finds in FMUs of vendors.

    python -m docs.good_fmus REPORT.json...

The reports are those of `emla verify FMU... --json REPORT.json`. vendor-findings.csv has, for each check that
failed or warned, the number of FMUs, the tools that made them, and the clauses. verify.md shows the most
frequent ones.
"""

import csv
import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from docs.paste import pasted

PAGE, TABLE = (Path(__file__).parent / name for name in ("verify.md", "vendor-findings.csv"))
HEADER = ("verdict", "check", "fmus", "made_by", "clauses")

_FEWEST = 10
"""Fewest FMUs that fail a check that the page shows."""

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
    """Write the table of all reports and the part of it that the page shows."""
    reports = [json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]]
    with TABLE.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([HEADER, *count_findings(reports)])
    examined = [one for report in reports for one in report["examined"]]
    clean = sum(all(f["verdict"] not in _WORSE for f in one["findings"]) for one in examined)
    print(f"{len(examined)} FMUs, {clean} without a finding.")
    write_page()


def write_page() -> None:
    """Show the most frequent findings of the CSV file on the page."""
    with TABLE.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))[1:]
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(pasted(page, "vendor findings", make_table(rows)), encoding="utf-8", newline="\n")


def make_table(rows: Iterable[Sequence[str]]) -> str:
    """Return the checks that most FMUs fail, as a table in Markdown."""
    lines = ["| Failed check | FMUs | Made by | Clauses |", "|---|---:|---|---|"]
    for verdict, check, count, made_by, clauses in rows:
        if verdict == "failed" and int(count) >= _FEWEST:
            lines.append(f"| `{check}` | {count} | {made_by} | {clauses} |")
    return "\n".join(lines)


def count_findings(reports: Iterable[dict[str, Any]]) -> list[list[str]]:
    """Return a row of texts for each verdict and check, the most frequent first."""
    cases: dict[tuple[int, str], list[tuple[str, str]]] = defaultdict(list)
    for one in (one for report in reports for one in report["examined"]):
        for finding in one["findings"]:
            if finding["verdict"] in _WORSE:
                clause = finding["clause"]
                where = f"{clause['document']} {clause['section']}".removeprefix("FMI 2.0.4 ")
                cases[_WORSE.index(finding["verdict"]), finding["check"]].append((find_tool(one), where))
    rows = []
    for (verdict, check), seen in sorted(cases.items(), key=lambda row: (row[0][0], -len(row[1]), row[0][1])):
        tools, clauses = (", ".join(sorted({case[k] for case in seen})) for k in (0, 1))
        rows.append([_WORSE[verdict], check, str(len(seen)), tools, clauses])
    return rows


def find_tool(examined: dict[str, Any]) -> str:
    """Return the short name of the tool that made an FMU; the first word of its own name if it is unknown."""
    made_by = examined["facts"].get("made by", "unreadable")
    known = (short for part, short in _TOOLS.items() if part in made_by.lower())
    return next(known, made_by.split()[0])


if __name__ == "__main__":
    main()
