"""Pictures of a comparison: figures side by side, errors and motion over time, and maps."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars

from ...base.wording import format_rounded
from ...recorders.metrics import HELD, MetricDisplay
from ...study.paper import PRINTED
from ...views.plots.style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, new_figure, tidy_axes
from .plan import read_stability_maps
from .result import (
    PAPER,
    ROBUSTNESS,
    STABILITY,
    CompareResult,
    Row,
    choose_displays,
    choose_position_error,
    group_rows,
    label_variant,
)
from .statistics import SeedStatistics, describe_inequality, format_lost, group_by_variant, rank

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURES, ERRORS, MOTION = "comparison-figures", "comparison-errors", "comparison-motion"
CASES, MAP = "comparison-robustness", "comparison-stability-{}"
PICTURES = {
    FIGURES: "Figures of each joint with each controller",
    ERRORS: "Position errors of each joint over time with each controller",
    CASES: "Position errors of each joint with each controller in all cases",
    MAP.format(1): "Points at which each joint is held with each controller, first map",
    MAP.format(2): "Points at which each joint is held with each controller, second map",
    MOTION: "Position of the reference and load force of each joint over time",
}
"""What the pictures show, by their names."""

_BARS = ("position_error_m", "velocity_error_m_s", "torque_effort_N_m")
_LOGARITHMIC = {"load_position_error_m", "position_error_m", "velocity_error_m_s"}
"""Figures on logarithmic axes, drawn as points: bars have no beginning there."""
_SHADES = ("#12355f", "#2f6db3", "#8fb4d9", "#e4eef8")
"""Colours of errors, the smallest error first."""
_HOLDS, _NOT_HELD = "#cfe0f1", "#b0413e"
_MIN_ERROR_M = 1e-9
"""Errors in m below this limit are drawn at the limit, since a logarithm has no zero."""
_COLORS = (BLUE, ORANGE, GREEN, RED, PURPLE, GREY, "#1d8a99", "#c77cae", "#8c6d31", "#444444")


def draw_pictures(result: CompareResult) -> "dict[str, Figure]":
    """Return the pictures that suit the table, by name; none if nothing was run."""
    if not len(result.rows):
        return {}
    if result.table == ROBUSTNESS:
        return {CASES: _draw_cases(result)}
    if result.table == STABILITY:
        return _draw_maps(result)
    pictures = {FIGURES: _draw_figures(result)}
    if result.errors:
        pictures[ERRORS] = _draw_errors(result)
    if result.motions:
        pictures[MOTION] = _draw_motions(result)
    return pictures


def _choose_color(result: CompareResult, variant: str) -> str:
    return _COLORS[list(result.entrants).index(variant) % len(_COLORS)]


def _draw_figures(result: CompareResult) -> "Figure":
    """Draw a bar for each joint, figure and controller, and a line for the RSBA of the paper.

    Bars are means over seeds, with their standard deviations.
    """
    joints, displays = result.group("scenario", "joint"), choose_displays(result.rows.rows(named=True))
    bars = [*_BARS, "convergence_time_s" if result.table == PAPER else "settling_time_s"]
    if (error := choose_position_error(result.rows.rows(named=True)).name) not in bars:
        bars = [error, *_BARS, "load_settling_time_s"]
    height = 0.6 + 0.22 * len(result.entrants)
    printed = PRINTED if result.table == PAPER else ()
    figure, grid = new_figure(len(joints), len(bars), 2.6, height, sharex="none")
    for axes_row, ((scenario, joint), rows) in zip(grid, joints.items(), strict=True):
        for axes, name in zip(axes_row, bars, strict=True):
            if all(row[name] is None for row in rows):  # a rigid load beside one that is not
                axes.set_axis_off()
                continue
            cells = next((t.cells[scenario, joint] for t in printed if (scenario, joint) in t.cells), None)
            paper = None if cells is None else getattr(cells["rsba"], name)
            _draw_bars(axes, result, group_by_variant(rows), displays[name], paper)
            if axes is not axes_row[0]:
                axes.set_yticklabels([])
        axes_row[0].set_ylabel("\n".join(dict.fromkeys([scenario, joint])), fontsize=9)
    for axes, name in zip(grid[-1], bars, strict=True):
        axes.set_xlabel(f"{displays[name].label} / {displays[name].unit}", fontsize=9)
    title = "Controllers side by side; dotted: the paper's RSBA" if printed else "Controllers side by side"
    if describe_inequality(result.rows.rows(named=True)):
        title += "; terms are not equal: see comparison.md"
    figure.suptitle(title, fontsize=12, fontweight="bold")
    return figure


def _draw_bars(
    axes: "Axes",
    result: CompareResult,
    variants: Mapping[str, SeedStatistics],
    display: MetricDisplay,
    printed: float | None,
) -> None:
    """Draw one figure of a joint with each controller; `printed` is that of the paper's RSBA."""
    is_wide, ranking = display.name in _LOGARITHMIC, rank(variants, display)
    largest = display.factor * (printed or 0.0)
    axes.set_yticks(range(len(variants)), list(variants))
    axes.set_ylim(len(variants) - 0.4, -0.6)
    across = axes.get_yaxis_transform()
    for position, (variant, summary) in enumerate(variants.items()):
        color = _choose_color(result, variant)
        value = display.factor * (summary.mean(display.name) or 0.0) if summary.is_held else 0.0
        spread = display.factor * summary.spread(display.name) if summary.is_held else 0.0
        largest = max(largest, value)
        if not is_wide:
            axes.barh(position, value, xerr=spread, color=color, height=0.7)
        else:
            axes.axhline(position, color="#eeeeee", lw=4.0)
            if value:
                ends = [max(value - spread, 0.1 * value), value + spread]
                axes.plot(ends, [position, position], color=color, lw=1.5)
                axes.plot([value], [position], "o", color=color)
        if ranking and ranking.is_winner and ranking.best == variant:
            axes.text(0.98, position, "wins", transform=across, **_WINNER_STYLE)
        if not summary.is_held:
            axes.text(0.02, position, format_lost(summary, display), transform=across, **_NOTE_STYLE)
        elif is_wide and not value:  # a logarithmic axis has no zero
            axes.text(0.02, position, "0", transform=across, **_NOTE_STYLE)
    if printed is not None:
        axes.axvline(display.factor * printed, color="black", lw=1.0, ls=":")
    tidy_axes(axes)
    if not is_wide:
        axes.set_xlim(0.0, 1.15 * largest or 1.0)
    elif largest:
        axes.set_xscale("log")
        _label_decades(axes)


def _label_decades(axes: "Axes") -> None:
    """Label a logarithmic axis with plain numbers, over at least one decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_xlim()
    room = max(1.3, float(np.sqrt(10.0 * low / high)))
    low, high = low / room, high * room
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 300.0 * low else (1.0, 3.0), numticks=5))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


_NOTE_STYLE: dict[str, Any] = {"va": "center", "fontsize": 7, "color": _NOT_HELD}
_WINNER_STYLE: dict[str, Any] = {"va": "center", "ha": "right", "fontsize": 7, "fontweight": "bold"}


def _draw_errors(result: CompareResult) -> "Figure":
    """Draw the position error of each joint over time, for each controller."""
    joints = result.group("scenario", "joint")
    figure, grid = new_figure(len(joints), 1, 8.0, 1.9, sharex="none")
    for axes, ((scenario, joint), rows) in zip(grid[:, 0], joints.items(), strict=True):
        for row in rows:
            if (errors := result.errors.get(row["run"])) is not None:
                time, error = errors["time"].to_numpy(), np.abs(errors[joint].to_numpy())
                stride = max(len(time) // 400, 1)  # the largest error of those that share a dot
                count = len(time) // stride * stride
                largest = 1e6 * np.fmax(error[:count].reshape(-1, stride).max(axis=1), _MIN_ERROR_M)
                axes.plot(
                    time[:count:stride], largest, color=_choose_color(result, label_variant(row)), lw=1.0
                )
        axes.set_yscale("log")
        axes.set_ylim(1e-2, 1e5)
        subject = "load error" if choose_position_error(rows).name.startswith("load") else "error"
        axes.set_ylabel(f"{', '.join(dict.fromkeys([scenario, joint]))}\n|{subject}| / µm", fontsize=9)
        tidy_axes(axes)
    grid[-1, 0].set_xlabel("time / s", fontsize=9)
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=_choose_color(result, name), label=name) for name in result.entrants]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 5), fontsize=8, frameon=False
    )
    figure.suptitle("Position errors: the largest in each 400th of the time", fontsize=12, fontweight="bold")
    return figure


def _draw_motions(result: CompareResult) -> "Figure":
    """Draw reference and load of each joint over time; both are the same for all controllers."""
    has_load = any("load" in motion.columns for motion in result.motions.values())
    figure, grid = new_figure(len(result.motions), 1 + has_load, 4.0, 1.5, sharex="none")
    for axes_row, ((scenario, joint), motion) in zip(grid, result.motions.items(), strict=True):
        for axes, (name, factor) in zip(axes_row, (("reference", 1.0), ("load", 1e-3)), strict=False):
            if name in motion.columns:
                axes.plot(motion["time"], factor * motion[name], color=BLUE, lw=1.0)
            tidy_axes(axes)
        axes_row[0].set_ylabel("\n".join(dict.fromkeys([scenario, joint])), fontsize=9)
    for axes, title in zip(grid[0], ("position of the reference / m", "load force / kN"), strict=False):
        axes.set_title(title, fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("time / s", fontsize=9)
    figure.suptitle("Motion and load, equal for all controllers", fontsize=12, fontweight="bold")
    return figure


def _draw_cases(result: CompareResult) -> "Figure":
    """Draw for each joint a table of cases and controllers, shaded by the position error."""
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    joints, display = result.group("scenario", "joint"), choose_position_error(result.rows.rows(named=True))
    cases, columns = list(dict.fromkeys(result.rows["case"])), list(result.entrants)
    height = 0.6 + 0.24 * len(cases)
    figure, grid = new_figure(1, len(joints), 1.2 + 0.62 * len(columns), height, sharex="none")
    shades = LinearSegmentedColormap.from_list("error", _SHADES).with_extremes(bad=_NOT_HELD)
    errors = result.rows.filter(polars.col(HELD))[display.name].drop_nulls().drop_nans().to_numpy()
    low, high = (np.fmax(end(errors), _MIN_ERROR_M) if len(errors) else 1.0 for end in (np.min, np.max))
    # at least a decade: equal errors must not look as different as the whole scale
    norm = LogNorm(1e6 * low, 1e6 * max(high, 10.0 * low))
    picture: Any = None
    for axes, ((_, joint), rows) in zip(grid[0], joints.items(), strict=True):
        values = np.full((len(cases), len(columns)), np.nan)
        for (case,), group in group_rows(rows, "case").items():
            for variant, summary in group_by_variant(group).items():
                y, x = cases.index(case), columns.index(variant)
                text, mean = format_lost(summary, display), summary.mean(display.name)
                text = text.replace(" in ", "\nin ").replace(" (", "\n").removesuffix(")")
                if summary.is_held:
                    values[y, x] = np.nan if mean is None else 1e6 * max(mean, _MIN_ERROR_M)
                    text = format_rounded(values[y, x])
                is_dark = not summary.is_held or norm(values[y, x]) < 0.45
                style = {"fontsize": 6, "color": "white" if is_dark else "black"}
                axes.text(x + 0.5, y + 0.5, text, ha="center", va="center", **style)
        cells = np.ma.masked_invalid(values)
        picture = axes.pcolormesh(cells, cmap=shades, norm=norm, edgecolors="white", lw=0.5)
        labels = [variant.replace("/", "\n") for variant in columns]
        axes.set_xticks(np.arange(len(columns)) + 0.5, labels, fontsize=7, rotation=40, ha="right")
        names = cases if axes is grid[0, 0] else []
        axes.set_yticks(np.arange(len(names)) + 0.5, names, fontsize=8)
        axes.invert_yaxis()
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        axes.set_title(joint, fontsize=10)
        axes.set_facecolor("#eeeeee")
    bar = figure.colorbar(picture, ax=grid[0, -1])
    bar.set_label(f"{display.label} / µm; red: not held", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return figure


def _draw_maps(result: CompareResult) -> "dict[str, Figure]":
    """Draw for each map a panel for each joint and controller that shows which points hold."""
    figures = {}
    for number, grid_map in enumerate(read_stability_maps(), start=1):
        rows = result.rows.filter(polars.col("case").str.starts_with(f"{grid_map.name}:")).rows(named=True)
        if not rows:
            continue
        joints = list(dict.fromkeys(row["joint"] for row in rows))
        figure, grid = new_figure(len(joints), len(result.entrants), 1.7, 1.7, sharex="none")
        for axes_row, joint in zip(grid, joints, strict=True):
            for axes, variant in zip(axes_row, result.entrants, strict=True):
                _draw_map(axes, [r for r in rows if r["joint"] == joint and label_variant(r) == variant])
                axes.label_outer()
                if joint == joints[0]:
                    axes.set_title(variant.replace("/", "\n"), fontsize=9)
            axes_row[0].set_ylabel(f"{joint}\n{grid_map.y.label}", fontsize=8)
        figure.supxlabel(grid_map.x.label, fontsize=9)
        figure.suptitle(f"{grid_map.name}\nblue: holds, red: not held", fontsize=10)
        figures[MAP.format(number)] = figure
    return figures


def _draw_map(axes: "Axes", rows: Sequence[Row]) -> None:
    """Draw the points of one controller and joint; a point holds if it does with all seeds."""
    from matplotlib.colors import ListedColormap

    x, y = (sorted({row[name] for row in rows}) for name in ("x", "y"))
    table = np.full((len(y), len(x)), np.nan)
    for row in rows:
        point = y.index(row["y"]), x.index(row["x"])
        table[point] = np.fmin(table[point], row[HELD])  # the worst of several seeds
    if rows:
        style = {"cmap": ListedColormap([_NOT_HELD, _HOLDS]), "edgecolors": "white", "lw": 0.5}
        axes.pcolormesh(x, y, np.ma.masked_invalid(table), vmin=0.0, vmax=1.0, **style)
    axes.tick_params(labelsize=7)
    axes.spines[:].set_visible(False)
