"""`emla compare`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...analyses.compare import stability
from ...analyses.compare.report import OUTPUTS
from ...analyses.compare.result import STABILITY, TABLES
from ...analyses.compare.runner import RESOLUTION, SEEDS, compare
from ...analyses.compare.stability import CERTIFICATE, certify_gains
from ...base.errors import CommandError, CosimError, join_names
from ...base.option import COMPARE, argument, option
from ..command import report, scheduler, workers
from .analysis import run_analysis

OPTIONS = COMPARE

EXAMPLES = ("emla compare study --controllers rsba,foc", "emla compare study --table paper")


def _split_names(text: str) -> list[str]:
    return [part.strip() for part in text.split(",")]


def _read_limit_reserves(text: str) -> list[float]:
    """Read the fractions of limits that controllers keep in reserve. Raise CommandError for other texts."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise CommandError(
            f"the reserves are '{text}'; they must be two numbers, fractions of current and voltage, such "
            "as 0.02,0.2."
        ) from None


_compared_option = partial(option, group="What is compared")


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    scenario: str = argument(
        help="Name of a built-in scenario, or scenario file (.toml).", metavar="SCENARIO"
    )
    controllers: Sequence[str] | None = _compared_option(
        help="Controllers: names, FILE.fmu or FILE.py:BLOCK. Default: all in `emla list`.",
        metavar="NAME,...",
        parse=_split_names,
    )
    gains: Sequence[str] | None = _compared_option(
        help="Gain sets: SET for all controllers that have it, CONTROLLER/SET for one, recommended, "
        "or all. Default: the recommended set of each controller.",
        metavar="SET,...",
        parse=_split_names,
    )
    table: str | None = _compared_option(
        help="paper: the paper's tables beside ours, all gain sets. robustness: many variants, with "
        "the gain sets robust and rule too. stability: maps over delay and parameters. "
        "margins: stability margins of each joint's loops. "
        "certificate: the stability proof of RSBA's gain sets.",
        metavar="|".join((*TABLES, CERTIFICATE)),
    )
    seeds: int | None = _compared_option(
        help="Number of runs with random effects, with seeds that no tuning used; 0: one run with the "
        f"scenario's seeds. Default: {SEEDS}; for {STABILITY} 0."
    )
    reserves: Sequence[float] | None = _compared_option(
        help="Fractions of current and voltage that every controller keeps in reserve, such as "
        "0.02,0.2. Default: those of its gain set.",
        metavar="CURRENT,VOLTAGE",
        parse=_read_limit_reserves,
    )
    resolution: int | None = _compared_option(
        help=f"Points along each axis of the maps of {STABILITY}. Default: {RESOLUTION}."
    )
    scheduler: str | None = scheduler()
    workers: int | None = workers()
    report: bool = report()


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Compare several controllers in the same scenario."""
    name = Path(parameters.scenario).stem
    if parameters.table == CERTIFICATE:
        _check_certificate(parameters)
        options.pop("plots", None)  # a certificate has no plots
        options |= {"gains": parameters.gains, "report": parameters.report}
        run_analysis(stability.OUTPUTS, certify_gains, parameters.scenario, name, options)
        return
    options = {"plots": True, **options, **vars(parameters)}
    result, folder = run_analysis(OUTPUTS, compare, options.pop("scenario"), name, options)
    if not result.complete:
        raise CosimError(f"interrupted; results so far are in {folder}.")


def _check_certificate(parameters: Parameters) -> None:
    """Raise CommandError for options that a certificate does not support."""
    if parameters.controllers not in (None, ["rsba"]):
        names = ",".join(parameters.controllers)
        raise CommandError(f"--table certificate supports only the controller rsba, not {names}.")
    unsupported = ("seeds", "reserves", "resolution", "scheduler", "workers")
    if any(getattr(parameters, name) is not None for name in unsupported):
        raise CommandError(
            f"--table certificate does not support {join_names(f'--{x}' for x in unsupported)}."
        )
