"""Runs over one another: the same signals, or the same pictures, of each."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..arrays import Vector
from ..errors import CommandError, listed
from ..patterns import fits
from ..report.curves import drawable, thinned
from ..report.text import shortened, visible
from .kept import EVERYTHING, KeptRun, Window
from .plotting import FIGURES, Picture
from .style import COLORS, new_figure, tidied

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_PANELS = 16
"""Of one picture: more cannot be read."""

_LONGEST = 90
"""Letters of the name of a signal."""


@dataclass(frozen=True)
class Trace:
    """A line of a panel; `run` is the place of its run among all."""

    label: str
    run: int
    time: Vector
    values: Vector
    color: str
    dashed: bool = False


@dataclass(frozen=True)
class TracePanel:
    """Lines in one unit; in a grid, `column` and `label` say what stands above and left of it."""

    column: str
    label: str
    traces: tuple[Trace, ...]
    title: str = ""


def check_runs(runs: Sequence[KeptRun]) -> None:
    """Raise CommandError for more runs than can be told apart."""
    if len(runs) > len(COLORS):
        raise CommandError(f"{len(runs)} runs are too many for one picture, which tells {len(COLORS)} apart.")


def chosen_signals(runs: Sequence[KeptRun], patterns: Sequence[str]) -> list[str]:
    """The signals that patterns mean, of those that any run has; CommandError for one that finds nothing."""
    names = list(dict.fromkeys(name for run in runs for name in run.names))
    found = dict[str, None]()
    for pattern in patterns:
        matching = [n for n in names if fits(n, pattern)]
        if not matching:
            near = difflib.get_close_matches(pattern, names, n=3, cutoff=0.5)
            choices = f"did you mean {' or '.join(near)}?" if near else f"there are {_branches(names)}."
            raise CommandError(f"no signal is called '{pattern}'; {choices}", name=pattern, near=near)
        found |= dict.fromkeys(matching)
    return list(found)


def signal_panels(runs: Sequence[KeptRun], names: Sequence[str], window: Window) -> list[TracePanel]:
    """A panel for each unit; of several runs, for each signal, with a line for each run.

    Raises CommandError where these are too many, or there is nothing within the window.
    """
    groups = _by_unit(runs[0], names) if len(runs) == 1 else [(name,) for name in names]
    if len(groups) > _MOST_PANELS:
        raise CommandError(
            f"{len(names)} signals take {len(groups)} panels, and a picture has room for {_MOST_PANELS}; "
            f"choose with --signals from {_branches(names)}."
        )
    data = _windows(runs, names, window)
    panels = []
    for group in groups:
        traces = [
            Trace(_short(name), i, found["time"], found[name], COLORS[(k if len(runs) == 1 else i)])
            for k, name in enumerate(group)
            for i, found in enumerate(data)
            if name in found
        ]
        panels.append(
            TracePanel("", _unit(runs, group[0]), tuple(traces), _short(group[0]) if len(runs) > 1 else "")
        )
    return panels


def picture_panels(runs: Sequence[KeptRun], window: Window) -> dict[str, tuple[str, list[TracePanel]]]:
    """Title and panels of each of the registered pictures that runs have signals for, by name.

    Raises CommandError where there is none, or nothing within the window.
    """
    pictures = {name: p for name, p in FIGURES.items() if isinstance(p, Picture)}
    results = [run.result() for run in runs]
    wanted = {n for result in results for p in pictures.values() for n in p.signals(result)}
    if not wanted:
        branches = _branches(list(dict.fromkeys(name for run in runs for name in run.names)))
        raise CommandError(f"no run has signals whose role is known; choose --signals from {branches}.")
    _windows(runs, [], window)
    data = [run.read(wanted, EVERYTHING) for run in runs]  # what is settled, whole runs tell
    made = {}
    for name, picture in pictures.items():
        found: dict[tuple[str, str], list[Trace]] = {}
        for i, (result, values) in enumerate(zip(results, data, strict=True)):
            color = COLORS[i] if len(runs) > 1 else None
            for panel in picture.resolved(result, values) if len(values["time"]) else ():
                part = window.of(panel.time)
                found.setdefault((panel.column, panel.label), []).extend(
                    Trace(x.label, i, panel.time[part], x.values[part], color or x.color, x.dashed)
                    for x in panel.lines
                )
        if any(found.values()):
            panels = [TracePanel(column, label, tuple(traces)) for (column, label), traces in found.items()]
            made[name] = (picture.title, panels)
    return made


def missing(runs: Sequence[KeptRun], names: Sequence[str], window: Window) -> list[str]:
    """Sentences on runs that lack some of the signals, or end before the window."""
    notes = []
    for run in runs:
        known = set(run.names)
        lacking = [n for n in names if n not in known]
        if lacking:
            more = f" and {len(lacking) - 3} more" if len(lacking) > 3 else ""
            notes.append(f"{run.label} has no {', '.join(map(_short, lacking[:3]))}{more}")
        if not len(run.read([], window)["time"]):
            notes.append(f"{run.label} has no rows in the time that is shown")
    return notes


def overlaid(panels: Sequence[TracePanel], runs: Sequence[KeptRun], title: str = "") -> "Figure":
    """The panels as a picture: one below the other, or as a grid if they have columns."""
    columns = list(dict.fromkeys(panel.column for panel in panels))
    rows = list(dict.fromkeys(p.label for p in panels)) if columns != [""] else []
    figure, grid = new_figure(len(rows) or len(panels), len(columns), 3.9 if len(columns) > 1 else 7.5)
    if rows:
        for panel in panels:
            _draw(grid[rows.index(panel.label), columns.index(panel.column)], panel, len(runs))
        for j, column in enumerate(columns):
            grid[0, j].set_title(visible(column), fontsize=11, parse_math=False)
    else:
        for axes, panel in zip(grid[:, 0], panels, strict=True):
            _draw(axes, panel, len(runs))
            axes.set_title(panel.title, fontsize=9, loc="left", parse_math=False)
    for i, label in enumerate(rows or [panel.label for panel in panels]):
        grid[i, 0].set_ylabel(shortened(label, 40), parse_math=False)
    for axes in grid[-1]:
        axes.set_xlabel("time / s")
    said = title if len(runs) > 1 else " · ".join(filter(None, (title, runs[0].label)))
    figure.suptitle(said, fontsize=12, fontweight="bold", parse_math=False)
    if len(runs) > 1:
        _legend(figure, [run.label for run in runs])
    return figure


def _draw(axes: "Axes", panel: TracePanel, runs: int) -> None:
    for trace in panel.traces:
        values = drawable(trace.values)
        kept = thinned(values) if len(values) else slice(None)
        style = (0, (4, 2)) if trace.dashed else "-"
        width = 1.1 + 0.7 * (runs - 1 - trace.run)  # so that the first is seen where the last is the same
        axes.plot(trace.time[kept], values[kept], color=trace.color, linestyle=style, linewidth=width)
    labels = [trace.label for trace in panel.traces]
    tidied(axes, labels if runs == 1 and any(labels) else ())
    if (legend := axes.get_legend()) is not None:  # which may have to lie on lines
        legend.set_frame_on(True)
        legend.get_frame().set(alpha=0.8, edgecolor="none")


def _legend(figure: "Figure", labels: Sequence[str]) -> None:
    """Which colour each run has, once for all panels."""
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=COLORS[i], linewidth=2.0) for i in range(len(labels))]
    legend = figure.legend(
        lines, ["run"] * len(labels), loc="outside upper left", ncols=1, fontsize=9, frameon=False
    )
    for text, label in zip(legend.get_texts(), labels, strict=True):
        text.set(text=label, parse_math=False)


def _by_unit(run: KeptRun, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Signals with one unit, no more than there are colours."""
    units: dict[str, list[str]] = {}
    for name in names:
        units.setdefault(run.unit(name), []).append(name)
    most = len(COLORS)
    return [tuple(found[i : i + most]) for found in units.values() for i in range(0, len(found), most)]


def _unit(runs: Sequence[KeptRun], name: str) -> str:
    """The unit of a signal; CommandError where runs have it in different ones."""
    units = {unit: run.label for run in runs if (unit := run.unit(name))}
    if len(units) > 1:
        told = " and ".join(f"{unit} in {label}" for unit, label in units.items())
        raise CommandError(f"{_short(name)} is in {told}: that cannot be drawn in one panel.")
    return next(iter(units), "")


def _windows(runs: Sequence[KeptRun], names: Sequence[str], window: Window) -> list[Mapping[str, Vector]]:
    """What the runs have within a window; CommandError where that is nothing at all."""
    data = [run.read(names, window) for run in runs]
    if not any(len(found["time"]) for found in data):
        raise CommandError("there are no rows in the time that is to be shown, in any run.")
    return list(data)


def _branches(names: Sequence[str]) -> str:
    """What a person may choose from: names, or patterns where there are many."""
    if len(names) <= _MOST_PANELS:
        return listed([_short(n) for n in names])
    found = dict.fromkeys(n.rpartition(".")[0] for n in names)
    patterns = [f"{_short(branch)}.*" for branch in found if branch]
    return listed((patterns or [_short(n) for n in names])[:_MOST_PANELS])


def _short(name: str) -> str:
    return shortened(visible(name).replace("\n", " "), _LONGEST)
