"""`emla sweep`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from ...analyses.sweep.plan import load_plan
from ...analyses.sweep.report import OUTPUTS
from ...analyses.sweep.runner import sweep
from ...analyses.variants.distributions import FORMS
from ...analyses.variants.measures import DONE, STATUS
from ...analyses.variants.sampling import SAMPLINGS
from ...base.errors import CosimError
from ...base.option import OUTPUT, RUNS, SWEEP, option, switch
from ..command import plan, read_factors, report, scheduler, workers
from .analysis import run_analysis

OPTIONS = SWEEP

EXAMPLES = (
    "emla sweep lift --vary lift.plant.motor.R_s=0.05:0.3:20",
    "emla sweep lift --vary lift.plant.motor.R_s=80%:120% --runs 200 --seed 1",
    "emla sweep study-robustness --output results/robust",
)


_varied_option = partial(option, group="What varies")


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    plan: str = plan()
    vary: Mapping[str, str] = _varied_option(
        {},
        help=f"Factor and its values, as {FORMS}; * in the name matches several (repeatable).",
        metavar="NAME=VALUES",
        parse=read_factors,
    )
    runs: int | None = _varied_option(help="Number of variants to draw. Default: all points of a grid.")
    sampling: str | None = _varied_option(
        help=f"Sampling method, one of {', '.join(SAMPLINGS)}. Default: grid, or random with --runs."
    )
    seed: int | None = _varied_option(help="Seed of random numbers. Default: 0.")
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
    report: bool = report()


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Run many variants of a scenario into an output folder."""
    options = {"plots": True, **options, **vars(parameters)}
    loaded_plan, options["metrics"] = load_plan(options.pop("plan")), options.pop("metric")
    result, folder = run_analysis(OUTPUTS, sweep, loaded_plan, loaded_plan.name, options)
    if not result.complete:
        raise CosimError(f"interrupted; the results so far are in {folder}. Continue with --resume.")
    # the results are complete, but a script must see that requirements are not met
    if result.required and (failing := result.variants.filter(result.variants[STATUS] != DONE).height):
        raise CosimError(
            f"{failing} of {result.variants.height} variants do not meet the requirements; see above."
        )
