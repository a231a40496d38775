"""Checks of the files that FMI-LS-REF lists: experiments, parameter sets, states and meta-data."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np

from emla_cosim.base.errors import CommandError

from ..check import (
    RETURNS,
    CheckOutcome,
    NotRunError,
    Verdict,
    check,
    failed,
    passed,
    quote,
    skipped,
    unjudged,
    warned,
)
from ..host.experiment import OutputTrajectory, list_outputs, make_experiment, read_span, step_through
from ..host.hosted_instance import CallError, HostedInstance
from ..messages import format_sentence, join_few_names
from ..references.experiments import (
    SRMD,
    SSV,
    TRANSIENT,
    TYPES,
    ExperimentSetup,
    RelatedFile,
    find_xml_fault,
    is_of_type,
    is_xml,
    list_experiment_files,
    list_related,
    read_experiments,
    read_parameter_values,
    read_setup,
)
from ..references.judgment import check_columns, combine_outcomes, judge_run, run_reference
from ..references.reference_files import ReferenceSolution, list_companions
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process
from ._sameness import ROUNDING, compare_runs
from .states import restore_bytes

_FACTOR, _TIME_FRACTION = 6.0, 0.8
"""Factor of the time limit for all experiments of a check, and the part of that in which they run."""


def _judge_each(
    subject: Subject,
    files: list[RelatedFile],
    judge: Callable[[Subject, RelatedFile], CheckOutcome],
    description: str,
) -> CheckOutcome:
    """Judge related files, each in its turn. Files that are elsewhere, or are not there, are listed."""
    outcomes = {f"'{f.source}'": _judge_safely(lambda f=f: judge(subject, f)) for f in files}
    return combine_outcomes(outcomes, f"The FMU lists no {description}.")


def _require_path(file: RelatedFile) -> Path:
    """Return the path of a related file. Raise NotRunError if it is not in the FMU."""
    if file.path is None:
        raise NotRunError("The file is not in the FMU.")
    return file.path


def _judge_safely(judge: Callable[[], CheckOutcome]) -> CheckOutcome:
    """Return an outcome, also for a file that is invalid, cannot be used here, or ends the process."""
    try:
        return judge()
    except (NotRunError, CommandError, CallError, EndedError) as error:
        return _judge_error(error)


def _judge_error(error: Exception) -> CheckOutcome:
    """Return the outcome for an error that came from reading or running a related file."""
    if isinstance(error, NotRunError):
        return unjudged(str(error))
    if isinstance(error, CommandError):
        return failed(format_sentence(error))
    if isinstance(error, CallError):
        return failed(str(error), clause=error.clause or (None if error.has_status else RETURNS))
    return failed(str(error), clause=RETURNS)


# ---- experiments --------------------------------------------------------------------------------


def _judge_experiments(subject: Subject, purposes: tuple[str, ...], description: str) -> CheckOutcome:
    """Run the experiments of the files with one of these sub-roles, and compare their references."""
    until = time.monotonic() + _TIME_FRACTION * _FACTOR * subject.settings.seconds
    outcomes = {}
    for file in list_related(subject.folder):
        if file.role != "experiment" or file.purpose not in purposes:
            continue
        try:
            setups = _read_experiments(subject, file)
        except (CommandError, NotRunError) as error:
            outcomes[f"'{file.source}'"] = _judge_error(error)
            continue
        for setup in setups:
            label = f"{setup.label} ({len(outcomes) + 1})" if setup.label in outcomes else setup.label
            outcome = _judge_safely(lambda setup=setup: _judge_experiment(subject, setup, until))
            if (
                outcome.verdict == Verdict.FAILED
                and (file := _find_listed_parameter_set(subject, setup)) is not None
            ):
                outcome = _attribute_to_parameter_set(subject, file, outcome)
            outcomes[label] = outcome
    return combine_outcomes(outcomes, f"The FMU lists no {description}.")


def _read_experiments(subject: Subject, file: RelatedFile) -> list[ExperimentSetup]:
    """Read the experiments of a related file. Raise NotRunError if its format is not read."""
    path = _require_path(file)
    if not is_of_type(file, TYPES, ".exp"):
        raise NotRunError(f"It has the type {file.type}. Its experiments were not run.")
    return read_experiments(path, subject.folder)


def _judge_experiment(subject: Subject, setup: ExperimentSetup, until: float) -> CheckOutcome:
    """Run an experiment until a time of `time.monotonic()`. Judge it by its references, if it has any."""
    if setup.analysis != TRANSIENT:
        raise NotRunError(f"{setup.analysis} is not run.")
    reference, unknown = read_setup(subject, setup)
    check_columns(subject, reference)
    trajectory = in_fresh_process(run_reference, subject, reference, until)
    outcome = (
        judge_run(subject, reference, trajectory, is_experiment=True)
        if "References" in setup.data
        else _judge_outputs(trajectory)
    )
    gaps = (*_explain_early_end(reference, trajectory, until), *reference.notes)
    if unknown and outcome.verdict == Verdict.PASSED and _find_listed_parameter_set(subject, setup) is None:
        message = f"Its parameters set {join_few_names(unknown)}, which the FMU does not have."
        return warned(message, gaps=gaps)
    return replace(outcome, gaps=gaps)


def _find_listed_parameter_set(subject: Subject, setup: ExperimentSetup) -> RelatedFile | None:
    """Return the parameter set of an experiment if it is listed, so that `related.parameters` judges it."""
    data = setup.data.get("Parameters")
    sets = [f for f in list_related(subject.folder) if f.role == "parameter" and f.path is not None]
    return None if data is None else next((f for f in sets if f.path == data.path), None)


def _attribute_to_parameter_set(subject: Subject, file: RelatedFile, outcome: CheckOutcome) -> CheckOutcome:
    """Return the outcome of a failed experiment, which is not judged if its parameter set alone fails."""
    if (
        outcome_of_set := _judge_safely(lambda: _judge_parameter_set(subject, file))
    ).verdict != Verdict.FAILED:
        return outcome
    return unjudged(
        f"Its parameter set '{file.source}' has a fault (`related.parameters`): {outcome_of_set.sentence}"
    )


def _judge_outputs(trajectory: OutputTrajectory) -> CheckOutcome:
    wrong = ~np.isfinite(trajectory.values)
    if wrong.any():
        return failed(trajectory.describe(wrong))
    return passed(f"It ran to t = {trajectory.times[-1]:.9g} s with finite outputs; it has no references.")


def _explain_early_end(
    reference: ReferenceSolution, trajectory: OutputTrajectory, until: float
) -> Iterator[str]:
    """Yield why a run ended before its stop time, if it did."""
    end, step = float(trajectory.times[-1]), reference.interval or reference.step or 0.0
    if end < reference.stop - step - 1e-9 * abs(reference.stop):
        why = "time was up" if time.monotonic() >= until else "the FMU asked to end the run"
        yield f"It ended at t = {end:.9g} s, not at t = {reference.stop:.9g} s: {why}."


@check(
    "related.smoke_tests",
    clause=quote("related.performed"),
    needs=("run.completes", "related.metadata"),
    time_factor=_FACTOR,
)
def smoke_tests(subject: Subject) -> CheckOutcome:
    """Run experiments with the role `experiment` or `experiment/smoke-test`, and compare their references."""
    return _judge_experiments(subject, ("", "smoke-test"), "smoke tests")


@check("related.validation", needs=("run.completes", "related.metadata"), time_factor=_FACTOR)
def validation(subject: Subject) -> CheckOutcome:
    """Run the experiments with the role `experiment/validation`, and compare their references."""
    return _judge_experiments(subject, ("validation",), "validations")


@check("related.uncertainty", needs=("run.completes", "related.metadata"), time_factor=_FACTOR)
def uncertainty(subject: Subject) -> CheckOutcome:
    """Run the experiments with the role `experiment/uncertainty-analysis`, without a variation."""
    outcome = _judge_experiments(subject, ("uncertainty-analysis",), "uncertainty analyses")
    if outcome.verdict == Verdict.SKIPPED and not outcome.gaps:
        return outcome
    gaps = (*outcome.gaps, "Nothing was varied: the format of experiments does not say what to vary.")
    return replace(outcome, gaps=gaps)


# ---- parameter sets -----------------------------------------------------------------------------


@check("related.parameters", needs=("run.completes", "related.metadata"), time_factor=_FACTOR)
def parameters(subject: Subject) -> CheckOutcome:
    """Check that parameter sets (SSV) name variables of the FMU, and that it runs a few steps with them."""
    files = [f for f in list_related(subject.folder) if f.role == "parameter"]
    return _judge_each(subject, files, _judge_parameter_set, "parameter sets")


_STEPS = 5
"""Steps of a run with a parameter set or from a state."""


def _judge_parameter_set(subject: Subject, file: RelatedFile) -> CheckOutcome:
    """Run a few steps with a parameter set; warn of names that the FMU does not have."""
    path = _require_path(file)
    if not is_of_type(file, (SSV,), ".ssv"):
        raise NotRunError(f"It has the type {file.type}, which is not read.")
    values, unknown = read_parameter_values(subject, path)
    in_fresh_process(_run_with_parameters, subject, values)
    if unknown:
        return warned(f"It sets {join_few_names(unknown)}, which the FMU does not have.")
    return passed(f"It sets {len(values)} variables; the FMU ran {_STEPS} steps with them.")


def _run_with_parameters(subject: Subject, values: dict[str, object]) -> None:
    course, instance = make_experiment(subject, _STEPS), HostedInstance(subject)
    instance.initialize({**course.at(0), **values}, float(course.times[0]))
    for _ in step_through(instance, course.times[:-1], course.step):
        pass
    instance.close()


# ---- states -------------------------------------------------------------------------------------


@check("related.states", needs=("run.completes", "related.metadata"), time_factor=3.0)
def states(subject: Subject) -> CheckOutcome:
    """Restore each serialized state in two new instances, and check that both continue, and the same."""
    files = [f for f in list_related(subject.folder) if f.role == "serialized-state"]
    return _judge_each(subject, files, _judge_serialized_state, "serialized states")


def _judge_serialized_state(subject: Subject, file: RelatedFile) -> CheckOutcome:
    """Judge a serialized state by two runs from it, in new instances."""
    path = _require_path(file)
    if file.purpose not in ("", fmpy.platform, fmpy.platform_tuple):
        raise NotRunError(f"It is for {file.purpose}, and this machine is {fmpy.platform_tuple}.")
    if not subject.has_capability("canSerializeFMUstate"):
        return failed("The FMU does not set canSerializeFMUstate, so that no tool can restore it.")
    data = path.read_bytes()
    # what the first one leaves in memory cannot help the second one
    first, second = (in_fresh_process(_run_from_state, subject, data) for _ in range(2))
    wrong = ~np.isfinite(first.values).all(axis=0)
    if wrong.any():
        name = first.names[int(np.argmax(wrong))]
        return failed(f"{name} is not finite in a run from it.")
    comparison = compare_runs(second, first, "A second run from it", ROUNDING)
    if comparison.verdict != Verdict.PASSED:
        return failed(comparison.sentence)
    if len(first.times) == 1:
        message = "It was restored, but not continued: its time is not known."
        return passed(message, gaps=(message,))
    return passed(f"Two new instances continued the same from t = {first.times[0]:.9g} s.")


def _run_from_state(subject: Subject, data: bytes) -> OutputTrajectory:
    """Restore a state, and return the outputs from there on, at its time only if that is not known."""
    instance, names = HostedInstance(subject), list_outputs(subject)
    course = make_experiment(subject, 1)
    instance.initialize(course.at(0), float(course.times[0]))
    restore_bytes(instance, data)
    clock = [n for n, v in subject.variables.items() if v.causality == "independent"]
    times, rows = [float(instance.get(clock)[0]) if clock else np.nan], [instance.get(names)]
    step = read_span(subject)[1]
    # the mode in which a model was saved is not known, nor are the next ticks of clocks
    if np.isfinite(times[0]) and instance.kind == "CoSimulation" and not subject.has_clocks:
        for _ in range(_STEPS):
            instance.step(times[-1], step)
            if instance.terminated:
                break
            times.append(times[-1] + step)
            rows.append(instance.get(names))
    instance.close()
    values = np.array(rows, dtype=float).reshape(len(rows), len(names))
    return OutputTrajectory(np.array(times), names, values)


# ---- meta-data ----------------------------------------------------------------------------------

_JUDGED_ROLES = ("experiment", "parameter", "serialized-state", "result")
"""Roles of files that other checks judge."""


@check("related.metadata", needs=("archive.safe",))
def metadata(subject: Subject) -> CheckOutcome:
    """Check that meta-data (SRMD) and other XML documents are valid, and list those that no check reads."""
    listed = list_related(subject.folder)
    if not listed:  # other checks need this one, so that they are skipped, too
        return skipped("The FMU lists no related files.")
    used = {None, *_list_used_files(subject)}
    other_files = [f for f in listed if f.role not in _JUDGED_ROLES and f.path not in used]
    readable = [f for f in other_files if is_xml(f)]
    outcome = _judge_each(subject, readable, _judge_document, "meta-data")
    if outcome.verdict == Verdict.SKIPPED:
        outcome = passed(f"{len(listed)} related files are listed; no meta-data was read.", gaps=outcome.gaps)
    unread_files = [f"{f.role} '{f.source}'" for f in other_files if f not in readable]
    gap = f"Related files with these roles were not read: {join_few_names(unread_files)}."
    return replace(outcome, blocks=False, gaps=(*outcome.gaps, *([gap] if unread_files else [])))


def _judge_document(subject: Subject, file: RelatedFile) -> CheckOutcome:
    if fault := find_xml_fault(file, subject.folder):
        return failed(fault)
    return passed("It is valid SRMD." if is_of_type(file, (SRMD,), ".srmd") else "It is well-formed XML.")


def _list_used_files(subject: Subject) -> set[object]:
    """Return the files that results and experiments need."""
    results = [f.path for f in list_related(subject.folder) if f.role == "result" and f.path is not None]
    used: set[object] = set()
    for file in list_experiment_files(subject):
        assert file.path is not None
        try:
            setups = read_experiments(file.path, subject.folder)
        except CommandError:  # its check reports it
            continue
        paths = {key: data.path for setup in setups for key, data in setup.data.items()}
        used.update(paths.values())
        results += [paths["References"]] if paths.get("References") is not None else []
    return used.union(*(list_companions(r) for r in results if r is not None))
