"""Options of the stepping, beside those of algorithms and step-size controls."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from ..base.errors import CommandError
from ..base.option import COMPARE, EXPORT, LEFT_OUT, LINEARIZE, RUN, SAME, SIZE, STEPPING, SWEEP, option
from ..fmu.cvode import METHODS
from ..master.algorithms.algorithm import Algorithm
from ..master.algorithms.registry import ALGORITHMS
from ..master.stepping.step_size_control import STEP_SIZE_CONTROLS, StepSizeControl
from .system_options import ALL

_INTEGRATED = (RUN, SWEEP, COMPARE, LINEARIZE)


def read_threads(text: str) -> int | None:
    """Read a number of threads; None means `auto`. Raise CommandError for any other text."""
    if text == "auto":
        return None
    try:
        return int(text)
    except ValueError as error:
        raise CommandError(f"--threads {text} is neither a whole number nor auto.") from error


_stepping = partial(option, group=STEPPING)


@dataclass(frozen=True)
class SteppingOptions:
    """Options of the stepping. Times are in s."""

    stop_time: float | None = _stepping(
        help="Stop time of the simulation. Default: the scenario's.", unit="s", commands=ALL
    )
    step_size: float | None = _stepping(
        help="Communication step: time between two exchanges of values between the FMUs. Default: the "
        "scenario's.",
        unit="s",
        identity="step size",
        commands=ALL,
    )
    algorithm: str | Algorithm = _stepping(
        "gauss-seidel",
        help="Master algorithm: the order in which FMUs step and exchange values; see docs/master.md.",
        choices=lambda: ALGORITHMS,
        identity="algorithm",
        commands=(RUN, EXPORT, SWEEP, COMPARE, LINEARIZE, SIZE),
        takes=Algorithm,
    )
    start_time: float | None = _stepping(
        help="Start time of the simulation. Default: the scenario's, or 0.",
        unit="s",
        identity="start time",
        commands=ALL,
    )
    stop_when: Sequence[str] = _stepping(
        [],
        help="End the run successfully at the first communication point at which this condition on a signal "
        "holds, such as 'lift.plant.x_L > 0.3' (repeatable).",
        metavar="'SIGNAL > VALUE'",
        commands=(RUN, SWEEP, COMPARE),
        in_sweep=SAME,
    )
    threads: int | None = _stepping(
        help="Number of threads that step FMUs. The results are the same. Default: auto, which uses all "
        "cores where this is measured to be faster.",
        metavar="N|auto",
        parse=read_threads,
        in_file=False,
        recorded=False,
        commands=(RUN,),
    )
    real_time: float | None = _stepping(
        help="Largest speed, in simulated seconds per second. Default: no limit.",
        flag="--realtime",
        metavar="FACTOR",
        record="real_time_factor",
        commands=(RUN,),
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    fmi_tolerance: float | None = _stepping(
        help="Relative tolerance of the solvers inside the FMUs. Default: that of each FMU's experiment.",
        above=0.0,
        identity="FMI tolerance",
        commands=_INTEGRATED,
    )
    integrator: str = _stepping(
        "bdf",
        help="Method of CVode for FMUs that run as Model Exchange: bdf for stiff models, adams for others.",
        choices=lambda: METHODS,
        identity="integrator",
        commands=_INTEGRATED,
    )
    integrator_step: float | None = _stepping(
        help="Largest step of CVode in FMUs that run as Model Exchange. Default: the communication step.",
        unit="s",
        above=0.0,
        identity="integrator step",
        commands=_INTEGRATED,
    )
    step_size_control: str | StepSizeControl | None = _stepping(
        help="Step-size control. Default: the one that the other options imply, such as error for "
        "--error-tolerance; otherwise fixed.",
        choices=lambda: STEP_SIZE_CONTROLS,
        identity="step-size control",
        takes=StepSizeControl,
    )
    estimate_coupling: bool = _stepping(
        True,
        help="Estimate the error of exchanging values only at communication points, after the run; see "
        "docs/master.md. The results are the same.",
        flag="--coupling-estimate",
        commands=(RUN, SWEEP),
        in_sweep=SAME,
    )
