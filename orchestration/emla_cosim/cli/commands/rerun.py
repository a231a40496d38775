"""`emla rerun`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.files import hash_if_readable, real_place
from ...base.option import RUN, argument
from ...run.agreement import describe_differences, find_differences
from ...run.options import list_options
from ...run.result import Result
from ...run.scenarios.recorded import load_recorded_run
from ...study.loading import load
from ...views.output_folder import RECORD
from ...views.terminal import print_line
from .run import run_into

OPTIONS = RUN

EXAMPLES = ("emla rerun results/study", "emla rerun results/study/run.json --step-size 5e-5 --output finer")


@dataclass(frozen=True)
class Parameters:
    """Arguments of the command."""

    run: Path = argument(help="The run.json of the run to repeat, or its folder.", metavar="RUN")


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Repeat a run into a new folder beside the old one."""
    record = parameters.run / RECORD if parameters.run.is_dir() else parameters.run
    recorded = load_recorded_run(record, options)
    scenario = load(recorded.source, **recorded.with_options(options))
    table_name = f"results.{scenario.options.output_format}"
    before = hash_if_readable(record.parent / table_name)  # the new run may replace it
    folder = options.get("output") or _name_new_folder(record)

    run_options = list_options(RUN)

    def compare(result: Result) -> None:
        differences = find_differences(
            recorded.content, result.record, {run_options[name].record for name in options}
        )
        if differences:
            print_line(describe_differences(differences, str(record)))
        is_same_run = all(not (run_options[n].recorded and run_options[n].repeated) for n in options)
        if before is not None and is_same_run:
            same = hash_if_readable(folder / table_name) == before
            verdict = "is the same as that" if same else "differs from that"
            print_line(f"{table_name} {verdict} of {record.parent}{', to the last bit' * same}")

    run_into(scenario, folder, None if "output" in options else record, compare)


def _name_new_folder(record: Path) -> Path:
    """Return the path of a folder beside that of a record; an earlier repetition may have created it."""
    folder = record.parent
    if folder.name in ("", ".."):  # such a path has no last name to extend
        folder = real_place(record).parent
    return folder.with_name(f"{folder.name}-again")
