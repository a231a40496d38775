"""The commands whose results are frozen: short runs of every kind, and commands that fail."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Command:
    """A command line, and what of its results is frozen.

    Attributes:
        line: The arguments of `emla`. Files that it reads are in `inputs.py`.
        bits: Files of the output folder `o` (or beside it) of which each byte counts.
        values: Tables whose numbers count, but not their last digits.
        is_slow: Whether it belongs to the slow tier.
        iterates: Whether bits depend on linear algebra, which differs between processors.
    """

    line: str
    bits: tuple[str, ...] = ()
    values: tuple[str, ...] = ()
    is_slow: bool = False
    iterates: bool = False


def _run(line: str, iterates: bool = False) -> Command:
    return Command(f"run {line} --no-plots --output o", ("results.csv",), iterates=iterates)


COMMANDS = {
    "lift": _run("lift --stop-time 0.4"),
    "jacobi": _run("lift --stop-time 0.1 --algorithm jacobi"),
    "strong": _run("lift --stop-time 0.05 --algorithm strong", iterates=True),
    "error control": _run("lift --stop-time 0.02 --error-tolerance 1e-3"),
    "foc": _run("lift --stop-time 0.1 --controller foc --step-multiple lift.controller=5"),
    "fault": _run("lift --stop-time 0.1 --fault lift.plant.x_measured=freeze@0.05+0.01"),
    "input": _run(
        "tilt --stop-time 0.1 --input force.csv:tilt.disturbance.F_L=F_L --set tilt.plant.motor.R_s=0.2"
    ),
    "two threads": _run("study --stop-time 0.02 --threads 2"),
    "study": _run("study --stop-time 0.05"),
    "study-drive": _run("study-drive --stop-time 0.05"),
    "published": _run("published --stop-time 0.05"),
    "experiment-1": _run("experiment-1 --stop-time 0.05"),
    "prototype": _run("prototype --stop-time 0.05"),
    "hdrm-replay": _run("hdrm-replay --stop-time 0.05"),
    "hdrm-coupled": _run("hdrm-coupled --stop-time 0.02", iterates=True),
    "hdrm-merged": _run("hdrm-merged --stop-time 0.02"),
    "ssp": Command("export lift o/lift.ssp", ("lift.ssp",)),
    "ssp of the study": Command("export study o/study.ssp", ("study.ssp",), is_slow=True),
    "c": Command(
        "export lift o/lift.c --components controller --components observer",
        ("lift.c", "lift.h"),
        is_slow=True,
    ),
    "container": Command("export lift o/lift.fmu", ("lift.fmu",), is_slow=True),
    "container of FMI 3.0": Command("export lift o/lift3.fmu --fmi 3", ("lift3.fmu",), is_slow=True),
    "sweep": Command(
        "sweep lift --vary lift.plant.motor.R_s=0.05:0.3:3 --stop-time 0.4 --output o",
        values=("variants.parquet",),
        is_slow=True,
    ),
    "compare": Command(
        "compare lift --controllers rsba,foc --stop-time 0.5 --no-plots --output o",
        values=("comparison.csv",),
        is_slow=True,
    ),
    "linearize": Command(
        "linearize lift --open lift --at 0.5 --duration 0.15 --stop-time 1 --no-plots --output o",
        is_slow=True,
    ),
    "size": Command(
        "size hdrm-replay --no-plots --output o", values=("limits.csv", "cycles.csv"), is_slow=True
    ),
    "require": Command(
        "run lift --stop-time 0.05 --no-plots --output o --require 'lift.torque_peak_N_m < 1'"
    ),
    "unknown scenario": Command("run lifd"),
    "unknown option": Command("run lift --stop-tme 1"),
    "unknown variable": Command("run lift --set lift.plant.motor.Rs=1"),
    "missing file": Command("run absent.toml"),
    "verify nothing": Command("verify absent.fmu"),
}
"""Commands by name."""
