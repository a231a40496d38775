"""Compare results with references, and record references."""

from ...base.errors import CommandError, find_machine_fault
from ...recorders.tubes.signal_check import compare_signal, describe_departure, select_outside
from ...recorders.tubes.tolerance import find_tolerance
from ..check import check
from ..messages import sentence
from ..references.playback import run_reference
from ..references.recording import record_reference as write_references
from ..references.reference_files import ReferenceSolution, read_reference, reference_folder
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, blocked, failed, passed, skipped

_RULES = Clause(
    "3",
    "The rules have been tightened to allow automatic result comparison with specified epsilon bands.",
    "FMI Cross-Check Rules 4.1",
)


@check(
    "reference.agrees",
    "Outputs stay within the tubes around their references",
    _RULES,
    "The plot shows where. If the change is intended, record the reference again.",
    needs=("run.completes",),
    time_factor=6.0,
)
def agrees(subject: Subject) -> CheckOutcome:
    """Run the FMU along its reference files and check every column against its tube."""
    folder = reference_folder(subject.path, subject.settings.reference)
    name = subject.path.stem
    if folder is None:
        given = subject.settings.reference
        if given is not None:
            return blocked(f"There is no {name}_ref.csv in {given}.", hint="Check the names of its files.")
        return skipped(f"There is no {name}_ref.csv next to the FMU.")
    try:
        reference = read_reference(folder, name)
        return _judged(subject, reference)
    except CommandError as error:
        return failed(sentence(error), hint="Correct the reference files.")


def _judged(subject: Subject, reference: ReferenceSolution) -> CheckOutcome:
    strange = [n for n in reference.solution if n != "time" and n not in subject.variables]
    if strange:
        raise CommandError(f"the reference has the column '{strange[0]}', but the FMU has no such variable.")
    found = run_reference(subject, reference)
    wanted = dict(reference.tolerance) | dict(subject.settings.tolerance)
    comparisons = tuple(
        compare_signal(
            name,
            str(subject.interface.unit(name) or ""),
            found.times,
            found.values[:, i],
            reference.solution["time"],
            reference.solution[name],
            find_tolerance(name, wanted),
        )
        for i, name in enumerate(found.names)
    )
    left = select_outside(comparisons)
    if left:
        more = tuple(describe_departure(c) + "." for c in left[1:])
        return failed(f"{describe_departure(left[0])}.", details=more, comparisons=comparisons)
    if not comparisons:
        return failed("The reference has only the column time.")
    closest = max(comparisons, key=lambda c: c.worst / c.tube.value if c.tube.value else 0.0)
    return passed(
        f"{len(comparisons)} signals stay within their tubes; {closest.signal} comes closest to its limit, "
        f"with {closest.worst / closest.tube.value if closest.tube.value else 0.0:.0%} of the tolerance.",
        comparisons=comparisons,
    )


@check(
    "reference.recorded",
    "Reference files are recorded from a run",
    _RULES,
    "The message says what to correct.",
    needs=("run.completes",),
    time_factor=30.0,
)
def recorded(subject: Subject) -> CheckOutcome:
    """Run the FMU as the settings say and write its reference files."""
    recording = subject.settings.recording
    assert recording is not None
    try:
        files = write_references(subject, recording)
    except CommandError as error:
        return failed(sentence(error))
    except OSError as error:
        said = f"'{recording.folder}' cannot be written: {error.strerror or error}."
        return failed(said) if find_machine_fault(error) is None else blocked(said, gaps=(said,))
    return passed(f"Wrote {', '.join(str(file) for file in files)}.")
