"""Run other people's FMUs in FMPy and in this master, compare the results, and write tables.

    python docs/foreign_fmus.py FOLDER OUTPUT [--limit SECONDS] [--jobs N] [--only TEXT]
    python -m docs.paste docs/tools.md foreign OUTPUT

FOLDER is searched for FMUs; copies of one file count once. OUTPUT gets `fmus.csv`, a row for each FMU, and
`comparison.md`, the summary by tool. Every run has its own process and folder, because FMUs are foreign
programs. Start, stop and step are those of the FMU's default experiment, up to 1000 steps.
"""

import argparse
import csv
import hashlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

MOST_STEPS = 1000
MOST_LOCALS = 20
"""Number of local variables to compare of an FMU without outputs."""
AGREES = 1e-9
"""Largest difference relative to a signal's range that counts as agreement."""
TOLERANCES = 1e-4, 1e-7
"""Tolerances of the integrator for Model Exchange."""
FINER = 1e-3
"""FMPy's tolerance for Model Exchange divided by the master's: the difference is then the master's error."""
MOST_TOLERANCES = 10.0
"""Largest difference for Model Exchange that counts as agreement, in tolerances."""

RUNS = "yes"
HERE = Path(__file__).resolve()


@dataclass
class Row:
    """One FMU: where it comes from, what ran it, and the largest difference relative to a signal's range.

    FMUs for Model Exchange alone have a second difference, at the coarser one of the `TOLERANCES`.
    """

    fmu: str
    tool: str = ""
    version: str = ""
    kind: str = ""
    platforms: str = ""
    fmpy: str = ""
    fmpy_unchecked: str = ""
    emla: str = ""
    emla_lenient: str = ""
    signals: int = 0
    difference: float | None = None
    coarse_difference: float | None = None
    worst: str = ""
    reason: str = ""

    @property
    def compared(self) -> bool:
        """Whether both tools ran the FMU."""
        return RUNS in (self.fmpy, self.fmpy_unchecked) and RUNS in (self.emla, self.emla_lenient)

    @property
    def agrees(self) -> bool:
        """Whether the results agree; for Model Exchange within some tolerances, at two of them."""
        if self.difference is None:
            return False
        if self.coarse_difference is None:
            return self.difference <= AGREES
        pairs = zip((self.coarse_difference, self.difference), TOLERANCES, strict=True)
        return all(difference <= MOST_TOLERANCES * tolerance for difference, tolerance in pairs)


def main() -> None:
    """Run all FMUs of a folder, or one FMU with one tool in a child process."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--limit", type=float, default=120.0, help="time for one run in s")
    parser.add_argument("--jobs", type=int, default=2, help="runs at the same time")
    parser.add_argument("--only", default="", help="only FMUs whose path contains this text")
    arguments = parser.parse_args()
    files = [(path, name) for path, name in find_fmus(arguments.folder) if arguments.only in name]
    arguments.output.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(arguments.jobs) as pool:
        rows = list(pool.map(lambda file: examine(*file, arguments.limit), files))
    write_rows(rows, arguments.output / "fmus.csv")
    (arguments.output / "comparison.md").write_text(summarize(rows), encoding="utf-8", newline="\n")
    print(summarize(rows))


def find_fmus(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield each FMU below a folder once, with its name there."""
    seen = set()
    for path in sorted(folder.rglob("*.fmu")):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file() and digest not in seen:
            seen.add(digest)
            yield path, str(path.relative_to(folder))


def examine(path: Path, name: str, limit: float) -> Row:
    """Run an FMU in both tools and return its row."""
    row = Row(name)
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        description = fmpy.read_model_description(str(path), validate=False)
    except Exception as error:
        row.reason = f"not an FMU that FMPy can read: {one_line(error)}"
        return row
    row.tool, row.version = tool_name(description.generationTool), str(description.fmiVersion)
    kinds = {"CS": description.coSimulation, "ME": description.modelExchange}
    row.kind = "+".join(kind for kind, means in kinds.items() if means is not None)
    folders = [n.split("/")[1] for n in names if re.match(r"binaries/[^/]+/.", n)]
    sources = ["sources"] if any(re.match(r"sources/.+\.c", n) for n in names) else []
    row.platforms = " ".join([*dict.fromkeys(folders), *sources])
    variables = {"variables": variables_of(description)}
    for binary in (True, False):  # some FMUs accept only decimal step sizes
        settings = {**times_of(description, binary), **variables}
        if row.kind == "ME":
            run_both(row, path, {**settings, **tolerances(TOLERANCES[0])}, limit)
            row.coarse_difference = row.difference
            settings |= tolerances(TOLERANCES[1])
        run_both(row, path, settings, limit)
        if row.compared:
            break
    row.reason = reason_of(row)
    print(f"{name}: {row.fmpy[:60]} | {row.emla[:90]} | {row.difference}", file=sys.stderr, flush=True)
    return row


def run_both(row: Row, path: Path, settings: Mapping[str, Any], limit: float) -> None:
    """Run an FMU in both tools, and without their checks where these refuse it; compare the signals."""
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        row.fmpy, theirs = run_apart("fmpy", path, {**settings, "validate": True}, work, limit)
        if row.fmpy != RUNS:
            row.fmpy_unchecked, theirs = run_apart("fmpy", path, {**settings, "validate": False}, work, limit)
        row.emla, ours = run_apart("emla", path, settings, work, limit)
        if row.emla != RUNS:
            row.emla_lenient, ours = run_apart("emla", path, {**settings, "lenient": True}, work, limit)
        if theirs is not None and ours is not None:
            row.signals, row.difference, row.worst = compare(theirs, ours)


def tolerances(tolerance: float) -> dict[str, float]:
    """Return the tolerances of the integrators in both tools."""
    return {"tolerance": tolerance, "finer_tolerance": FINER * tolerance}


def variables_of(description: Any) -> list[str]:
    """Return the outputs that are numbers; without any, some local variables."""
    numbers = [v for v in description.modelVariables if v.type != "String"]
    outputs = [v.name for v in numbers if v.causality == "output"]
    return outputs or [v.name for v in numbers if v.causality == "local"][:MOST_LOCALS]


def times_of(description: Any, binary: bool) -> dict[str, float]:
    """Return start, stop and step of the default experiment, limited to the largest number of steps.

    Without a step size there, choose a power of two or (not `binary`) of ten. Sums and multiples of powers of
    two are exact, so that both tools pass the same times.
    """
    experiment = description.defaultExperiment
    said = {n: getattr(experiment, n, None) for n in ("startTime", "stopTime", "stepSize")}
    start = float(said["startTime"] or 0.0)
    stop = float(said["stopTime"]) if said["stopTime"] is not None else start + 1.0
    stop = stop if stop > start else start + 1.0
    step = float(said["stepSize"] or 0.0)
    if not 0.0 < step <= stop - start:
        base = 2.0 if binary else 10.0
        step = base ** math.floor(math.log((stop - start) / 500, base))
    steps = min(MOST_STEPS, max(1, math.floor((stop - start) / step + 1e-9)))
    return {"start_time": start, "stop_time": float(f"{start + steps * step:.12g}"), "step_size": step}


def run_apart(
    tool: str, path: Path, settings: Mapping[str, Any], work: Path, limit: float
) -> tuple[str, dict[str, Any] | None]:
    """Run an FMU in a process of its own; return RUNS or the reason, and the signals."""
    target = work / f"{tool}.npz"
    target.unlink(missing_ok=True)
    asked = json.dumps({"tool": tool, "fmu": str(path.resolve()), "target": str(target), **settings})
    command = [sys.executable, str(HERE.parent / "foreign_run.py"), asked]
    with subprocess.Popen(
        command,
        cwd=work,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    ) as process:
        try:
            said = process.communicate(timeout=limit)[0].decode(errors="replace")
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return f"no end within {limit:g} s", None
    if process.returncode == 0 and target.exists():
        with np.load(target) as kept:
            return RUNS, dict(kept)
    failed = [line for line in said.splitlines() if line.startswith("FAILED ")]
    if failed:
        return one_line(failed[-1].removeprefix("FAILED ")), None
    return f"its process ended with code {process.returncode}", None


def compare(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> tuple[int, float | None, str]:
    """Return the number of common signals, the largest difference relative to the range, and its signal."""
    worst, which = 0.0, ""
    common = [n for n in theirs if n in ours and n != "time"]
    if len(theirs["time"]) != len(ours["time"]):
        # one of them ended early: compare what both have
        rows = min(len(theirs["time"]), len(ours["time"]))
        which = f"{len(theirs['time'])} rows in FMPy, {len(ours['time'])} here"
    else:
        rows = len(theirs["time"])
    for name in common:
        a, b = np.asarray(theirs[name][:rows], float), np.asarray(ours[name][:rows], float)
        same = (a == b) | (np.isnan(a) & np.isnan(b))
        if same.all():
            continue
        size, largest = np.nanmax(a) - np.nanmin(a), np.nanmax(np.abs(a))
        if size <= 1e-9 * largest:  # constant but for rounding
            size = largest
        size = size or 1.0
        apart = float(np.max(np.where(same, 0.0, np.nan_to_num(np.abs(a - b), nan=np.inf))) / size)
        if apart > worst:
            worst, which = apart, f"{name} {which}".strip()
    return len(common), worst if common else None, which


def reason_of(row: Row) -> str:
    """Return why an FMU does not run here, or where it differs."""
    if RUNS in (row.emla, row.emla_lenient):
        if row.difference is not None and not row.agrees:
            return f"differs in {row.worst}"
        return ""
    return row.emla_lenient or row.emla


def tool_name(text: str | None) -> str:
    """Return the name of a tool without version."""
    for name in ("Dymola", "OpenModelica", "20-sim", "Overture", "Simulink", "Hopsan", "Reference FMUs"):
        if name.lower() in str(text).lower():
            return name
    if "FMI Kit for Simulink" in str(text):
        return "Simulink"
    return " ".join(str(text).split()[:2]).rstrip(",:") if text and text != "none" else "not stated"


def summarize(rows: Sequence[Row]) -> str:
    """Return a table with a line for each tool, and a list of the reasons."""
    lines = [
        f"Made on {datetime.now(UTC):%Y-%m-%d} with FMPy {fmpy.__version__} on {fmpy.platform}: "
        f"{len(rows)} different FMUs.",
        "",
        "| Made by | FMUs | Run in FMPy | Run here | With `--lenient` | Agree | Model Exchange |",
        "|---|---|---|---|---|---|---|",
    ]
    tools = Counter(row.tool or "unreadable" for row in rows)
    for tool, count in sorted(tools.items(), key=lambda item: (-item[1], item[0])):
        lines.append(_line(tool, count, [r for r in rows if (r.tool or "unreadable") == tool]))
    lines.append(_line("all", len(rows), rows))
    return "\n".join(lines) + "\n"


def _line(tool: str, count: int, rows: Sequence[Row]) -> str:
    theirs = sum(RUNS in (r.fmpy, r.fmpy_unchecked) for r in rows)
    lenient = sum(r.emla_lenient == RUNS for r in rows)
    ours = sum(r.emla == RUNS for r in rows) + lenient
    exact, integrated = (
        [r.agrees for r in rows if r.difference is not None and (r.coarse_difference is not None) == me]
        for me in (False, True)
    )
    agree = [f"{sum(found)} of {len(found)}" for found in (exact, integrated)]
    return f"| {tool} | {count} | {theirs} | {ours} | {lenient} | {agree[0]} | {agree[1]} |"


def write_rows(rows: Sequence[Row], path: Path) -> None:
    """Write all rows as CSV."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [f.name for f in fields(Row)])
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def one_line(error: object) -> str:
    """Return the first 300 letters of a message in one line."""
    return " ".join(str(error).split())[:300]


if __name__ == "__main__":
    main()
