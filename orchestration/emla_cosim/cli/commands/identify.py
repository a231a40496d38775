"""`emla identify`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from ...analyses.identify.plan import load_identification_plan
from ...analyses.identify.report import OUTPUTS, SCENARIO
from ...analyses.identify.residuals import LOSSES
from ...analyses.identify.runner import identify
from ...base.errors import CosimError
from ...base.option import SWEEP, argument, option, switch
from ..command import report, scheduler, workers
from .analysis import run_analysis

OPTIONS = SWEEP

_DATA, _SEARCH = "Data", "Estimation"

EXAMPLES = (
    "emla identify lift --input test.csv:lift.disturbance.F_L=Force "
    "--measured test.csv:lift.plant.x_L=position --vary lift.plant.friction.F_C=1:1000",
    "emla identify plan.toml --report",
)

_search_option = partial(option, group=_SEARCH)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    plan: str = argument(help="Plan (.toml), or a scenario, SSP or FMU as for `emla run`.", metavar="PLAN")
    measured: Sequence[str] | None = option(
        help="Measured data: a file, and the columns of signals (repeatable).",
        metavar="FILE:SIGNAL=COLUMN,...",
        group=_DATA,
    )
    sigma: Mapping[str, str] = option(
        {},
        help="Standard deviation of a measured signal. Default: that of the residuals (repeatable).",
        metavar="SIGNAL=VALUE",
        group=_DATA,
    )
    vary: Mapping[str, str] = _search_option(
        {},
        help="Unknown parameter and its range; offset(SIGNAL), gain(SIGNAL) and delay(SIGNAL) are those "
        "of a sensor (repeatable).",
        metavar="NAME=LOW:HIGH",
    )
    loss: str | None = _search_option(
        help=f"Loss function; all but linear bear outliers. One of {', '.join(LOSSES)}. Default: linear."
    )
    starts: int | None = _search_option(help="Number of starting points. Default: 1.")
    evaluations: int | None = _search_option(help="Most iterations from each point. Default: 50.")
    profile: Sequence[str] | None = _search_option(
        help="Parameter whose interval is found by profile likelihood (repeatable)."
    )
    seed: int | None = _search_option(help="Seed of the random starting points. Default: 0.")
    design: bool = switch("Rank the plan's experiments by what they would tell; estimate nothing.", _SEARCH)
    report: bool = report()
    scheduler: str | None = scheduler()
    workers: int | None = workers()


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Estimate parameters from measured data."""
    # False would override the plan
    options |= vars(parameters) | {"design": parameters.design or None}
    loaded_plan = load_identification_plan(options.pop("plan"))
    # a folder of its own, so that estimates of the same plan stay
    kind = "design" if parameters.design or loaded_plan.design else "identify"
    result, folder = run_analysis(OUTPUTS, identify, loaded_plan, f"{kind}-{loaded_plan.name}", options)
    if not result.complete:
        raise CosimError(f"interrupted; the best values so far are in {folder / SCENARIO}.")
