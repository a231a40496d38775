"""`emla rerun`."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.files import hash_if_readable, real_place
from ...base.option import RUN, Option
from ...run.options import list_options
from ...run.repetition import describe_differences, find_differences
from ...run.result import Result
from ...run.scenarios.recorded import load_recorded_run
from ...study.loading import load
from ...views.output_folder import RECORD
from ...views.terminal import print_line
from .run import run_into

OPTIONS = RUN
"""Options that the command takes."""

EXAMPLES = (
    "emla rerun results/study",
    "emla rerun results/study/run.json --step-size 5e-5 --output finer",
)
"""Commands that the help shows."""


def command(
    run: Annotated[Path, typer.Argument(help="run.json of the run to repeat, or its folder.")],
    given: dict[str, Any],
) -> None:
    """Repeat a run in a folder beside its own."""
    record = _record(run)
    recorded = load_recorded_run(record, given)
    chosen = load(recorded.source, **recorded.with_options(given))
    table_name = f"results.{chosen.options.output_format}"
    before = hash_if_readable(record.parent / table_name)  # which may be about to be replaced
    folder = given.get("output") or _beside(record)

    known = list_options(RUN)

    def compare(result: Result) -> None:
        found = find_differences(recorded.content, result.record, {known[name].record for name in given})
        if found:
            print_line(describe_differences(found, str(record)))
        if before is not None and _same_table(known[name] for name in given):
            same = hash_if_readable(folder / table_name) == before
            what = "is that" if same else "differs from that"
            print_line(f"{table_name} {what} of {record.parent}{', to the last bit' * same}")

    run_into(chosen, folder, None if "output" in given else record, compare)


def _same_table(given: Iterable[Option]) -> bool:
    """Whether the table must be the same with these options: no record has them, or no repetition."""
    return all(not (one.about.recorded and one.about.repeated) for one in given)


def _record(run: Path) -> Path:
    """The record that a path means, which may be that of its folder."""
    return run / RECORD if run.is_dir() else run


def _beside(record: Path) -> Path:
    """A folder beside that of a record, which is left as it is."""
    folder = record.parent
    if folder.name in ("", ".."):
        folder = real_place(record).parent
    return folder.with_name(f"{folder.name}-again")
