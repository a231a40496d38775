"""Compare two runs that should be equal."""

import math

from ..check import CheckOutcome, failed, passed, warned
from ..host.experiment import OutputTrajectory

_CLOSE = 1e-3
"""Allowed difference between two solvers or step sizes, relative to an output's range."""

ROUNDING = 1e-9
"""Allowed effect of memory alignment or summation order, relative to an output's range."""


def compare_runs(
    actual: OutputTrajectory, expected: OutputTrajectory, run_name: str, allowed: float = ROUNDING
) -> CheckOutcome:
    """Compare two runs that should be equal.

    Args:
        actual: Run to judge.
        expected: Run to compare with.
        run_name: Name of the run, the subject of the message: `A second run`.
        allowed: Largest allowed difference, relative to an output's range.

    Returns:
        Passed if both are equal, a warning within `allowed`, otherwise failed.
    """
    deviations = actual.distance(expected)
    same_values = f"{run_name} gave the same {len(expected.times)} x {len(expected.names)} values"
    if actual.has_same_values(expected):
        return passed(f"{same_values} to the last bit.")
    if not deviations.any():  # 0 and -0, or two kinds of NaN
        return passed(f"{same_values}.")
    if len(actual.times) != len(expected.times):
        return failed(
            f"{run_name} ended at t = {actual.times[-1]:.9g} s, not at t = {expected.times[-1]:.9g} s.",
            figures={"largest_difference": math.inf},
        )
    name, time = actual.find_first_difference(expected)
    worst = int(deviations.argmax()) if len(deviations) else 0
    figures = {"largest_difference": float(deviations[worst]) if len(deviations) else 0.0}
    sentence = f"{run_name} differs from {name} at t = {time:.9g} s on"
    if expected.names:
        sentence += f", most in {expected.names[worst]}, by {deviations[worst]:.3g} of its range"
    sentence += "."
    return (failed if figures["largest_difference"] > allowed else warned)(sentence, figures=figures)


def describe_differences(
    actual: OutputTrajectory, expected: OutputTrajectory, rows: int
) -> tuple[list[str], float]:
    """Compare the first rows of two runs that need not be bitwise equal.

    Returns:
        A message without period for each output that differs by more than 1e-3 of its range, and the
        largest difference relative to the range.
    """
    deviations = actual.take_rows(rows).distance(expected.take_rows(rows))
    far = [(name, d) for name, d in zip(expected.names, deviations, strict=True) if d > _CLOSE]
    return [f"{name} differs by {d:.3g} of its range" for name, d in far], max(deviations, default=0.0)
