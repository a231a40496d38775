"""Results against references."""

from ...base.errors import CommandError
from ...recorders.tubes.signal_check import compare_signal, describe_departure, select_outside
from ...recorders.tubes.tolerance import find_tolerance
from ..check import check
from ..messages import sentence
from ..references.playback import run_reference
from ..references.recording import record_reference as write_references
from ..references.reference_files import ReferenceSolution, read_reference, reference_folder
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, failed, passed, skipped, warned

_RULES = Clause(
    "3",
    "The rules have been tightened to allow automatic result comparison with specified epsilon bands.",
    "FMI Cross-Check Rules 4.1",
)


@check(
    "reference.agrees",
    "Outputs stay within the tubes around their references",
    _RULES,
    "The plot shows where; if the change is meant, make the reference anew, else look for what changed.",
    needs=("run.completes",),
    time_factor=6.0,
)
def agrees(subject: Subject) -> CheckOutcome:
    """Run along the reference files, every column stays within its tolerance in value and time."""
    folder = reference_folder(subject.path, subject.settings.reference)
    name = subject.path.stem
    if folder is None:
        given = subject.settings.reference
        if given is not None:  # somebody expects one
            return warned(f"There is no {name}_ref.csv in {given}.", hint="See how the folder is laid out.")
        return skipped(f"There is no {name}_ref.csv beside the FMU.")
    try:
        reference = read_reference(folder, name)
        return _judged(subject, reference)
    except CommandError as error:
        return failed(sentence(error), hint="Mend the reference files.")


def _judged(subject: Subject, reference: ReferenceSolution) -> CheckOutcome:
    strange = [n for n in reference.solution if n != "time" and n not in subject.variables]
    if strange:
        raise CommandError(f"the reference has the column '{strange[0]}', which is no variable of the FMU.")
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
        return failed("The reference has no column but time.")
    closest = max(comparisons, key=lambda c: c.worst / c.tube.value if c.tube.value else 0.0)
    return passed(
        f"{len(comparisons)} signals stay within their tubes; {closest.signal} comes closest to its edge, "
        f"with {closest.worst / closest.tube.value if closest.tube.value else 0.0:.0%} of what is allowed.",
        comparisons=comparisons,
    )


@check(
    "reference.recorded",
    "Reference files are made of a run",
    _RULES,
    "The sentence says what does not fit.",
    needs=("run.completes",),
    time_factor=30.0,
)
def recorded(subject: Subject) -> CheckOutcome:
    """The FMU is run as the settings say, and what it does is kept."""
    recording = subject.settings.recording
    assert recording is not None
    try:
        files = write_references(subject, recording)
    except CommandError as error:
        return failed(sentence(error))
    except OSError as error:
        return failed(f"'{recording.folder}' cannot be written: {error.strerror or error}.")
    return passed(f"Wrote {', '.join(str(file) for file in files)}.")
