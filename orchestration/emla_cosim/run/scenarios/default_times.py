"""Start, stop and step of a run whose FMU or package does not have all of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...fmu.interface import Interface
from ..options import Options

SPAN = 10.0
"""Default run time in s without a stop time."""

STEPS = 1000
"""Default number of steps without a step size."""


@dataclass(frozen=True)
class Times:
    """The times in s that an FMU or a package has; None if it has none."""

    start: float | None
    stop: float | None
    step: float | None


def read_times(interface: Interface) -> Times:
    """Return the times of an FMU's default experiment."""
    experiment = interface.description.defaultExperiment
    return Times(*(_read_seconds(experiment, name) for name in ("startTime", "stopTime", "stepSize")))


def choose_times(
    declared: Times, options: Options, owner: str, parts: Sequence[Times] = ()
) -> tuple[Times, list[str]]:
    """Return the times of a run, and a remark on each that is a default.

    Options override times of the owner. A missing stop is the latest of the parts, a missing step their
    shortest.

    Args:
        declared: times of the FMU or package.
        options: options of the user.
        owner: "FMU" or "package", for the remarks.
        parts: times of the FMUs in a package.
    """
    notes = list[str]()
    start = declared.start or 0.0 if options.start_time is None else options.start_time
    stop = options.stop_time
    if stop is None:
        stop, origin = declared.stop, ""
        if stop is None or not stop > start:
            later = [p.stop for p in parts if p.stop is not None and p.stop > start]
            stop, origin = (max(later), ", the longest of its FMUs") if later else (start + SPAN, "")
        if stop != declared.stop:
            fault = f"the {owner} has no stop time"
            if declared.stop is not None:
                fault = f"the stop time of the {owner}, {declared.stop:g} s,"
                fault += f" is not after the start at {start:g} s"
            notes.append(f"{fault}; without --stop-time it runs for {stop - start:g} s{origin}")
    step = options.step_size
    if step is None and not stop > start:  # no step is done, or the stop time is refused
        step = declared.step if declared.step is not None and declared.step > 0.0 else 1.0
    elif step is None:
        step, origin = declared.step, ""
        if step is None or not 0.0 < step <= stop - start:
            fitting = [p.step for p in parts if p.step is not None and 0.0 < p.step <= stop - start]
            step, origin = (
                (min(fitting), ", the shortest of its FMUs") if fitting else ((stop - start) / STEPS, "")
            )
            fault = f"the {owner} has no step size"
            if declared.step is not None:
                fault = (
                    f"the step size of the {owner}, {declared.step:g} s, does not fit into {stop - start:g} s"
                )
            notes.append(f"{fault}; without --step-size it is {step:g} s{origin}")
    return Times(start, stop, step), notes


def _read_seconds(experiment: Any, name: str) -> float | None:
    """Return a time of a default experiment, or None if it is missing or no number."""
    text = getattr(experiment, name, None)
    seconds = math.nan if text is None else float(text)
    return seconds if math.isfinite(seconds) else None
