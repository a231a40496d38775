"""What an identification writes and shows: estimates, fits, planned experiments, and pictures of them."""

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...base.wording import format_count
from ...views.plots.style import BLUE, GREY, ORANGE, RED, new_figure
from ..frame.outputs import Outputs
from ..frame.plan_files import format_scenario
from ..frame.report import Report, ReportTable, Section, Text
from .certainty import Estimate
from .residuals import Fit
from .result import IdentificationResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCENARIO = "identified.toml"
"""Scenario with the estimates."""

_RECORD, _FIT, _CERTAINTY = "identify.json", "fit.png", "certainty.png"

_MAX_PICTURES = 6
"""Most signals of experiments that are drawn: the worst."""


def build_report(result: IdentificationResult) -> Report:
    """Return the report of an identification."""
    count = format_count(result.runs, "run")
    duration = [f"{count} in {result.wall_s:.0f} s"]
    limits: list[Text | str] = [
        Text(f"{estimate.name} is not identified: {estimate.problem}.", is_failure=True)
        for estimate in result.estimates
        if estimate.problem is not None
    ]
    limits += [f"Note: {note.rstrip('.')}." for note in result.notes]
    if result.candidates:
        table = _tabulate_candidates(result)
        sections = [Section("Experiments", tables=[table], under=[*limits, *duration])]
    else:
        certainty = {_CERTAINTY: "Intervals of the estimates within their ranges, and correlations"}
        fit = {_FIT: "Measured and predicted signals, and residuals"}
        fits = [_tabulate_fits(result)] if result.fits else []
        sections = [
            Section("Estimates", tables=[_tabulate_estimates(result)], under=limits, pictures=certainty),
            Section("Fit", tables=fits, pictures=fit, under=duration),
        ]
    facts = [count] if result.complete else [count, "interrupted"]
    return Report("Identification", result.name, facts, sections)


def _tabulate_estimates(result: IdentificationResult) -> ReportTable:
    rows = list[list[str | Text]]()
    for estimate in result.estimates:
        error = "" if estimate.error is None else f"{estimate.error:.2g}"
        name = Text(estimate.name, is_failure=estimate.problem is not None)
        interval, step_change = _format_interval(estimate), _format_step_change(estimate)
        start, value = f"{estimate.start:.5g}", f"{estimate.value:.5g}"
        rows.append([name, start, value, error, interval, estimate.unit, step_change])
    header = ("", "start", "estimate", "std. error", "95 % interval", "", "½ step")
    under = ("½ step: change of the estimate by half the step size, in standard errors.",)
    return ReportTable(f"Estimates of {result.name}", header, rows, under, texts=(0, 4, 5))


def _format_interval(estimate: Estimate) -> str:
    """Return the interval of an estimate; that of the profile likelihood if there is one."""
    if estimate.profile is not None:
        low, high = ("open" if x is None else f"{x:.5g}" for x in estimate.profile)
        return f"{low} … {high} (profile)"
    if estimate.interval is None:
        return "not identified"
    return f"{estimate.interval[0]:.5g} … {estimate.interval[1]:.5g}"


def _format_step_change(estimate: Estimate) -> str:
    """Return the change of an estimate by half the step, in standard errors; empty without an error."""
    if estimate.error is None:
        return ""
    return "not judged" if estimate.step_change is None else f"{estimate.step_change:.2f}"


def _tabulate_fits(result: IdentificationResult) -> ReportTable:
    rows = [
        [
            fit.experiment + (" (held out)" if fit.held_out else ""),
            fit.signal,
            str(fit.samples),
            f"{100.0 * fit.fit:.4g}",
            f"{fit.r2:.5g}",
            f"{fit.rms:.3g}",
            fit.unit,
            _describe_residuals(fit),
        ]
        for fit in result.fits
    ]
    header = ("", "", "samples", "fit / %", "R²", "rms", "", "residuals")
    return ReportTable("Fit", header, rows, texts=(0, 1, 6, 7))


def _describe_residuals(fit: Fit) -> str:
    if fit.related_input is not None:
        return f"related to {fit.related_input}"
    return "white" if fit.is_white else "correlated in time"


def _tabulate_candidates(result: IdentificationResult) -> ReportTable:
    rows = [
        [
            candidate.experiment,
            "none" if candidate.information == -math.inf else f"{candidate.information:.1f}",
            *("?" if width is None else f"{width:.3g}" for width in candidate.intervals.values()),
        ]
        for candidate in result.candidates
    ]
    header = ("", "information / bit", *_shorten_names([*result.candidates[0].intervals]))
    under = ("The columns of parameters are half widths of their intervals of 95 %.",)
    return ReportTable("What each experiment would tell", header, rows, under)


def draw_fit(result: IdentificationResult) -> "Figure":
    """Draw for each signal of each experiment what was measured and predicted, and the residuals below."""
    worst = sorted(result.fits, key=lambda fit: fit.fit)[:_MAX_PICTURES]
    worst = [fit for fit in result.fits if fit in worst]
    figure, grid = new_figure(2, max(len(worst), 1), 3.9, sharex="col")
    for j, fit in enumerate(worst):
        rows = result.samples.filter(
            (result.samples["experiment"] == fit.experiment) & (result.samples["signal"] == fit.signal)
        )
        time, measured, predicted = (rows[name].to_numpy() for name in ("time", "measured", "predicted"))
        unit = f" / {fit.unit}" if fit.unit else ""
        held_out = ", held out" if fit.held_out else ""
        _draw_line(grid[0, j], time, measured, GREY, "measured", ".")
        _draw_line(grid[0, j], time, predicted, BLUE, "predicted", "-")
        _draw_line(grid[1, j], time, predicted - measured, ORANGE, "", "-")
        grid[0, j].set_title(
            f"{fit.experiment}{held_out}: fit {100.0 * fit.fit:.4g} %", fontsize=10, parse_math=False
        )
        grid[0, j].set_ylabel(f"{fit.signal}{unit}", fontsize=8, parse_math=False)
        grid[1, j].set_ylabel(f"predicted - measured{unit}", fontsize=8, parse_math=False)
        grid[1, j].set_xlabel("time / s")
    if worst:
        grid[0, -1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    return figure


def draw_certainty(result: IdentificationResult) -> "Figure":
    """Draw the intervals of the estimates within their ranges, and the correlations."""
    count = len(result.estimates)
    figure, grid = new_figure(1, 2, 4.6, max(0.42 * count + 0.6, 2.4), sharex="none")
    _draw_estimates(grid[0, 0], result)
    _draw_correlations(figure, grid[0, 1], result)
    return figure


def _draw_line(
    axes: "Axes", time: np.ndarray, values: np.ndarray, color: str, label: str, style: str
) -> None:
    axes.plot(time, values, style, color=color, label=label, linewidth=1.0, markersize=2.5)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


def _draw_estimates(axes: "Axes", result: IdentificationResult) -> None:
    """Draw each estimate and its interval of 95 % within its range, with value and error as a text beside."""
    for i, estimate in enumerate(result.estimates):
        width = estimate.high - estimate.low
        color = RED if estimate.interval is None else BLUE
        low, high = (estimate.low, estimate.high) if estimate.interval is None else estimate.interval
        ends = [float(np.clip((x - estimate.low) / width, 0.0, 1.0)) for x in (low, high)]
        axes.plot(ends, [i, i], color=color, alpha=0.4, linewidth=5.0, solid_capstyle="butt")
        axes.plot([(estimate.value - estimate.low) / width], [i], "o", color=color, markersize=5)
        text = "not identified"
        if estimate.error is not None:
            text = f"{estimate.value:.4g} ± {estimate.error:.1g} {estimate.unit}"
        axes.text(1.04, i, text, fontsize=8, va="center", color=color, parse_math=False)
    names = _shorten_names([estimate.name for estimate in result.estimates])
    axes.set_yticks(range(len(names)), names, fontsize=8, parse_math=False)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(-0.02, 1.02)
    axes.set_xticks([0.0, 0.5, 1.0], ["low", "range", "high"])
    axes.set_title("interval of 95 %", fontsize=10)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def _shorten_names(names: Sequence[str]) -> list[str]:
    """Return names without the components that all have in common."""
    parts = [name.split(".") for name in names]
    common = 0
    while len(names) > 1 and all(len(x) > common + 1 and x[common] == parts[0][common] for x in parts):
        common += 1
    return [".".join(x[common:]) for x in parts]


def _draw_correlations(figure: "Figure", axes: "Axes", result: IdentificationResult) -> None:
    values = np.ma.masked_invalid(result.correlations)
    image = axes.imshow(values, cmap="RdBu", vmin=-1.0, vmax=1.0)
    names = _shorten_names([estimate.name for estimate in result.estimates])
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7, parse_math=False)
    axes.set_yticks(range(len(names)), [""] * len(names))
    for i in range(len(names)):
        for j in range(len(names)):
            if not values.mask.any() or not np.ma.getmaskarray(values)[i, j]:
                shade = "white" if abs(values[i, j]) > 0.6 else "black"
                axes.text(j, i, f"{values[i, j]:.2f}", ha="center", va="center", fontsize=7, color=shade)
    axes.set_title("correlation of the estimates", fontsize=10)
    figure.colorbar(image, ax=axes, shrink=0.8)


def _draw(result: IdentificationResult) -> "Iterator[tuple[str, Figure]]":
    if result.fits:
        yield _FIT, draw_fit(result)
        yield _CERTAINTY, draw_certainty(result)


def _format_scenario(result: IdentificationResult) -> str | None:
    if not result.estimates:
        return None
    return format_scenario(f"Estimates of the identification {result.name}", result.scenario, {})


OUTPUTS = Outputs[IdentificationResult](
    subject="identification",
    name="identify",
    tables={
        SCENARIO: _format_scenario,
        "samples.csv": lambda result: result.samples.write_csv() if result.fits else None,
        "history.csv": lambda result: result.history.write_csv() if result.estimates else None,
    },
    report=build_report,
    draw=_draw,
    pictures=(_FIT, _CERTAINTY),
    record_file=_RECORD,
)


def read_unfinished(folder: Path, names: Sequence[str]) -> dict[str, float] | None:
    """Return the best values of an unfinished identification of these parameters; None if there is none."""
    try:
        record = json.loads((folder / _RECORD).read_text(encoding="utf-8"))
        values = {item["name"]: float(item["value"]) for item in record["estimates"]}
        is_unfinished = record["status"] == "unfinished"
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    is_usable = list(values) == list(names) and all(map(math.isfinite, values.values()))
    return values if is_unfinished and is_usable else None
