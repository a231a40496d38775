"""Let several tools look for faults in the test FMUs that are broken on purpose.

    python -m docs.verifiers OUTPUT [--tool 'NAME=COMMAND {}']...

`emla verify` and the validation of FMPy always run. COMMAND is any other tool; `{}` is the FMU, and an exit
code other than 0 means that it complains. A fault counts as found if a tool complains about the broken FMU,
but not about the same FMU without the fault. Ours is asked for the check of the fault. OUTPUT gets
`verifiers.csv`, a row for each FMU, and `comparison.md`.
"""

import argparse
import csv
import os
import shlex
import signal
import subprocess
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import fmpy
from fmpy.validation import validate_fmu

from fmu_verify.verdict import Verdict
from tests.support.broken.asking import examined_all
from tests.support.broken.broken import Broken
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.editing import good_bytes
from tests.support.broken.memory import MEMORY, build_memory_fmu
from tests.support.broken.static import STATIC
from tests.support.broken.table import BROKEN
from tests.support.broken.third import THIRD
from tests.support.broken.wide import WIDE, build_wide_fmu

OURS = "emla verify"
SETS = {
    "the file: archive, model description, libraries": STATIC,
    "behavior": [b for b in BROKEN if b not in STATIC and b not in MEMORY and b not in THIRD],
    "the use of memory, with sources": MEMORY,
}
LIMIT = 120.0
"""Time of one tool for one FMU in s."""

NO_ANSWER = "no answer"
"""What the row of an FMU says if a tool exceeds the limit. It is not counted as found."""

Tool = Callable[[Path], str]
"""Returns `yes` if a tool complains about an FMU, an empty text if not, and `NO_ANSWER` at the limit."""


def main() -> None:
    """Run all tools on all FMUs, and write both files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--tool", action="append", default=[], help="NAME=COMMAND with {} for the FMU")
    parser.add_argument("--limit", type=int, default=len(BROKEN), help="number of FMUs of each set")
    arguments = parser.parse_args()
    tools: dict[str, Tool] = {"FMPy": with_fmpy}
    for text in arguments.tool:
        name, _, command = text.partition("=")
        tools[name] = partial(with_command, shlex.split(command))
    arguments.output.mkdir(parents=True, exist_ok=True)
    sets = {name: members[: arguments.limit] for name, members in SETS.items()}
    with tempfile.TemporaryDirectory() as folder:
        rows = examine(sets, tools, Path(folder))
    with (arguments.output / "verifiers.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, ["set", "fmu", "what", OURS, *tools])
        writer.writeheader()
        writer.writerows(rows)
    text = summarize(rows, [OURS, *tools])
    (arguments.output / "comparison.md").write_text(text, encoding="utf-8", newline="\n")
    print(text)


def examine(sets: dict[str, list[Broken]], tools: dict[str, Tool], folder: Path) -> list[dict[str, str]]:
    """Return a row for each FMU: what is wrong, and `yes` for each tool that finds it."""
    asked = [(b, replace(b.settings, only=(b.check,))) for members in sets.values() for b in members]
    ours = examined_all(asked, folder)
    (folder / "Toy.fmu").write_bytes(good_bytes())
    good = [folder / "Toy.fmu", build_good_fmu(folder), build_wide_fmu(folder), build_memory_fmu(folder)]
    noisy = {path.stem: {name for name, tool in tools.items() if tool(path)} for path in good}
    print("Tools that do not accept the FMU without a fault:", noisy)

    def row(group: str, one: Broken) -> dict[str, str]:
        path = ours[one.name].path
        answers = {n: "" if n in noisy[origin(one)] else tool(path) for n, tool in tools.items()}
        is_found = ours[one.name][one.check].verdict in (Verdict.FAILED, Verdict.WARNING)
        return {
            "set": group,
            "fmu": one.name,
            "what": one.what,
            OURS: "yes" if is_found else "",
            **answers,
        }

    with ThreadPoolExecutor(2) as pool:
        jobs = [(group, one) for group, members in sets.items() for one in members]
        return list(pool.map(lambda job: row(*job), jobs))


def origin(one: Broken) -> str:
    """Return the name of the FMU without the fault."""
    if one in MEMORY:
        return "Memory"
    return "Wide" if one in WIDE else "Toy" if one in STATIC else "Good"


def with_fmpy(path: Path) -> str:
    """Return what FMPy's validation says."""
    try:
        return "yes" if validate_fmu(str(path)) else ""
    except Exception:
        return "yes"


def with_command(command: Sequence[str], path: Path) -> str:
    """Return what another tool says. A shell stands between: an FMU may end the parent process."""
    words = ["sh", "-c", '"$@"; exit $?', "sh", *(word.replace("{}", str(path)) for word in command)]
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            words,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return "yes" if process.wait(LIMIT) != 0 else ""
        except subprocess.TimeoutExpired:
            return NO_ANSWER
        finally:
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def summarize(rows: Sequence[dict[str, str]], tools: Sequence[str]) -> str:
    """Return the table: a line for each set of FMUs, a column for each tool."""
    lines = [
        f"Made on {datetime.now(UTC):%Y-%m-%d} on {fmpy.platform}, with FMPy {fmpy.__version__}.",
        "",
        f"| Faults in | FMUs | {' | '.join(tools)} |",
        f"|---|---|{'---|' * len(tools)}",
    ]
    for name in SETS:
        lines.append(_line(name, [r for r in rows if r["set"] == name], tools))
    lines.append(_line("all", rows, tools))
    late = Counter(tool for row in rows for tool in tools if row[tool] == NO_ANSWER)
    if late:
        counted = ", ".join(f"{tool} {number}" for tool, number in late.items())
        lines += ["", f"FMUs without an answer within {LIMIT:g} s, which do not count: {counted}."]
    return "\n".join(lines) + "\n"


def _line(name: str, rows: Sequence[dict[str, str]], tools: Sequence[str]) -> str:
    counts = Counter(tool for row in rows for tool in tools if row[tool] == "yes")
    return f"| {name} | {len(rows)} | {' | '.join(str(counts[tool]) for tool in tools)} |"


if __name__ == "__main__":
    main()
