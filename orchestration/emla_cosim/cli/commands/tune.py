"""`emla tune`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from ...analyses.tune.plan import load_tuning_plan
from ...analyses.tune.report import BEST, OUTPUTS
from ...analyses.tune.runner import tune
from ...analyses.variants.distributions import FORMS
from ...base.errors import CosimError
from ...base.option import SWEEP, option
from ..command import plan, report, scheduler, workers
from .analysis import run_analysis

OPTIONS = SWEEP

_OBJECTIVE, _SEARCH = "Objective", "Search"

EXAMPLES = (
    "emla tune rsba-tilt",
    "emla tune lift --vary 'lift.controller.beta[1]=300:3000' --objective lift.position_error_m",
)

_search_option = partial(option, group=_SEARCH)
_objective_option = partial(option, group=_OBJECTIVE)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    plan: str = plan()
    objective: str | None = _objective_option(
        help="Expression over metrics to minimise, such as tilt.position_error_m.", metavar="EXPRESSION"
    )
    metric: Sequence[str] | None = _objective_option(
        help="Additional metric over signals (repeatable).", metavar="'NAME = EXPRESSION'"
    )
    tolerance: float | None = _objective_option(
        help="Fail if the objective with the validation seeds is worse by more than this fraction. "
        "Default: no limit."
    )
    vary: Mapping[str, str] = _search_option(
        {},
        help=f"Gain and its range, as {FORMS}; the search in LOW:HIGH is logarithmic (repeatable).",
        metavar="NAME=RANGE",
    )
    derive: Mapping[str, str] = _search_option(
        {}, help="Start value computed from the varied gains (repeatable).", metavar="NAME=EXPRESSION"
    )
    evaluations: int | None = _search_option(help="Number of gain sets to try. Default: 200.")
    training: int | None = _search_option(help="Number of seeds to tune with. Default: 2.")
    validation: int | None = _search_option(help="Number of other seeds to validate with. Default: 4.")
    seed: int | None = _search_option(help="Seed of random numbers. Default: 0.")
    scheduler: str | None = scheduler()
    workers: int | None = workers()
    report: bool = report()


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Tune gains of a scenario's controllers."""
    options |= vars(parameters)
    loaded_plan, options["metrics"] = load_tuning_plan(options.pop("plan")), options.pop("metric")
    result, folder = run_analysis(OUTPUTS, tune, loaded_plan, f"tune-{loaded_plan.name}", options)
    if not result.complete:
        raise CosimError(f"interrupted; the best gains so far are in {folder / BEST}.")
    if (problem := result.problem()) is not None:
        raise CosimError(problem)
