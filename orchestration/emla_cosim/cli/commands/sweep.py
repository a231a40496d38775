"""`emla sweep`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...analyses.sweep.folder import RECORD, SERIES, TABLE, WORST, SweepFolder
from ...analyses.sweep.pictures import draw_pictures
from ...analyses.sweep.plan import load_plan
from ...analyses.sweep.result import SweepResult
from ...analyses.sweep.runner import sweep
from ...analyses.sweep.summary import format_summary, list_worst_commands
from ...analyses.variants.data import DONE, STATUS
from ...analyses.variants.distributions import FORMS
from ...analyses.variants.sampling import SAMPLINGS
from ...base.errors import CosimError
from ...base.files import report_write_errors
from ...base.option import OUTPUT, RUNS, SWEEP, option, switch
from ...base.progress import Progress
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import plan, read_factors, scheduler, workers

OPTIONS = SWEEP

_MOST_LETTERS = 1600
"""Most commands to show."""

EXAMPLES = (
    "emla sweep lift --vary lift.plant.motor.R_s=0.05:0.3:20",
    "emla sweep lift --vary lift.plant.motor.R_s=80%:120% --runs 200 --seed 1",
    "emla sweep study-robustness --output results/robust",
)


_varies = partial(option, group="What varies")


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    plan: str = plan()
    vary: Mapping[str, str] = _varies(
        {},
        help=f"Factor and its values, as {FORMS}; * in the name matches several (repeatable).",
        metavar="NAME=VALUES",
        parse=read_factors,
    )
    runs: int | None = _varies(help="Number of variants to draw. Default: all points of a grid.")
    sampling: str | None = _varies(
        help=f"Sampling method, one of {', '.join(SAMPLINGS)}. Default: grid, or random with --runs."
    )
    seed: int | None = _varies(help="Seed of random numbers. Default: 0.")
    metric: Sequence[str] | None = option(
        help="Metric to keep, or a new one as 'NAME = EXPRESSION' (repeatable). Default: all.",
        metavar="METRIC",
        group=OUTPUT,
    )
    signals: Sequence[str] | None = option(
        help="Signals to keep over time, such as 'lift.plant.*' (repeatable). Default: none.",
        metavar="PATTERN",
        group=OUTPUT,
    )
    scheduler: str | None = scheduler()
    workers: int | None = workers()
    resume: bool = switch("Continue an interrupted sweep in this output folder.", RUNS)


def command(chosen: Parameters, given: dict[str, Any]) -> None:
    """Run many variants of a scenario into an output folder."""
    found = load_plan(chosen.plan)
    place, plots = Path(given.get("output") or results_folder(found.name)), given.pop("plots", True)
    folder = SweepFolder(place, given.get("overwrite", False))
    given |= vars(chosen) | {"plan": found, "output": place}
    with BarProgress() as progress:
        result = sweep(given.pop("plan"), metrics=given.pop("metric"), progress=progress, **given)
        pictures = _draw_pictures(result, folder, progress) if plots and result.variants.height else []
    _show(result, folder, pictures)
    if not result.complete:
        raise CosimError(f"interrupted; the results so far are in {place}. Continue with --resume.")
    if result.required and (failing := result.variants.filter(result.variants[STATUS] != DONE).height):
        raise CosimError(
            f"{failing} of {result.variants.height} variants do not meet the requirements; see above."
        )


def _show(result: SweepResult, folder: SweepFolder, pictures: Sequence[Path]) -> None:
    """Show tables, the commands that run the worst variants alone, and the files."""
    for part in format_summary(result):
        show(part)
    files = [TABLE, RECORD, *([SERIES] if result.series is not None else [])]
    lines = [*_short(list_worst_commands(result), folder), f"Wrote {folder.path}/: {', '.join(files)}"]
    if pictures:
        lines.append(f"Plots: {', '.join(path.name for path in pictures)}")
    for line in lines:
        print_line(line)


def _short(lines: Sequence[str], folder: SweepFolder) -> Sequence[str]:
    """Return the commands to show; if they are too many, name the file that has them."""
    if sum(map(len, lines)) <= _MOST_LETTERS:
        return lines
    with folder.alone(), report_write_errors(folder.path):
        written = folder.write(WORST, "\n".join([f"# {lines[0]}", *lines[1:], ""]).encode())
    return [f"Commands to run each of them alone are in {written}."]


def _draw_pictures(result: SweepResult, folder: SweepFolder, progress: Progress) -> list[Path]:
    progress.begin("drawing plots", 1)
    with folder.alone(), report_write_errors(folder.path):
        found = [folder.draw(name, figure) for name, figure in draw_pictures(result)]
    progress.advance(1)
    return found
