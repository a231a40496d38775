"""Run other people's FMUs in FMPy and in this master, compare the results, and write tables.

    python docs/foreign_fmus.py FOLDER OUTPUT [--limit SECONDS] [--jobs N] [--only TEXT] [--kind ME]

FOLDER is searched for FMUs; copies of one file count once. OUTPUT gets `fmus.csv`, a row for each FMU and
kind (co-simulation, Model Exchange), and `comparison.md`, the summary by tool. Every run has its own process
and folder, because FMUs are foreign programs. Start, stop and step are those of the FMU's default experiment,
up to 1000 steps. An FMU without a step size gets a power of two, and a decimal one if FMPy fails with it.

Co-simulation has to agree with FMPy to 1e-9 of each signal's range. Model Exchange runs at two tolerances,
and each has to agree within ten times the tolerance with FMPy at its tightest tolerance.
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
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

MOST_STEPS = 1000
AGREES = 1e-9
"""Largest difference relative to a signal's range that counts as agreement."""

TOLERANCES = (1e-4, 1e-7)
"""Tolerances of Model Exchange."""

TIGHTEST = 1e-10
"""Tolerance of FMPy, with which Model Exchange is compared."""

KINDS = {"CS": "CoSimulation", "ME": "ModelExchange"}
RUNS = "yes"
HERE = Path(__file__).resolve()


@dataclass
class Row:
    """One kind of an FMU: its origin, what ran it, the largest difference relative to a signal's range."""

    fmu: str
    tool: str = ""
    version: str = ""
    kind: str = ""
    platforms: str = ""
    fmpy: str = ""
    fmpy_unchecked: str = ""
    emla: str = ""
    emla_lenient: str = ""
    step: float = 0.0
    signals: int = 0
    difference: float | None = None
    by_tolerance: str = ""
    agrees: bool | None = None
    worst: str = ""
    reason: str = ""


def main() -> None:
    """Run all FMUs of a folder, or one FMU with one tool in a child process."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--limit", type=float, default=120.0, help="time for one run in s")
    parser.add_argument("--jobs", type=int, default=2, help="runs at the same time")
    parser.add_argument("--only", default="", help="only FMUs whose path contains this text")
    parser.add_argument("--kind", choices=[*KINDS], help="only this kind")
    arguments = parser.parse_args()
    files = [(path, name) for path, name in find_fmus(arguments.folder) if arguments.only in name]
    arguments.output.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(arguments.jobs) as pool:
        rows = list[Row]()
        for of_file in pool.map(lambda file: examine(*file, arguments.limit, arguments.kind), files):
            rows += of_file
            write_rows(rows, arguments.output / "fmus.csv")  # a stopped script keeps what it has
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


def examine(path: Path, name: str, limit: float, only: str | None = None) -> list[Row]:
    """Run an FMU in both tools; return a row for each of its kinds."""
    row = Row(name)
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        description = fmpy.read_model_description(str(path), validate=False)
    except Exception as error:
        row.reason = f"not an FMU that FMPy can read: {one_line(error)}"
        return [row]
    row.tool, row.version = tool_name(description.generationTool), str(description.fmiVersion)
    folders = [n.split("/")[1] for n in names if re.match(r"binaries/[^/]+/.", n)]
    sources = ["sources"] if any(re.match(r"sources/.+\.c", n) for n in names) else []
    row.platforms = " ".join([*dict.fromkeys(folders), *sources])
    kinds = {"CS": description.coSimulation, "ME": description.modelExchange}
    return [
        examine_kind(replace(row, kind=kind), path, description, limit)
        for kind, means in kinds.items()
        if means is not None and only in (None, kind)
    ]


def examine_kind(row: Row, path: Path, description: Any, limit: float) -> Row:
    """Run one kind of an FMU in both tools, and fill its row."""
    settings = {"fmi_type": KINDS[row.kind], "signals": signals_of(description)}
    theirs_at = {"tolerance": TIGHTEST} if row.kind == "ME" else {}
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        for times in dict.fromkeys(times_of(description, decimal) for decimal in (False, True)):
            settings |= dict(zip(("start_time", "stop_time", "step_size"), times, strict=True))
            row.step, row.fmpy_unchecked = settings["step_size"], ""
            asked = {**settings, **theirs_at}
            row.fmpy, theirs = run_apart("fmpy", path, {**asked, "validate": True}, work, limit)
            if row.fmpy != RUNS:
                row.fmpy_unchecked, theirs = run_apart(
                    "fmpy", path, {**asked, "validate": False}, work, limit
                )
            if theirs is not None:
                break
        loosest = {"tolerance": TOLERANCES[0]} if row.kind == "ME" else {}
        row.emla, ours = run_apart("emla", path, {**settings, **loosest}, work, limit)
        lenient = {"lenient": True} if row.emla != RUNS else {}
        if lenient:
            row.emla_lenient, ours = run_apart("emla", path, {**settings, **loosest, **lenient}, work, limit)
        if theirs is not None and ours is not None:
            row.signals, row.difference, row.worst = compare(theirs, ours)
            row.agrees = None if row.difference is None else row.difference <= AGREES
            if row.kind == "ME" and row.difference is not None:
                found = {TOLERANCES[0]: row.difference}
                for tolerance in TOLERANCES[1:]:
                    asked = {**settings, **lenient, "tolerance": tolerance}
                    ours = run_apart("emla", path, asked, work, limit)[1]
                    found[tolerance] = math.inf if ours is None else compare(theirs, ours)[1] or 0.0
                row.by_tolerance = " ".join(f"{t:g}: {d:.1e}" for t, d in found.items())
                row.agrees = all(d <= 10.0 * t for t, d in found.items())
    row.reason = reason_of(row)
    print(
        f"{row.fmu} {row.kind}: {row.fmpy[:60]} | {row.emla[:90]} | {row.difference} {row.by_tolerance}",
        file=sys.stderr,
        flush=True,
    )
    return row


def signals_of(description: Any) -> list[str] | None:
    """Return the signals to compare: None for all outputs, or numeric locals if there are no outputs."""
    numeric = [v for v in description.modelVariables if v.type in ("Real", "Integer", "Boolean")]
    if any(v.causality == "output" for v in numeric):
        return None
    moving = ("continuous", "discrete")
    names = [v.name for v in numeric if v.causality == "local" and v.variability in moving]
    return names[:200] or None


def times_of(description: Any, decimal: bool) -> tuple[float, float, float]:
    """Return start, stop and step of the default experiment, limited to the largest number of steps."""
    experiment = description.defaultExperiment
    said = {n: getattr(experiment, n, None) for n in ("startTime", "stopTime", "stepSize")}
    start = float(said["startTime"] or 0.0)
    stop = float(said["stopTime"]) if said["stopTime"] is not None else start + 1.0
    stop = stop if stop > start else start + 1.0
    step = float(said["stepSize"] or 0.0)
    if not 0.0 < step <= stop - start:
        if decimal:
            step = float(f"1e{math.floor(math.log10((stop - start) / 500))}")
        else:  # sums and multiples of powers of two are exact, so that both tools pass the same times
            step = 2.0 ** math.floor(math.log2((stop - start) / 500))
    steps = min(MOST_STEPS, max(1, math.floor((stop - start) / step + 1e-9)))
    return start, float(f"{start + steps * step:.12g}"), step


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
    if len(theirs["time"]) != len(ours["time"]):  # one of them ended early
        return len(common), math.inf, f"{len(theirs['time'])} rows in FMPy, {len(ours['time'])} here"
    for name in common:
        a, b = np.asarray(theirs[name], float), np.asarray(ours[name], float)
        same = (a == b) | (np.isnan(a) & np.isnan(b))
        if same.all():
            continue
        size, largest = np.nanmax(a) - np.nanmin(a), np.nanmax(np.abs(a))
        if size <= 1e-9 * largest:  # constant but for rounding
            size = largest
        size = size or 1.0
        apart = float(np.max(np.where(same, 0.0, np.nan_to_num(np.abs(a - b), nan=np.inf))) / size)
        if apart > worst:
            worst, which = apart, name
    return len(common), worst if common else None, which


def reason_of(row: Row) -> str:
    """Return why an FMU does not run here, or where it differs."""
    if RUNS not in (row.emla, row.emla_lenient):
        return row.emla_lenient or row.emla
    if row.agrees is False:
        return f"differs in {row.worst} by {row.by_tolerance or f'{row.difference:.1e}'}"
    return ""


def tool_name(text: str | None) -> str:
    """Return the name of a tool without version."""
    for name in ("Dymola", "OpenModelica", "20-sim", "Overture", "Simulink", "Hopsan", "Reference FMUs"):
        if name.lower() in str(text).lower():
            return name
    if "FMI Kit for Simulink" in str(text):
        return "Simulink"
    return " ".join(str(text).split()[:2]).rstrip(",:") if text and text != "none" else "not stated"


def summarize(rows: Sequence[Row]) -> str:
    """Return a table with a line for each tool and kind, and the FMUs that only FMPy runs, or that differ."""
    files = {row.fmu for row in rows}
    lines = [
        f"Made on {datetime.now(UTC):%Y-%m-%d} with FMPy {fmpy.__version__} on {fmpy.platform}: "
        f"{len(files)} different FMUs. An FMU with both kinds counts in two lines.",
        "",
        "| Made by | Kind | FMUs | Run in FMPy | with `validate=False` | Run here "
        "| with `--lenient` | Agree |",
        "|---|---|---|---|---|---|---|---|",
    ]
    groups = Counter((row.tool or "unreadable", row.kind) for row in rows)
    for kind in ("CS", "ME", ""):
        of_kind = {tool: n for (tool, k), n in groups.items() if k == kind}
        for tool in sorted(of_kind, key=lambda tool: (-of_kind[tool], tool)):
            lines.append(
                _line(tool, kind, [r for r in rows if (r.tool or "unreadable", r.kind) == (tool, kind)])
            )
        if of_kind and kind:
            lines.append(_line("all", kind, [r for r in rows if r.kind == kind]))
    open_ones = [r for r in rows if _runs_in_fmpy(r) and (r.agrees is False or not _runs_here(r))]
    if open_ones:
        lines += [
            "",
            "FMPy runs these, and they do not run or agree here:",
            "",
            "| FMU | Kind | Reason |",
            "|---|---|---|",
        ]
        lines += [f"| `{Path(r.fmu).name}` ({r.tool}) | {r.kind} | {_cell(r)} |" for r in open_ones]
    return "\n".join(lines) + "\n"


def _cell(row: Row) -> str:
    """Return the reason of a row without the name of the file, for a table."""
    return re.sub(r"^'[^']*' ", "", row.reason).replace("|", "\\|")


def _runs_in_fmpy(row: Row) -> bool:
    return RUNS in (row.fmpy, row.fmpy_unchecked)


def _runs_here(row: Row) -> bool:
    return RUNS in (row.emla, row.emla_lenient)


def _line(tool: str, kind: str, rows: Sequence[Row]) -> str:
    compared = [r.agrees for r in rows if r.agrees is not None]
    counts = (
        len(rows),
        sum(map(_runs_in_fmpy, rows)),
        sum(r.fmpy_unchecked == RUNS for r in rows),
        sum(map(_runs_here, rows)),
        sum(r.emla_lenient == RUNS for r in rows),
        f"{sum(compared)} of {len(compared)}",
    )
    return f"| {tool} | {kind} | {' | '.join(map(str, counts))} |"


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
