"""Compare results with references, and record references."""

from pathlib import Path

from emla_cosim.base.errors import CommandError, find_machine_fault
from emla_cosim.base.tubes.signal_check import compare_signal, describe_departure, select_outside
from emla_cosim.base.tubes.tolerance import find_tolerance

from ..check import check
from ..messages import sentence
from ..references.playback import run_reference
from ..references.recording import record_reference as write_references
from ..references.reference_files import ReferenceSolution, find_solution, read_reference
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, blocked, failed, passed, skipped

_RULES = Clause(
    "3",
    "The rules have been tightened to allow automatic result comparison with specified epsilon bands.",
    "FMI Cross-Check Rules 4.1",
)

_UNREAD = "The result in the FMU was not compared."


@check(
    "reference.agrees",
    "Outputs stay within the tubes around their references",
    _RULES,
    "The plot shows where. If the change is intended, record the reference again.",
    needs=("run.completes",),
    time_factor=6.0,
)
def agrees(subject: Subject) -> CheckOutcome:
    """Run the FMU along its reference files and check every column against its tube.

    They are those next to the FMU, or in the FMU as FMI-LS-REF lists them.
    """
    given, name = subject.settings.reference, subject.path.stem
    try:
        solution = find_solution(subject.path, given, subject.folder)
        if solution is None and given is not None:
            return blocked(f"There is no {name}_ref.csv in {given}.", hint="Check the names of its files.")
        if solution is None:
            return skipped(f"There is no {name}_ref.csv next to the FMU, and no result in it.")
        if solution.is_relative_to(subject.folder.resolve()):
            return _judge_related(subject, solution)
        return _judged(subject, read_reference(solution, subject.interface))
    except CommandError as error:
        return failed(sentence(error), hint="Correct the reference files.")


def _judge_related(subject: Subject, solution: Path) -> CheckOutcome:
    """Judge by a result in the FMU. Others make it, and need not say with which inputs."""
    try:
        reference = read_reference(solution, subject.interface)
    except CommandError as error:
        return skipped(f"The result in the FMU is no reference: {sentence(error)}", gaps=(_UNREAD,))
    if not reference.inputs and any(v.causality == "input" for v in subject.variables.values()):
        return skipped("The result in the FMU has no file with its inputs.", gaps=(_UNREAD,))
    return _judged(subject, reference)


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
            subject.interface.is_discrete(name),
        )
        for i, name in enumerate(found.names)
    )
    left = select_outside(comparisons)
    if left:
        more = (*(describe_departure(c) + "." for c in left[1:]), *reference.notes)
        return failed(f"{describe_departure(left[0])}.", details=more, comparisons=comparisons)
    if not comparisons:
        return failed("The reference has only the column time.")
    closest = max(comparisons, key=lambda c: c.worst / c.tube.value if c.tube.value else 0.0)
    return passed(
        f"{len(comparisons)} signals stay within their tubes; {closest.signal} comes closest to its limit, "
        f"with {closest.worst / closest.tube.value if closest.tube.value else 0.0:.0%} of the tolerance.",
        details=tuple(reference.notes),
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
