"""`emla size`."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...analyses.size.draws import MOST_CORNERS
from ...analyses.size.report import OUTPUTS
from ...analyses.size.runner import AMBIENT, LEAD_IN, size
from ...analyses.variants.distributions import FORMS
from ...base.errors import CommandError, RunError, join_names
from ...base.option import OUTPUT, SIZE, option
from ...base.quantities import read_quantity
from ..command import read_factors, report, scenario, scheduler, workers
from .analysis import run_analysis

OPTIONS = SIZE

EXAMPLES = (
    "emla size prototype --actuator prototype=docs/actuator.toml",
    "emla size prototype --actuator prototype=a.toml,b.toml,c.toml --life 20000h --report",
    "emla size study --actuator lift=a.toml,b.toml --actuator tilt=c.toml,d.toml",
    "emla size mine.toml --cycle 4s --ambient 95degF",
    "emla size study-drive --vary 'lift.disturbance.load.level[1]=±10%' --vary ambient=20degC:45degC",
)

_required_option = partial(option, group="What is required")
_varied_option = partial(option, group="What varies")


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    scenario: str = scenario()
    cycle: float | None = _required_option(
        help="Length of the cycle, which ends at the stop time and repeats. Default: the period of the "
        "reference, otherwise the whole run.",
        unit="s",
    )
    lead_in: float = _required_option(
        LEAD_IN, help="Time before the start time, in which the joints settle; it does not count.", unit="s"
    )
    ambient: float = _required_option(
        AMBIENT,
        help="Temperature around the motors, such as 40degC or 104degF. Default: 40degC.",
        metavar="TEMPERATURE",
        parse=lambda text: read_quantity(text, "--ambient", "K", readings=("degC", "degF", "K")),
    )
    life: float | None = _required_option(
        help="Time for which the cycle is to repeat, such as 20000h. Without it, the screw's life has no "
        "verdict.",
        metavar="TIME",
        # it needs a unit: people think of it in hours, and other times are in seconds
        parse=lambda text: read_quantity(text, "--life", "s", readings=("h", "s")),
    )
    vary: Mapping[str, str] = _varied_option(
        {},
        help=f"Tolerance of a start value, of an entry of a data sheet, or of 'ambient', as {FORMS} "
        "(repeatable). Each candidate runs with all combinations of the ends; it has to hold in all.",
        metavar="NAME=LOW:HIGH",
        parse=read_factors,
    )
    runs: int | None = _varied_option(
        help=f"Number of random draws from the tolerances. Default: their ends, at most {MOST_CORNERS} "
        "combinations."
    )
    seed: int = _varied_option(0, help="Seed of the random draws.")
    scheduler: str | None = scheduler()
    workers: int | None = workers()
    output: Path | None = option(help="Output folder. Default: results/size-SCENARIO.", group=OUTPUT)
    plots: bool = option(True, help="Draw plots of each joint.", group=OUTPUT)
    report: bool = report()


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Examine whether actuators do the job of a scenario."""
    actuators, options["candidates"] = _split_candidates(options.pop("actuator", None) or {})
    if actuators:
        options["actuator"] = actuators
    options |= vars(parameters)
    source = options.pop("scenario")
    result, _ = run_analysis(OUTPUTS, size, source, f"size-{Path(source).stem}", options)
    if unjudged := result.unjudged:
        names = join_names(dict.fromkeys(joint_verdict.joint for joint_verdict in unjudged))
        raise RunError(f"no verdict on {names}: see above why.")


def _split_candidates(texts: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, list[str]]]:
    """Return the actuators of joints with one file, and the files of joints with several."""
    files = {joint: [part for part in str(text).split(",") if part] for joint, text in texts.items()}
    if empty := [joint for joint, text in files.items() if not text]:
        raise CommandError(f"--actuator {empty[0]}={texts[empty[0]]} names no file.")
    return (
        {joint: text[0] for joint, text in files.items() if len(text) == 1},
        {joint: text for joint, text in files.items() if len(text) > 1},
    )
