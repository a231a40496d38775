"""Stability of each joint with each controller: margins at its fastest motion, and certificates."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import polars

from ...base.errors import CommandError, CosimError, RunError
from ...base.progress import Progress
from ...run.option_types import CompareOptions
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ...study.joint_certificates import JointCertificate, build_certificate_rows, certify
from ...study.loading import load
from ..execution.worker_payload import Preparation
from ..frame.outputs import Outputs
from ..frame.report import Report, ReportTable, Section, Text
from ..frame.session import Session
from ..linearize.measurement import NONLINEAR
from ..linearize.response import LARGEST_MS, LEAST_GAIN_DB, LEAST_PHASE_DEG
from ..linearize.result import MeasuredResponse
from ..linearize.runner import measure_loops
from ..variants.factors import find_start_values
from ..variants.measures import VariantOutcome
from .controller_variants import ALL, select_variants
from .plan import ComparisonPlan
from .result import LABELS, CompareResult, Row, choose_position_error
from .rows import FASTEST_AT, LARGEST_SPEED, list_joint_figures
from .statistics import describe_ranking, group_by_variant, mark_winner, name_observers

CERTIFICATE = "certificate"
"""Name of the tables for `emla compare`."""


@dataclass(frozen=True)
class SetCertificate:
    """The certificates of all joints with one set of gains; `problem` is the reason if there are none."""

    gains: str
    joints: Sequence[JointCertificate]
    problem: str | None = None

    @property
    def table(self) -> ReportTable:
        """Constants, predicted bounds and simulated values, with a column for each joint."""
        figures = build_certificate_rows(self.joints)
        rows = [[label, *(f"{value:.4g}" for value in values), unit] for label, unit, values in figures]
        header = ["", *(joint.joint for joint in self.joints), "unit"]
        title = f"Certificate of {self.gains}: bounds of the proof beside the run, from 0.3 s on"
        return ReportTable(title, header, rows, texts=(0, len(header) - 1))


@dataclass(frozen=True)
class CertificateResult:
    """Certificates of several sets of gains in a scenario.

    Attributes:
        name: Name of the scenario.
        sets: Certificates by set of gains.
    """

    name: str
    sets: Sequence[SetCertificate]

    @property
    def rows(self) -> polars.DataFrame:
        """A row for each set of gains and figure, with its unit, and a column for each joint."""
        return polars.DataFrame(
            {"gains": item.gains, "figure": label, "unit": unit}
            | dict(zip((joint.joint for joint in item.joints), values, strict=True))
            for item in self.sets
            for label, unit, values in build_certificate_rows(item.joints)
        )

    def markdown(self) -> str:
        """Return the tables and remarks of all sets as Markdown."""
        lines = list[str]()
        for item in self.sets:
            lines += [f"## {item.gains}", "", f"{item.problem}\n" if item.problem else item.table.markdown()]
            for joint in item.joints:
                lines += [f"{joint.joint}:", "", *(f"- {remark}" for remark in joint.remarks), ""]
        return "\n".join(lines)


def certify_gains(
    scenario: str | Path,
    gains: Sequence[str] | None = None,
    *,
    output: str | Path | None = None,
    overwrite: bool = False,
    report: bool = False,
    progress: Progress | None = None,
    **options: Unpack[CompareOptions],
) -> CertificateResult:
    """Certify sets of gains of RSBA, each beside a run of the scenario.

    Args:
        scenario: Name or file of the scenario.
        gains: Sets of gains. Default: all.
        output: Folder for results.
        overwrite: Whether to replace files that emla did not write.
        report: Whether to write a page, certificate.html, into the folder.
        progress: Receives the progress.
        **options: Options as for `load`.

    Raises:
        CommandError: A set does not exist, or the scenario has no joint with RSBA.
        RunError: A file cannot be written.
    """
    session = Session(OUTPUTS, output=output, overwrite=overwrite, report=report, progress=progress)
    sets = list[SetCertificate]()
    with session.reserve_folder():
        variants = select_variants(["rsba"], gains or [ALL])
        session.progress.begin("certifying", len(variants), "sets of gains")
        for variant in variants:
            overrides: dict[str, Any] = {**options, "controller": "rsba", "gains": variant.gains}
            try:
                with load(scenario, **overrides).prepare() as simulation:
                    sets.append(SetCertificate(variant.gains, certify(simulation)))
            except CommandError:
                raise
            except RunError as error:
                sets.append(SetCertificate(variant.gains, (), str(error)))
            session.progress.advance(1)
        result = CertificateResult(Path(scenario).stem, sets)
        session.keep(result)
    return result


def build_report(result: CertificateResult) -> Report:
    """Return the report of certificates."""
    sections = list[Section]()
    for item in result.sets:
        problem = [] if item.problem is None else [f"{item.gains}: {item.problem}"]
        sections.append(Section(item.gains, problem, [item.table] if item.joints else []))
        remarks = [f"{joint.joint}: {remark}" for joint in item.joints for remark in joint.remarks]
        if remarks:
            sections.append(Section(f"Assumptions of {item.gains} that are not met", remarks, is_detail=True))
    return Report("Certificate", result.name, [f"gains {item.gains}" for item in result.sets], sections)


OUTPUTS = Outputs[CertificateResult](
    subject="certificates",
    name=CERTIFICATE,
    record=None,
    record_file="certificate.csv",
    tables={
        "certificate.csv": lambda result: result.rows.write_csv(),
        "certificate.md": CertificateResult.markdown,
    },
    report=build_report,
)


POSITION_LOOP, CURRENT_LOOP = "position_loop", "current_loop"

LOOPS: Mapping[str, str] = {POSITION_LOOP: "{0}", CURRENT_LOOP: "{0}.controller.u_q->{0}.plant.u_q"}
"""Loops of a joint, and where each is opened, as for `linearize`."""

FIGURES = ("phase_margin_deg", "gain_margin_up_dB", "gain_margin_down_dB", "Ms", "delay_margin_s")
PROBLEM, AT, DELAY = "problem", "margins_at_s", "computing_delay_s"

COLUMNS: Mapping[str, Any] = {
    **dict.fromkeys(LABELS, polars.String),
    AT: polars.Float64,
    DELAY: polars.Float64,
    **{
        f"{loop}_{name}": polars.String if name == PROBLEM else polars.Float64
        for loop in LOOPS
        for name in (*FIGURES, PROBLEM)
    },
}
"""Columns. A figure is null if nothing limits it, or if `..._problem` says why there is none."""

_SAMPLES = 1500
"""Length of responses in steps."""

_DELAYS, _MAX_CHANGE = (0, 100, 200), 0.01
"""Steps to wait for a point at which the loop is constant, and the largest change of one that is. Margins
measured during a larger change differed by 20 degrees from those around it.
"""

_UNITS = ("error\n/ µm", "loop", "phase\n/ °", "gain\n/ dB", "Ms", "delay\n/ ms")
_HEADER = ("controller,\nobserver", *_UNITS, "conditions")


def measure_margins(
    plan: ComparisonPlan,
    outcomes: Mapping[int, VariantOutcome],
    interrupted: Callable[[], bool],
    progress: Progress,
) -> polars.DataFrame:
    """Return a row with the margins of each joint, controller and set of gains.

    The operating point of all controllers is where the reference of the joint is fastest, or up to 200 steps
    later if the loop is not linear and constant there. An interrupt ends the measurement early.

    The outcomes must be measured with `WITH_ERRORS`.
    """
    fastest = dict[tuple[str, str], tuple[float, float]]()  # runs that ended early may not reach it
    for key, figures in list_joint_figures(plan, outcomes):
        if LARGEST_SPEED in figures and figures[LARGEST_SPEED] > fastest.get(key, (-1.0, 0.0))[0]:
            fastest[key] = figures[LARGEST_SPEED], figures[FASTEST_AT]
    # the first run of each prepared system: further ones differ in their seeds only
    runs = list({run.group: run for run in reversed(plan.runs)}.values())[::-1]
    progress.begin("measuring margins", len(runs), "systems")
    rows = list[dict[str, Any]]()
    for run in runs:
        if interrupted():
            break
        for joint in run.joints:
            _, at = fastest.get((run.scenario, joint), (0.0, None))
            rows.append(
                run.labels(joint) | _measure_joint(plan.groups[run.group], joint, at, run.changes["set"])
            )
        progress.advance(1)
    return polars.DataFrame(rows, schema=dict(COLUMNS), orient="row")


def add_margins(rows: polars.DataFrame, margins: polars.DataFrame | None) -> polars.DataFrame:
    """Return the rows of a comparison with the columns of its margins, if there are any."""
    return rows if margins is None else rows.join(margins, on=[*LABELS], how="left", maintain_order="left")


def _measure_joint(
    part: Preparation, joint: str, fastest_at: float | None, values: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the margins of all loops of a joint at its fastest motion, or the problem of each loop."""
    delays = {**find_start_values(f"{joint}.plant.inverter.delay", part.system, part.interfaces), **values}
    row: dict[str, Any] = {DELAY: delays.get(f"{joint}.plant.inverter.delay")}
    if fastest_at is None:
        return row | {f"{loop}_{PROBLEM}": "no run reached the motion" for loop in LOOPS}
    times = run_times(part.options, part.name)
    count = min(_SAMPLES, times.steps // 2)
    first = round((fastest_at - times.start) / times.step)
    scenario = Scenario(part.name, "", part.system, part.options, resources=part.resources)
    opened = {loop: opening.format(joint) for loop, opening in LOOPS.items()}
    best, at = dict[str, MeasuredResponse | CosimError](), 0.0
    for later in _DELAYS:
        point = times.point(max(0, min(first + later, times.steps - count)))
        responses = measure_loops(scenario, list(opened.values()), point, count * times.step, values)
        if not best or _find_change(responses) < _find_change(best):
            best, at = responses, point
        if _find_change(best) < _MAX_CHANGE:
            break
    for loop, opening in opened.items():
        row |= {f"{loop}_{name}": value for name, value in _list_figures(best[opening]).items()}
    return row | {AT: at}


def _find_change(responses: Mapping[str, MeasuredResponse | CosimError]) -> float:
    """Return the largest relative change by pulses of another size or a step later.

    It is infinite if a loop was not measured.
    """
    return max(
        math.inf if isinstance(response, CosimError) else max(response.drift, response.nonlinearity)
        for response in responses.values()
    )


def _list_figures(response: MeasuredResponse | CosimError) -> dict[str, Any]:
    """Return the figures of a loop, or the problem in words."""
    if isinstance(response, CosimError):
        default = "run ended" if isinstance(response, RunError) else str(response)
        return {PROBLEM: response.fields.get("reason", default)}
    margins = response.margins
    assert margins is not None
    if not margins.has_crossover:
        return {PROBLEM: f"gain stays {'above' if response.response.gain_dB[0] > 0.0 else 'below'} 1"}
    if response.drift > NONLINEAR:
        return {PROBLEM: "changes with time"}
    values = (margins.phase_deg, margins.gain_up_dB, margins.gain_down_dB, margins.Ms, margins.delay_s)
    finite = (value if math.isfinite(value) else None for value in values)
    return dict(zip(FIGURES, finite, strict=True))


def list_missed_conditions(figures: Mapping[str, Any]) -> list[str]:
    """Return the conditions that the figures of a loop do not meet; a figure is None if nothing limits it."""
    phase, up, down, Ms = (figures[name] for name in FIGURES[:4])
    met = {
        "phase": phase is None or phase >= LEAST_PHASE_DEG,
        "gain": (up is None or up >= LEAST_GAIN_DB) and (down is None or down <= -LEAST_GAIN_DB),
        "Ms": Ms is None or Ms <= LARGEST_MS,
    }
    return [name for name, is_met in met.items() if not is_met]


def build_margin_tables(result: CompareResult) -> Iterator[ReportTable]:
    """Yield a table for each joint, with a row for each loop of each controller."""
    for (scenario, joint), rows in result.group("scenario", "joint").items():
        body, lines = list[list[Text | str]](), list[int]()
        statistics = group_by_variant(rows)
        errors, observers = mark_winner(statistics, choose_position_error(rows)), name_observers(rows)
        for name, summary in statistics.items():
            lines.append(len(body))
            heads = [(name, errors[name]), (observers[name], "")]
            for loop, head in zip(LOOPS, heads, strict=True):
                # the loops of all seeds are measured at one operating point: the first row has them
                body.append([*head, loop.removesuffix("_loop"), *_list_cells(summary.rows[0], loop)])
        times = sorted({row[AT] for row in rows if row[AT] is not None})
        delay = next((row[DELAY] for row in rows if row[DELAY] is not None), None)
        when = f" at t = {' and '.join(f'{at:.4g}' for at in times)} s" if times else ""
        delay_text = "unknown" if delay is None else f"{1e3 * delay:.3g} ms"
        under = [
            f"Computing delay: {delay_text}. Conditions: phase margin of at least {LEAST_PHASE_DEG:g}°, gain "
            f"margins of at least {LEAST_GAIN_DB:g} dB both ways, Ms of at most {LARGEST_MS:g}. none: "
            "nothing limits it.",
            *describe_ranking(rows),
        ]
        yield ReportTable(f"{joint} of {scenario}: stability margins{when}", _HEADER, body, under, lines)


def _list_cells(row: Row, loop: str) -> list[Text | str]:
    """Return margins and conditions of a loop, or the reason in words why there are none."""
    problem = row[f"{loop}_{PROBLEM}"]
    figures = {name: row[f"{loop}_{name}"] for name in FIGURES}
    if problem is not None or figures["Ms"] is None:
        reason = Text(problem or "not measured", is_failure=True)
        return [reason, "", "", "", Text("not met", is_failure=True)]
    phase, up, down, Ms, delay = figures.values()
    missed = list_missed_conditions(figures)
    return [
        _format(phase, ".1f"),
        f"{_format(up, '+.1f')}/{_format(down, '.1f')}",
        _format(Ms, ".2f"),
        _format(None if delay is None else 1e3 * delay, ".2f"),
        Text(f"not met: {', '.join(missed)}" if missed else "met", is_failure=bool(missed)),
    ]


def _format(value: float | None, digits: str) -> str:
    return "none" if value is None else f"{value:{digits}}"
