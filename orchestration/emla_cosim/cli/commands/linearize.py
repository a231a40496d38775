"""`emla linearize`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...analyses.linearize.report import OUTPUTS
from ...analyses.linearize.runner import linearize
from ...base.option import LINEARIZE, OUTPUT, option, switch
from ..command import report, scenario
from .analysis import run_analysis

OPTIONS = LINEARIZE

_COMPUTED = "What is computed"

EXAMPLES = (
    "emla linearize study-drive --open lift --stop-time 1",
    "emla linearize lift --open 'lift.controller.u_q->lift.plant.u_q' --stop-time 1",
    "emla linearize lift --perturb lift.plant.F_L --read lift.plant.x_L --stop-time 1",
    "emla linearize pendulum.fmu --kind me --matrices --perturb torque --read angle --steady",
)

_computed_option = partial(option, group=_COMPUTED)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    scenario: str = scenario()
    open: Sequence[str] = _computed_option(
        [],
        help="Open a loop at a connection, on a path inside of a component, or at the measured position "
        "of a JOINT, and compute its margins (repeatable). Default: at the current reference of each "
        "joint.",
        metavar="A.OUTPUT->B.INPUT|JOINT",
    )
    perturb: Sequence[str] = _computed_option(
        [], help="Input of a frequency response, connected or not (repeatable).", metavar="COMPONENT.INPUT"
    )
    read: Sequence[str] = _computed_option(
        [], help="Output of a frequency response (repeatable).", metavar="COMPONENT.OUTPUT"
    )
    at: float | None = _computed_option(
        help="Time of the operating point. Default: the stop time less the duration.", unit="s"
    )
    duration: float | None = _computed_option(
        help="Length of the responses. Default: 2000 steps, at most half of the run.", unit="s"
    )
    amplitude: float | None = _computed_option(
        help="Height of the pulses in the unit of the input. Default: the one with the most linear effect."
    )
    matrices: bool = switch(
        "Compute state matrices, poles and damping instead, from the inputs of --perturb to the outputs of "
        "--read. All FMUs must run as Model Exchange.",
        _COMPUTED,
    )
    steady: bool = switch(
        "Compute the matrices at the steady state that is nearest to the state at --at.", _COMPUTED
    )
    free: Sequence[str] = _computed_option(
        [],
        help="Input whose value may change to find the steady state (repeatable).",
        metavar="COMPONENT.INPUT",
    )
    output: Path | None = option(help="Output folder. Default: results/linearize-SCENARIO.", group=OUTPUT)
    plots: bool = option(True, help="Draw Bode and Nyquist plots.", group=OUTPUT)
    report: bool = report()


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Compute frequency responses and margins of a scenario."""
    options |= vars(parameters)
    source = options.pop("scenario")
    run_analysis(OUTPUTS, linearize, source, f"linearize-{Path(source).stem}", options)
