"""`emla tune`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...analyses.tune.folder import BEST, HISTORY, PICTURE, RECORD
from ...analyses.tune.plan import load_tuning_plan
from ...analyses.tune.result import TuneResult
from ...analyses.tune.runner import tune
from ...analyses.tune.summary import format_lines, format_summary
from ...analyses.variants.distributions import FORMS
from ...base.errors import CosimError
from ...base.option import SWEEP, option
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import plan, scheduler, workers

OPTIONS = SWEEP

_WANTED, _TRIED = "Objective", "Search"

EXAMPLES = (
    "emla tune rsba-tilt",
    "emla tune lift --vary lift.controller.k_1=10:1000 --objective lift.position_error_m",
)

_tried = partial(option, group=_TRIED)
_wanted = partial(option, group=_WANTED)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    plan: str = plan()
    objective: str | None = _wanted(
        help="Expression over metrics to minimise, such as tilt.position_error_m.", metavar="EXPRESSION"
    )
    metric: Sequence[str] | None = _wanted(
        help="Additional metric over signals (repeatable).", metavar="'NAME = EXPRESSION'"
    )
    tolerance: float | None = _wanted(
        help="Fail if the objective with the validation seeds is worse by more than this fraction. "
        "Default: no limit."
    )
    vary: Mapping[str, str] = _tried(
        {},
        help=f"Gain and its range, as {FORMS}; the search in LOW:HIGH is logarithmic (repeatable).",
        metavar="NAME=RANGE",
    )
    derive: Mapping[str, str] = _tried(
        {}, help="Start value computed from the varied gains (repeatable).", metavar="NAME=EXPRESSION"
    )
    evaluations: int | None = _tried(help="Number of gain sets to try. Default: 200.")
    training: int | None = _tried(help="Number of seeds to tune with. Default: 2.")
    validation: int | None = _tried(help="Number of other seeds to validate with. Default: 4.")
    seed: int | None = _tried(help="Seed of random numbers. Default: 0.")
    scheduler: str | None = scheduler()
    workers: int | None = workers()


def command(chosen: Parameters, given: dict[str, Any]) -> None:
    """Tune gains of a scenario's controllers."""
    found = load_tuning_plan(chosen.plan)
    place = Path(given.get("output") or results_folder(f"tune-{found.name}"))
    given |= vars(chosen) | {"plan": found, "output": place}
    with BarProgress() as progress:
        result = tune(given.pop("plan"), metrics=given.pop("metric"), progress=progress, **given)
    _show(result, place, given.get("plots", True))
    if not result.complete:
        raise CosimError(f"interrupted; the best gains so far are in {place / BEST}.")
    if (problem := result.problem()) is not None:
        raise CosimError(problem)


def _show(result: TuneResult, place: Path, plots: bool) -> None:
    """Show tables, a summary and the files."""
    for part in format_summary(result):
        show(part)
    files = [BEST, RECORD, HISTORY, *([PICTURE] if plots else [])]
    for line in (*format_lines(result), f"emla run {place / BEST}", f"Wrote {place}/: {', '.join(files)}"):
        print_line(line)
