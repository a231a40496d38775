"""Compare two runs that should be equal."""

import math

from ..host.instance_runs import OutputTrajectory
from ..verdict import CheckOutcome, failed, passed, warned

_CLOSE = 1e-3
"""Allowed difference between two solvers or step sizes, relative to an output's range."""

ROUNDING = 1e-9
"""Allowed effect of memory alignment or summation order, relative to an output's range."""


def compare_runs(
    found: OutputTrajectory, wanted: OutputTrajectory, what: str, allowed: float = ROUNDING
) -> CheckOutcome:
    """Compare two runs that should be equal.

    Args:
        found: Run to judge.
        wanted: Run to compare with.
        what: Name of the run, the subject of the message: `A second run`.
        allowed: Largest allowed difference, relative to an output's range.

    Returns:
        Passed if both are equal, a warning within `allowed`, otherwise failed.
    """
    apart = found.distance(wanted)
    if found.same(wanted):
        return passed(
            f"{what} gave the same {len(wanted.times)} x {len(wanted.names)} values to the last bit."
        )
    if not apart.any():  # 0 and -0, or two kinds of NaN
        return passed(f"{what} gave the same {len(wanted.times)} x {len(wanted.names)} values.")
    if len(found.times) != len(wanted.times):
        return failed(
            f"{what} ended at t = {found.times[-1]:.9g} s, not at t = {wanted.times[-1]:.9g} s.",
            figures={"largest_difference": math.inf},
        )
    name, time = found.first_difference(wanted)
    worst = int(apart.argmax()) if len(apart) else 0
    figures = {"largest_difference": float(apart[worst]) if len(apart) else 0.0}
    most = f", most in {wanted.names[worst]}, by {apart[worst]:.3g} of its range" if wanted.names else ""
    sentence = f"{what} differs from {name} at t = {time:.9g} s on{most}."
    return (failed if figures["largest_difference"] > allowed else warned)(sentence, figures=figures)


def differing(found: OutputTrajectory, wanted: OutputTrajectory, rows: int) -> tuple[list[str], float]:
    """Compare the first rows of two runs that need not be bitwise equal.

    Returns:
        A message without period for each output that differs by more than 1e-3 of its range, and the
        largest difference relative to the range.
    """
    apart = found.until(rows).distance(wanted.until(rows))
    far = [(name, d) for name, d in zip(wanted.names, apart, strict=True) if d > _CLOSE]
    return [f"{name} differs by {d:.3g} of its range" for name, d in far], max(apart, default=0.0)
