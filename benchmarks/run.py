"""Measure how fast several tools run the same FMUs: python -m benchmarks.run --help."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.errors import BenchmarkError
from benchmarks.registry import TOOLS, Tool
from benchmarks.rounds import ROOT, Result, measured
from benchmarks.study import study_job
from benchmarks.table import as_json, in_readme, markdown, text
from benchmarks.tools.c_loop import run_loop

README = ROOT / "benchmarks" / "README.md"


def main() -> None:
    """Measure, print the table, and write it where the options say."""
    options = _options()
    try:
        if options.write:
            in_readme(README.read_text(encoding="utf-8"), "")  # before the long work
        tools = [t for t in TOOLS if not options.tools or t.name in options.tools]
        with TemporaryDirectory(prefix="emla-benchmark-") as folder:
            results = _results(Path(folder), options.rounds, options.steps, tools)
        print(text(results))
        if options.json:
            options.json.write_text(as_json(results), encoding="utf-8")
        if options.write:
            table = markdown(results, options.rounds)
            README.write_text(in_readme(README.read_text(encoding="utf-8"), table), encoding="utf-8")
    except BenchmarkError as error:
        sys.exit(str(error))


def _results(folder: Path, rounds: int, steps: int, tools: Sequence[Tool]) -> list[Result]:
    job = study_job(ROOT / "fmus", folder)
    try:
        initial = run_loop(job).signals
    except RuntimeError as error:
        raise BenchmarkError(
            f"The C loop, which all tools are compared with, does not run: {error}"
        ) from error
    job = replace(job, initial=tuple(initial))
    return measured(job, tools, rounds, steps, lambda line: print(line, file=sys.stderr))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Measure how fast several tools run the same FMUs.")
    parser.add_argument("--rounds", type=_positive, default=7, help="how often each tool is run (7)")
    parser.add_argument(
        "--steps", type=_positive, default=20_000, help="steps of a run; fast tools do more (20000)"
    )
    parser.add_argument("--tools", nargs="+", choices=[t.name for t in TOOLS], help="these tools only")
    parser.add_argument("--json", type=Path, help="write all measurements to this file")
    parser.add_argument("--write", action="store_true", help="write the table to benchmarks/README.md")
    return parser.parse_args()


def _positive(word: str) -> int:
    number = int(word)
    if number < 1:
        raise argparse.ArgumentTypeError("it must be at least 1")
    return number


if __name__ == "__main__":
    main()
