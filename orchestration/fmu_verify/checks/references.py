"""Compare results with references, and record references."""

from pathlib import Path

from emla_cosim.base.errors import CommandError, find_machine_fault

from ..check import CheckOutcome, NotRunError, blocked, check, failed, passed, quote, unjudged, warned
from ..messages import format_sentence
from ..references.experiments import (
    ExperimentSetup,
    RelatedFile,
    list_experiment_files,
    list_related,
    read_experiments,
    read_setup,
)
from ..references.judgment import check_columns, combine_outcomes, judge_run, run_reference
from ..references.recording import record_reference as write_references
from ..references.reference_files import find_solution, list_companions, read_reference
from ..subject import Subject
from ..subprocess_run import in_fresh_process

_RULES = quote("references.rules")

_RESULT = quote("references.result")


@check("reference.agrees", clause=_RULES, needs=("run.completes",), time_factor=6.0)
def agrees(subject: Subject) -> CheckOutcome:
    """Run the FMU along its reference files and check every column against its tube.

    They are those next to the FMU, or in the FMU as FMI-LS-REF lists them.
    """
    reference_folder, name = subject.settings.reference, subject.path.stem
    try:
        solution = find_solution(subject.path, reference_folder)
        if solution is None and reference_folder is not None:
            message = f"There is no {name}_ref.csv in {reference_folder}."
            return blocked(message, hint="Check the names of its files.")
        if solution is None:
            return _judge_results(subject)
        reference = read_reference(solution, subject.interface)
        check_columns(subject, reference)
        return judge_run(subject, reference, run_reference(subject, reference))
    except CommandError as error:
        return failed(format_sentence(error), hint="Correct the reference files.")


def _judge_results(subject: Subject) -> CheckOutcome:
    """Judge by the results in the FMU: CSV files with the role `result`, which FMI-LS-REF lists."""
    results = [
        f for f in list_related(subject.folder) if f.role == "result" and f.type == "text/csv" and f.path
    ]
    if len(results) == 1:
        return _judge_result(subject, results[0])
    none = f"There is no {subject.path.stem}_ref.csv next to the FMU, and no result in it."
    return combine_outcomes({f"The result {f.source}": _judge_result(subject, f) for f in results}, none)


def _judge_result(subject: Subject, file: RelatedFile) -> CheckOutcome:
    """Judge by a result in the FMU: along the experiment that names it, or the files beside it.

    Others make it, and need not say with which inputs.
    """
    assert file.path is not None
    try:
        setup = _find_experiment(subject, file.path)
        reference = read_setup(subject, setup)[0] if setup else None
        if reference is not None:
            check_columns(subject, reference)
    except (CommandError, NotRunError) as error:  # `related` judges experiments
        return _skip_result(format_sentence(error))
    if reference is None:
        try:
            reference = read_reference(file.path, subject.interface)
            if not reference.inputs and any(v.causality == "input" for v in subject.variables.values()):
                return _skip_result(
                    f"There is no file with its inputs, {list_companions(file.path)[0].name}."
                )
            check_columns(subject, reference)
        except CommandError as error:
            hint = "Correct the files of the result: columns are `time` and variables of the FMU."
            reason = format_sentence(error).replace(f"{file.path.parent}/", "")
            return warned(f"{file.source} cannot be compared: {reason}", hint=hint, clause=_RESULT)
    return judge_run(subject, reference, in_fresh_process(run_reference, subject, reference))


def _skip_result(reason: str) -> CheckOutcome:
    return unjudged(f"The result in the FMU was not compared. {reason}")


def _find_experiment(subject: Subject, result: Path) -> ExperimentSetup | None:
    """Return the experiment in the FMU that has a file as its references, or None."""
    for file in list_experiment_files(subject):
        assert file.path is not None
        for setup in read_experiments(file.path, subject.folder):
            if "References" in setup.data and setup.data["References"].path == result:
                return setup
    return None


@check("reference.recorded", clause=_RULES, needs=("run.completes",), time_factor=30.0)
def recorded(subject: Subject) -> CheckOutcome:
    """Run the FMU as the settings say and write its reference files."""
    recording = subject.settings.recording
    assert recording is not None
    try:
        files = write_references(subject, recording)
    except CommandError as error:
        return failed(format_sentence(error))
    except OSError as error:
        message = f"'{recording.folder}' cannot be written: {error.strerror or error}."
        return failed(message) if find_machine_fault(error) is None else blocked(message, gaps=(message,))
    return passed(f"Wrote {', '.join(str(file) for file in files)}.")
