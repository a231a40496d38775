"""Worst case by corners: a metric at all combinations of the low and high ends of what varies.

An analysis of one file, as an example: CONTRIBUTING.md explains it.
`python docs/corners.py lift lift.position_error_m --vary lift.plant.motor.R_s=80%:120%` runs it.
"""

import argparse
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import emla_cosim as ec
from emla_cosim.analyses.frame.outputs import Outputs
from emla_cosim.analyses.frame.report import Report, ReportTable, Section, Text
from emla_cosim.analyses.frame.session import Job, Session
from emla_cosim.analyses.variants.factors import merge_options, resolve_factors
from emla_cosim.analyses.variants.measures import MetricRequest, resolve_measures
from emla_cosim.base.progress import Progress
from emla_cosim.cli.command import read_factors
from emla_cosim.cli.commands.analysis import show_result
from emla_cosim.views.plots.style import BLUE, new_figure, tidy_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Corner:
    """One corner: values of the factors by name, the metric, and why it has none."""

    values: Mapping[str, Any]
    figure: float | None
    problem: str | None


@dataclass(frozen=True)
class CornersResult:
    """All corners that were run, the worst first."""

    name: str
    metric: str
    corners: Sequence[Corner]
    complete: bool


def corners(
    source: str | Path,
    vary: Mapping[str, Any],
    metric: str,
    *,
    output: Path | None = None,
    plots: bool = True,
    report: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> CornersResult:
    """Run a scenario at all corners of what varies.

    Args:
        source: Scenario, as for `load`.
        vary: What varies, as for `sweep`.
        metric: Name of the metric; the largest value is the worst.
        output: Folder for results.
        plots: Whether to draw pictures.
        report: Whether to write a page.
        progress: Receives the progress.
        **options: Options of the runs, as for `load`.

    Raises:
        CommandError: A name or a range is wrong. Nothing was run.
        RunError: No corner was run, or files cannot be written.
    """
    session = Session(OUTPUTS, output=output, plots=plots, report=report, progress=progress)
    with session.with_workers():
        preparation = session.prepare(ec.load(source, **options))
        factors = resolve_factors(vary, preparation.system, preparation.interfaces, "corners")
        ends = list(itertools.product(*(factor.distribution.ends for factor in factors)))
        values = [[factor.value(end) for factor, end in zip(factors, corner, strict=True)] for corner in ends]
        jobs = [
            Job(merge_options(f.options(value) for f, value in zip(factors, corner, strict=True)))
            for corner in values
        ]
        with session.open_runs([preparation]) as runs:
            described = runs.describe()
            asked = MetricRequest.of([metric], "corners")
            measures = resolve_measures(asked, described.figures, list(described.units), [], [], "corners")
            session.progress.begin("running corners", len(jobs), "runs")
            outcomes = runs.run(jobs, measures, lambda chunk: session.progress.advance(len(chunk.outcomes)))
        names = [factor.name for factor in factors]
        ran = [
            Corner(dict(zip(names, values[i], strict=True)), outcome.figures.get(metric), outcome.problem)
            for i, outcome in outcomes.by_job.items()
        ]
        if not ran:
            raise ec.RunError("interrupted before the first corner ended.")
        ran.sort(key=_badness, reverse=True)
        result = CornersResult(Path(str(source)).stem, metric, ran, outcomes.complete)
        session.keep(result)
    return result


def _badness(corner: Corner) -> float:
    return float("inf") if corner.figure is None else corner.figure


def build_report(result: CornersResult) -> Report:
    """Return what people read: a row for each corner, the worst first."""
    names = list(result.corners[0].values)
    rows = [
        [f"{value:.6g}" for value in corner.values.values()]
        + [Text("none", is_failure=True) if corner.figure is None else f"{corner.figure:.6g}"]
        for corner in result.corners
    ]
    problems = dict.fromkeys(corner.problem for corner in result.corners if corner.problem is not None)
    title = f"Corners of {result.name}, the worst first"
    table = ReportTable(title, [*names, result.metric], rows, under=[*problems], texts=())
    pictures = {"corners.png": f"{result.metric} at each corner"}
    facts = [f"{len(rows)} corners", *([] if result.complete else ["interrupted"])]
    return Report("Corners", result.name, facts, [Section(tables=[table], pictures=pictures)])


def draw_corners(result: CornersResult) -> "Figure":
    """Draw a bar for each corner."""
    figure, grid = new_figure(1, 1, 5.0, 0.6 + 0.25 * len(result.corners))
    axes = grid[0, 0]
    labels = [", ".join(f"{value:.4g}" for value in corner.values.values()) for corner in result.corners]
    axes.barh(labels, [corner.figure or 0.0 for corner in result.corners], color=BLUE)
    axes.invert_yaxis()
    axes.set_xlabel(result.metric, fontsize=9)
    tidy_axes(axes)
    return figure


OUTPUTS = Outputs[CornersResult](
    subject="corners",
    name="corners",
    record=lambda result: {"format": "emla-corners", **asdict(result)},
    tables={},
    report=build_report,
    draw=lambda result: [("corners.png", draw_corners(result))],
    pictures=("corners.png",),
)


def main() -> None:
    """Run the analysis from a command line."""
    parser = argparse.ArgumentParser(description="Worst case by corners")
    parser.add_argument("scenario")
    parser.add_argument("metric")
    parser.add_argument("--vary", action="append", default=[], metavar="NAME=LOW:HIGH")
    parser.add_argument("--output", type=Path, default=Path("results/corners"))
    parser.add_argument("--report", action="store_true")
    given = parser.parse_args()
    try:
        with ec.BarProgress() as progress:
            result = corners(
                given.scenario,
                read_factors(given.vary),
                given.metric,
                output=given.output,
                report=given.report,
                progress=progress,
            )
    except ec.CosimError as error:
        raise SystemExit(f"Error: {error}") from error
    show_result(OUTPUTS, result, given.output)


if __name__ == "__main__":
    main()
