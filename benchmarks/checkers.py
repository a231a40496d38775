"""Let several tools look for faults in the FMUs that are broken on purpose: python -m benchmarks.checkers.

FMPy and `emla verify` always run. Other tools are searched on PATH, or options name them; the script says
which are missing. A tool has its defaults, and gets one FMU in a process and folder of its own. It complains
about an FMU if its exit code is not 0, or if it prints a warning or an error.

A fault counts as found if the tool complains about the broken FMU in words that it does not use for the FMU
without the fault; numbers, paths and names of FMUs do not count as words. The FMU without the fault is the
good one with the most similar model description. The other answers:

- not found: it does not complain, or in the same words.
- crashed: a signal ended the tool.
- hung: it did not answer within the time limit.
- not applicable: it is not for this version of FMI, or it fails with the FMU without the fault, too.

`emla verify` is asked for the check of the fault, with the settings of its test, and for all checks of FMUs
that are not broken.
"""

import argparse
import csv
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import fmpy

from docs.paste import pasted
from fmu_verify.check import Verdict
from fmu_verify.settings import Settings
from tests.support.broken.asking import examined_all
from tests.support.broken.broken import Broken
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.editing import good_bytes
from tests.support.broken.examining import list_problems
from tests.support.broken.memory import build_memory_fmu
from tests.support.broken.table import BROKEN
from tests.support.broken.third import INTERVAL
from tests.support.broken.wide import build_wide_fmu
from tests.support.paths import ROOT

from .checker_tools import (
    CRASHED,
    FOUND,
    HUNG,
    NOT_APPLICABLE,
    NOT_FOUND,
    Answer,
    Checker,
    ask,
    find_checkers,
    fmi_version,
    read_description,
    without_paths,
)

GROUPS = {
    "file": ("archive", "binaries", "sources", "documents", "layered"),
    "description": ("description", "units", "variables", "structure"),
    "calls": ("instance", "calls", "state", "log", "process"),
    "behavior": (),
    "memory": ("sanitizer",),
    "references": ("reference", "related"),
}
"""Groups of checks by what the fault is in; a group of checks that is not listed is about behavior."""

GOOD, OTHER = "no fault", "other"
"""Groups of FMUs that are not broken: those that the broken ones are made of, and those of an option."""

OURS = "emla verify"
MOST_TEXT = 160
"""Characters of a message in the CSV file."""


def main() -> None:
    """Run all tools on all FMUs; write the CSV file and the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--fmusim", type=_file, metavar="PATH", help="fmusim")
    parser.add_argument("--vdmcheck2", type=_file, metavar="JAR", help="vdmcheck2.jar")
    parser.add_argument("--vdmcheck3", type=_file, metavar="JAR", help="vdmcheck3.jar")
    parser.add_argument(
        "--fmu-compliance-checker", type=_file, metavar="PATH", help="fmuCheck.linux64 or alike"
    )
    parser.add_argument(
        "--others", type=_file, nargs="*", default=[], metavar="FMU", help="FMUs that are counted apart"
    )
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write every answer to this file")
    parser.add_argument("--write", action="store_true", help="put the table into benchmarks/README.md")
    parser.add_argument("--limit", type=float, default=120.0, metavar="S", help="time of a tool in s")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="FMUs at the same time")
    parser.add_argument("--only", default="", metavar="TEXT", help="only broken FMUs with this in their name")
    arguments = parser.parse_args()
    checkers, missing = find_checkers(arguments)
    for name in missing:
        print(f"{name} is not on PATH, and no option names it: it does not run.", file=sys.stderr)
    broken = [b for b in BROKEN if arguments.only in b.name]
    with tempfile.TemporaryDirectory() as folder:
        rows = examine(checkers, broken, arguments.others, Path(folder), arguments.limit, arguments.jobs)
    if arguments.csv:
        with arguments.csv.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, [*rows[0]], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    text = summarize(rows, checkers, missing)
    print(text)
    if arguments.write:
        page = ROOT / "benchmarks" / "README.md"
        page.write_text(pasted(page.read_text(encoding="utf-8"), "checkers", text), "utf-8", newline="\n")


def _file(text: str) -> Path:
    """Return the path of an existing file, for a process with another working folder."""
    if not (path := Path(text).resolve()).is_file():
        raise argparse.ArgumentTypeError(f"{text} is not a file")
    return path


def examine(
    checkers: Sequence[Checker],
    broken: Sequence[Broken],
    further_paths: Sequence[Path],
    folder: Path,
    limit: float,
    jobs: int,
) -> list[dict[str, str]]:
    """Return a row for each FMU: what it is, and the answer of each tool.

    Args:
        checkers: The tools.
        broken: The FMUs with a fault.
        further_paths: FMUs whose complaints are counted apart.
        folder: Folder for the FMUs.
        limit: Time of a tool for one FMU in s.
        jobs: Number of FMUs at the same time.
    """
    (folder / "good").mkdir()
    origins = build_origins(folder / "good")
    names = {path: f"{path.stem} {fmi_version(path)}.0" for path in [*origins, *further_paths]}
    unbroken = [(Broken(name, "", "", lambda _, path=path: path), Settings()) for path, name in names.items()]
    by_name = examined_all([*unbroken, *((b, replace(b.settings, only=(b.check,))) for b in broken)], folder)
    known: dict[tuple[str, object], Answer] = {}

    def ask_all(path: Path) -> list[Answer]:
        return [ask(checker, path, limit, known) for checker in checkers]

    def row_of_whole(path: Path, answers: Sequence[Answer]) -> dict[str, str]:
        ours = [f"{check}: {text}" for check, text in list_problems(by_name[names[path]]).items()]
        row = {"fmu": names[path], "fmi": f"{fmi_version(path)}", "group": GOOD if path in origins else OTHER}
        row |= {"check": "", "fault": ""}
        row[OURS] = _cell(_verdict(ours), ours)
        for checker, answer in zip(checkers, answers, strict=True):
            row[checker.name] = _cell(answer.verdict or _verdict(answer.complaints), answer.complaints)
        return row

    def row_of_broken(broken_fmu: Broken) -> dict[str, str]:
        path = by_name[broken_fmu.name].path
        origin = nearest(path, origins)
        row = {"fmu": broken_fmu.name, "fmi": f"{fmi_version(origin)}", "group": group_of(broken_fmu.check)}
        row |= {"check": broken_fmu.check, "fault": broken_fmu.what}
        finding = by_name[broken_fmu.name][broken_fmu.check]
        is_found = finding.verdict in (Verdict.FAILED, Verdict.WARNING)
        row[OURS] = _cell(FOUND if is_found else NOT_FOUND, [finding.sentence] if is_found else [])
        for checker, answer, of_origin in zip(checkers, ask_all(path), good[origin], strict=True):
            row[checker.name] = compare(answer, path, of_origin, origin)
        return row

    with ThreadPoolExecutor(jobs) as pool:
        good = dict(zip(names, pool.map(ask_all, names), strict=True))
        rows = [row_of_whole(path, answers) for path, answers in good.items()]
        for row in pool.map(row_of_broken, broken):
            print(*row.values(), sep=" | ", file=sys.stderr, flush=True)
            rows.append(row)
    return rows


def build_origins(folder: Path) -> list[Path]:
    """Build the good FMUs of which the broken ones are made."""
    toys = {"Toy": good_bytes(), "Toy3": good_bytes(3), "Clocked": good_bytes(3, INTERVAL)}
    for name, content in toys.items():
        (folder / f"{name}.fmu").write_bytes(content)
    further = (build(folder) for build in (build_good_fmu, build_wide_fmu, build_memory_fmu))
    return [*(folder / f"{name}.fmu" for name in toys), *further]


def nearest(path: Path, origins: Sequence[Path]) -> Path:
    """Return the good FMU with the most similar model description; the first one if there is none."""

    def parts(of: Path) -> Counter[str]:
        return Counter(re.findall(r"<\w+|[\w.]+=\"[^\"]*\"", read_description(of)))

    own_parts = parts(path)
    shares = {
        origin: (parts_of_origin & own_parts).total() / (parts_of_origin | own_parts).total()
        for origin in origins
        if (parts_of_origin := parts(origin))
    }
    return max(shares, key=lambda origin: shares[origin])


def group_of(check: str) -> str:
    """Return the group of the table to which a check belongs."""
    prefix = check.partition(".")[0]
    return next((group for group, prefixes in GROUPS.items() if prefix in prefixes), "behavior")


def compare(answer: Answer, path: Path, of_origin: Answer, origin: Path) -> str:
    """Return the cell of a tool: its verdict about a broken FMU, with what it says first about the fault."""
    if of_origin.verdict or of_origin.exit_code:
        return NOT_APPLICABLE
    if answer.verdict:
        return _cell(answer.verdict, answer.complaints)
    usual = of_origin.words(origin)
    new = [line for words, line in answer.words(path).items() if words not in usual]
    return _cell(_verdict(new), new)


def _verdict(complaints: Sequence[str]) -> str:
    return FOUND if complaints else NOT_FOUND


def _cell(verdict: str, complaints: Sequence[str]) -> str:
    return f"{verdict}: {without_paths(complaints[0])}"[:MOST_TEXT] if complaints else verdict


def summarize(rows: Sequence[Mapping[str, str]], checkers: Sequence[Checker], missing: Sequence[str]) -> str:
    """Return the table: a line for each tool, a column for each group of faults."""
    by_group = {name: [row for row in rows if row["group"] == name] for name in [*GROUPS, GOOD, OTHER]}
    broken = [row for group in GROUPS for row in by_group[group]]
    head = ["Tool", *GROUPS, "all", "crashed", "hung", "FMUs without a fault", "other FMUs"]
    lines = [
        f"Made on {datetime.now(UTC):%Y-%m-%d} on {fmpy.platform}: {len(broken)} broken FMUs, "
        f"{len(by_group[GOOD])} without a fault, {len(by_group[OTHER])} others.",
        "",
        f"| {' | '.join(head)} |",
        f"|---|{'---:|' * (len(head) - 1)}",
    ]
    versions = {OURS: version("emla-cosim")} | {checker.name: checker.version for checker in checkers}
    for name in versions:
        cells = [_count(by_group[group], name, FOUND) for group in GROUPS]
        cells.append(_count(broken, name, FOUND))
        cells += [str(sum(row[name].startswith(verdict) for row in broken)) for verdict in (CRASHED, HUNG)]
        cells += [_count(by_group[group], name, FOUND, CRASHED, HUNG) for group in (GOOD, OTHER)]
        lines.append(f"| {f'{name} {versions[name]}'.strip()} | {' | '.join(cells)} |")
    if missing:
        lines += ["", f"Not there: {', '.join(missing)}."]
    return "\n".join(lines)


def _count(rows: Sequence[Mapping[str, str]], name: str, *verdicts: str) -> str:
    """Return for how many FMUs a tool has one of the verdicts, and to how many it applies."""
    cells = [row[name] for row in rows if row[name] != NOT_APPLICABLE]
    return f"{sum(cell.startswith(verdicts) for cell in cells)} of {len(cells)}" if cells else "-"


if __name__ == "__main__":
    main()
