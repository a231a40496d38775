"""The result of a run: its record, its remarks, and what it does not meet."""

from dataclasses import replace
from pathlib import Path

from ..base.errors import RunError
from ..base.faults import AcceptedFaults
from ..inputs.loaded_input import DataSpan
from ..master.assembly import Assembly
from ..master.coupling.estimate import CouplingError
from ..recorders.bond_energies import COUPLING
from ..recorders.metrics import SIGNALS, Figures, list_figures
from ..recorders.table import Table
from .agreement import build_agreement_record, describe_disagreement, describe_missing_part
from .execution import ActiveRun
from .remarks import describe_disabled_event_mode, describe_lost_values, describe_unscheduled_clocks
from .requirements import describe_unmet
from .result import Result
from .run_record import build_run_record
from .run_setup import describe_interval


def build_result(
    name: str,
    run: ActiveRun,
    assembly: Assembly,
    faults: AcceptedFaults,
    data: list[DataSpan],
    unpacked: Path | None,
    error: CouplingError | None,
) -> Result:
    """Return the result of a run so far.

    Args:
        name: Name of the scenario.
        run: The run.
        assembly: Its network of FMUs.
        faults: Violations of standards that were accepted.
        data: Spans of the data of inputs.
        unpacked: Folder with the FMUs of a package.
        error: Error of the coupling; None before the end of the run.
    """
    stepping, metrics, units = run.stepping, run.metrics, run.units
    coupling_figures = run.coupling.figures(error)
    error = error or run.coupling.without_estimate()
    if (end := run.problem or run.early_end) is not None:
        metrics.ended_early(end)
    report, times = stepping.report(), run.plan.times
    record = build_run_record(
        name, run.definition, assembly, run.plan, run.layout, report, run.problem, unpacked
    )
    record["accepted_faults"] = faults.list_by_file(unpacked)
    if run.stopped is not None:
        condition, at = run.stopped
        record["stopped_when"] = {"condition": str(condition), "time_s": at}
    if run.requested_end is not None:
        component = run.requested_end.fields["component"]
        record["requested_end"] = {"component": component, "time_s": stepping.time}
    spans = (span.describe_held(times.start, stepping.time, times.step) for span in data)
    record["remarks"] = [
        *filter(None, [run.early_end]),
        *faults.remarks(unpacked),
        *describe_disabled_event_mode(run.definition.system),
        *describe_lost_values(record),
        *describe_unscheduled_clocks(assembly.unscheduled_clocks),
        *(f"{text}." for text in assembly.violations),
        *filter(None, [run.fallback]),
        *describe_interval(run.plan),
        *filter(None, spans),
        *metrics.remarks(),
        *run.coupling.remarks(error),
        *stepping.remarks(),
    ]
    record["coupling"] = run.coupling.record(error)
    if run.plan.margins is not None:
        record["margins"] = run.plan.margins
    if (profile := run.profile()) is not None:
        record["profile"] = profile
    return Result(
        name=name,
        units=units,
        types=run.layout.types,
        times=times,
        table=next((r for r in run.recorders if isinstance(r, Table)), None),
        metrics=metrics.figures(),
        displays=metrics.displays,
        remarks=record["remarks"],
        steps=run.steps,
        simulated_s=run.simulated_s,
        end_s=stepping.time,
        wall_s=run.wall_s,
        stepping=report,
        pacing=run.plan.pacing.report() if run.plan.pacing is not None else None,
        problem=run.problem,
        interrupted=run.interrupted,
        stopped_when=None if run.stopped is None else str(run.stopped[0]),
        early_end=run.early_end,
        discrete=frozenset(name for name in units if assembly.names.find(name).is_discrete),
        record=record,
        parameters=run.layout.parameters,
        signals=metrics.signals(),
        coupling={**coupling_figures, **run.energies.figures()},
        roles=run.plan.options.roles,
        notes=run.plan.notes,
        profile=profile,
    )


def check_result(run: ActiveRun, result: Result) -> tuple[Result, RunError | None]:
    """Compare the result of a run with its reference and requirements.

    Returns:
        The result with its comparisons, and the error if the run failed or does not meet them.
    """
    if run.error is not None:
        return result, run.error
    stored = run.plan.stored
    if stored is not None and not run.interrupted:
        comparisons = result.compare(stored, run.plan.options.tolerance)
        record = {**result.record, "reference": build_agreement_record(comparisons, stored)}
        result = replace(result, comparisons=comparisons, record=record)
    if (problem := _describe_unmet(run, result)) is None:
        return result, None
    result = replace(result, problem=problem, record={**result.record, "status": problem})
    return result, RunError(problem)


def _describe_unmet(run: ActiveRun, result: Result) -> str | None:
    """Return a message on requirements that are not met, or None."""
    stored = run.plan.stored
    expected = [str(requirement) for requirement in run.plan.requirements]
    if stored is not None:
        expected.append(f"it agrees with '{stored.path}'")
    if run.interrupted and expected:
        return (
            f"interrupted at t = {result.end_s:.6g} s, before these requirements could be checked: "
            f"{'; '.join(expected)}."
        )
    kinds: dict[str, Figures] = {**result.metrics, COUPLING: result.coupling, SIGNALS: result.signals}
    kinds["run"] = {"run": result.run_figures}
    problems = [describe_unmet(run.plan.requirements, list_figures(kinds))]
    if stored is not None:
        problems.append(describe_disagreement(result.comparisons, stored))
        if run.requested_end is not None:
            problems.append(describe_missing_part(result.end_s, result.times.step, stored))
    return " ".join(filter(None, problems)) or None
