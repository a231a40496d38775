"""Judge runs by tubes around their references, and several runs together."""

from collections.abc import Mapping

from emla_cosim.base.errors import CommandError
from emla_cosim.base.tolerances import (
    Comparison,
    compare_signal,
    describe_departure,
    find_tolerance,
    select_outside,
)

from ..host.instance_runs import OutputTrajectory
from ..subject import Subject
from ..verdict import CheckOutcome, Verdict, failed, passed, skipped
from .reference_files import ReferenceSolution


def check_columns(subject: Subject, reference: ReferenceSolution) -> None:
    """Raise CommandError if a reference has a column that is not a variable of the FMU."""
    unknown = [n for n in reference.solution if n != "time" and n not in subject.variables]
    if unknown:
        raise CommandError(f"the reference has the column '{unknown[0]}', but the FMU has no such variable.")


def judge_run(
    subject: Subject, reference: ReferenceSolution, trajectory: OutputTrajectory, is_experiment: bool = False
) -> CheckOutcome:
    """Compare all columns of a reference with the run along it.

    A tolerance with a folder of references is for these: experiments in the FMU have other references.
    """
    tolerances = dict(reference.tolerance)
    if not (is_experiment and subject.settings.reference is not None):
        tolerances |= subject.settings.tolerance
    comparisons = tuple(
        compare_signal(
            name,
            str(subject.interface.unit(name) or ""),
            trajectory.times,
            trajectory.values[:, i],
            reference.solution["time"],
            reference.solution[name],
            find_tolerance(name, tolerances),
            subject.interface.is_discrete(name),
        )
        for i, name in enumerate(trajectory.names)
        if name in reference.solution
    )
    departures = select_outside(comparisons)
    if departures:
        more = (*(describe_departure(c) + "." for c in departures[1:]), *reference.notes)
        return failed(f"{describe_departure(departures[0])}.", details=more, comparisons=comparisons)
    if not comparisons:
        return failed("The reference has only the column time.")
    closest = max(comparisons, key=_share)
    return passed(
        f"{len(comparisons)} signals stay within their tubes; {closest.signal} comes closest to its limit, "
        f"with {_share(closest):.0%} of the tolerance.",
        details=tuple(reference.notes),
        comparisons=comparisons,
    )


def _share(comparison: Comparison) -> float:
    """Return the largest difference as a fraction of the tolerance."""
    return comparison.worst / comparison.tube.value if comparison.tube.value else 0.0


_ORDER = (Verdict.FAILED, Verdict.WARNING, Verdict.PASSED, Verdict.SKIPPED)


def combine(outcomes: Mapping[str, CheckOutcome], missing: str) -> CheckOutcome:
    """Return the worst of several outcomes, with a line for each of the others.

    Args:
        outcomes: Outcomes by what they are of, such as `The result a.csv`.
        missing: Message if there are none.
    """
    if not outcomes:
        return skipped(missing)
    labels = sorted(outcomes, key=lambda label: _ORDER.index(outcomes[label].verdict))
    first = outcomes[labels[0]]
    lines = {label: f"{label}: {outcomes[label].sentence}" for label in labels}
    return CheckOutcome(
        first.verdict,
        lines[labels[0]],
        details=(
            *(lines.values() if len(labels) > 1 else ()),
            *(line for label in labels for line in outcomes[label].details),
        ),
        comparisons=tuple(c for o in outcomes.values() if o.verdict == Verdict.FAILED for c in o.comparisons),
        figures={"compared": sum(len(o.comparisons) for o in outcomes.values())},
        hint=first.hint,
        clause=first.clause,
        gaps=tuple(f"{label}: {gap}" for label in labels for gap in outcomes[label].gaps),
    )
