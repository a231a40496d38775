"""How far apart two runs may be that should be one, and the sentence that says so."""

from ..host.instance_runs import OutputTrajectory
from ..verdict import CheckOutcome, failed, passed, warned

_CLOSE = 1e-3
"""Of an output's range: what two solvers, or two step sizes, may differ by."""

ROUNDING = 1e-9
"""Of an output's range: what another alignment of memory, or another order of a sum, may do."""


def compare_runs(
    found: OutputTrajectory, wanted: OutputTrajectory, what: str, allowed: float = ROUNDING
) -> CheckOutcome:
    """Passed where two runs are the same to the last bit, failed where they are further apart than allowed.

    `what` begins the sentence: `A second run`. `allowed` is in parts of an output's range; what is
    closer than that, and not the same, is worth a warning.
    """
    if found.same(wanted):
        return passed(
            f"{what} gave the same {len(wanted.times)} x {len(wanted.names)} values to the last bit."
        )
    name, time = found.first_difference(wanted)
    apart = found.distance(wanted)
    worst = int(apart.argmax()) if len(apart) else 0
    figures = {"largest_difference": float(apart[worst]) if len(apart) else 0.0}
    sentence = f"{what} differs from {name} at t = {time:.9g} s on{_most(wanted, worst, figures)}."
    return (failed if figures["largest_difference"] > allowed else warned)(sentence, figures=figures)


def differing(found: OutputTrajectory, wanted: OutputTrajectory, rows: int) -> tuple[list[str], float]:
    """Compare the first rows of two runs that need not be the same to the last bit.

    Returns:
        Beginnings of sentences on outputs that differ by more than a thousandth of their range, and the
        largest difference in parts of the range.
    """
    apart = found.until(rows).distance(wanted.until(rows))
    far = [(name, d) for name, d in zip(wanted.names, apart, strict=True) if d > _CLOSE]
    return [f"{name} differs by {d:.3g} of its range" for name, d in far], max(apart, default=0.0)


def _most(wanted: OutputTrajectory, worst: int, figures: dict[str, float]) -> str:
    if not wanted.names:
        return ""
    return f", most in {wanted.names[worst]}, by {figures['largest_difference']:.3g} of its range"
