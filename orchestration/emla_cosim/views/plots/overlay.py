"""Plot signals of one or several runs, finished or stored."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import COLUMN_TYPES, REAL, SignalType, Vector, read_types
from ...base.errors import CommandError, check_choice
from ...base.files import read_text
from ...base.wording import find_names, select_names
from ...inputs.stored_runs import StoredRun, open_stored_run
from ...pages.panels import Line, Plot
from ...recorders.metrics import TRACKED, default_roles
from ...system.model import find_main_component
from .panel_drawing import read_rows
from .stacked import (
    LAYOUTS,
    MOST_LINES,
    MOST_PANELS,
    SCREEN,
    build_unit_panels,
    count_panels,
    draw_stacked,
    make_numbered_line,
    name_values,
    select_fitting_signals,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...run.result import Result

_FEW_PANELS = 2
"""Most panels of a summary."""

_MOST_RUNS = 2 * MOST_LINES
"""Most runs that colours and dashes can distinguish."""


@dataclass(frozen=True)
class Traces:
    """The signals of a run by name, with known units and roles.

    `label` is its name in plots; `files` are the files it was read from, and `notes` say how. `main` is the
    component whose variables need no component's name; empty without one.
    """

    label: str
    names: Sequence[str]
    units: Mapping[str, str]
    types: Mapping[str, SignalType]
    table: "Result | StoredRun"
    roles: Mapping[str, str]
    files: Sequence[Path] = ()
    main: str = ""
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Overlay:
    """A plot of signals of runs, with remarks on what it leaves out."""

    figure: "Figure"
    notes: Sequence[str]


def read_traces(paths: Sequence[Path]) -> list[Traces]:
    """Read runs from output folders or tables. Raise CommandError if one is missing, or for too many."""
    if len(paths) > _MOST_RUNS:
        raise CommandError(f"{len(paths)} runs are too many: a plot shows up to {_MOST_RUNS}.")
    names = [path.resolve().name for path in paths]
    # folders of the same name need their paths
    labels = names if len(set(names)) == len(names) else [str(path) for path in paths]
    return [_read_run(path, label) for path, label in zip(paths, labels, strict=True)]


def plot_signals(
    result: "Result", patterns: Sequence[str], title: str | None = None, layout: str = SCREEN
) -> "Figure":
    """Plot signals of a result, panels by unit. Raise CommandError for unknown or too many signals."""
    if not patterns:
        raise CommandError("nothing to plot; name at least one signal.")
    main = find_main_component(result.record)
    for name in patterns:
        if not find_names(name, result.names, main):
            result.read([name])  # raises an error with a suggestion
    return overlay_runs([_build_traces(result)], patterns, title=title, layout=layout).figure


def plot_summary(result: "Result") -> "Figure":
    """Plot references with the signals that follow them, or else the first signals, in few panels.

    Raises:
        CommandError: If no signal with numbers was recorded.
    """
    run = _build_traces(result)
    names = [name for name in run.names if not run.types.get(name, REAL).is_text]
    selected, _ = _choose_default_signals([run], names, run.units, run.types, _FEW_PANELS)
    return overlay_runs([run], selected, title="").figure


def _build_traces(result: "Result") -> Traces:
    units = {name: str(unit) for name, unit in result.units.items() if unit is not None}
    main = find_main_component(result.record)
    return Traces(result.name, result.names, units, result.types, result, result.roles, main=main)


def overlay_runs(
    runs: Sequence[Traces],
    patterns: Sequence[str] = (),
    begin: float | None = None,
    end: float | None = None,
    title: str | None = None,
    layout: str = SCREEN,
) -> Overlay:
    """Plot the signals that match the patterns: one run by unit, several with a panel per signal.

    Args:
        runs: Runs to plot.
        patterns: Patterns of signals. Default: references and the signals that follow them, or else the
            first signals.
        begin: First time in s.
        end: Last time in s.
        title: Title of the figure. Default: the names of the runs on a screen, none on paper.
        layout: A name of `LAYOUTS`.

    Raises:
        CommandError: If the layout does not exist, a pattern has no match, the signals do not fit in a plot,
            no signal has numbers, or no run has rows between these times.
    """
    check_choice("layout", layout, LAYOUTS)
    if begin is not None and end is not None and not begin < end:
        raise CommandError(f"the plot begins at {begin:g} s, which must be before its end, {end:g} s.")
    names = list(dict.fromkeys(name for run in runs for name in run.names))
    # the first run that has a unit decides
    units = {name: unit for run in reversed(runs) for name, unit in run.units.items()}
    types = {name: kind for run in reversed(runs) for name, kind in run.types.items()}
    texts = [name for name in names if types.get(name, REAL).is_text]
    names, notes = [name for name in names if name not in texts], list[str]()
    if not names:
        raise CommandError(f"there are no numbers to plot in {' and '.join(run.label for run in runs)}.")
    if patterns:
        if (text := next((p for p in patterns if p in texts), None)) is not None:
            raise CommandError(f"'{text}' has texts, which cannot be plotted.", name=text)
        selected = _select_signals(runs, patterns, names, units, types)
    else:
        selected, notes = _choose_default_signals(runs, names, units, types)
    notes += [*(note for run in runs for note in run.notes), *_describe_missing(runs, selected)]
    data = list[Mapping[str, Vector]]()
    for run in runs:
        rows, left_out = _read_rows_between(run, selected, begin, end)
        data.append(rows)
        notes += [f"{run.label}: {left_out}."] if left_out else []
    if not any(len(columns["time"]) for columns in data):
        raise CommandError(
            "there are no rows to plot: the tables are empty, or have none between these times."
        )
    if len(runs) == 1:
        panels = build_unit_panels(selected, units, data[0], runs[0].label, types)
    else:
        panels = [
            panel for name in selected for panel in _build_signal_panels(name, runs, units, types, data)
        ]
    if title is None and layout == SCREEN:
        title = ", ".join(run.label for run in runs)
    return Overlay(draw_stacked(panels, title, LAYOUTS[layout]), notes)


def _select_signals(
    runs: Sequence[Traces],
    patterns: Sequence[str],
    names: Sequence[str],
    units: Mapping[str, str],
    types: Mapping[str, SignalType],
) -> list[str]:
    """Return the signals that match the patterns. Raise CommandError if there are too many for a plot."""
    mains = {run.main for run in runs}
    # names without component are unique only if all runs have the same main component
    selected = select_names(patterns, names, "signal", mains.pop() if len(mains) == 1 else "")
    needed = len(selected) if len(runs) > 1 else count_panels(selected, units, types)
    if needed > MOST_PANELS:
        raise CommandError(
            f"{len(selected)} signals need {needed} panels, but a plot has at most {MOST_PANELS}; name "
            f"fewer, such as '{selected[0]}'."
        )
    return selected


def _read_run(path: Path, label: str) -> Traces:
    stored = open_stored_run(path, "the run")
    record = stored.path.parent / "run.json"
    content = _read_record(record)
    units = stored.units | _read_texts(content, "units")
    connections = filter(lambda text: isinstance(text, str), content.get("connections") or ())
    roles = default_roles(connections) | _read_texts(content.get("settings"), "roles")
    types = stored.types | read_types(content.get(COLUMN_TYPES))
    files = stored.path, record
    main = find_main_component(content)
    return Traces(label, stored.names, units, types, stored, roles, files, main, stored.notes)


def _read_record(path: Path) -> dict[str, Any]:
    """Return the content of run.json, or nothing if it is missing or invalid."""
    try:
        content = json.loads(read_text(path, "the record"))
    except (CommandError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _read_texts(content: Any, key: str) -> dict[str, str]:
    """Return texts by name from a part of a record, or nothing if it has other content."""
    entries = content.get(key) if isinstance(content, dict) else None
    return {n: t for n, t in entries.items() if isinstance(t, str)} if isinstance(entries, dict) else {}


def _choose_default_signals(
    runs: Sequence[Traces],
    names: Sequence[str],
    units: Mapping[str, str],
    types: Mapping[str, SignalType],
    most_panels: int = MOST_PANELS,
) -> tuple[list[str], list[str]]:
    """Return the signals to plot without a pattern, and remarks on those that the panels have no room for."""
    roles = {role: name for run in runs for role, name in run.roles.items()}
    pairs = [pair for find in TRACKED.values() for pair in find(names, roles).values()]
    candidates = list(dict.fromkeys(name for pair in pairs for name in pair)) or list(names)
    is_single = len(runs) == 1
    fitting = (
        select_fitting_signals(candidates, units, types, most_panels)
        if is_single
        else candidates[:most_panels]
    )
    if len(fitting) == len(names):
        return fitting, []
    return fitting, [f"{len(fitting)} of {len(names)} signals are plotted; --signals selects others."]


def _describe_missing(runs: Sequence[Traces], selected: Sequence[str]) -> list[str]:
    """Return remarks on signals that some runs lack."""
    notes = []
    for run in runs:
        run_names = set(run.names)
        if lacking := [name for name in selected if name not in run_names]:
            more = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
            notes.append(f"{run.label} has no {lacking[0]}{more}.")
    return notes


def _read_rows_between(
    run: Traces, selected: Sequence[str], begin: float | None, end: float | None
) -> tuple[dict[str, Vector], str]:
    """Return the run's signals and `time` between two times, and a note on rows that are left out."""
    run_names = set(run.names)
    data, left_out = read_rows(run.table, [name for name in selected if name in run_names])
    time = data["time"]
    inside = (time >= (-np.inf if begin is None else begin)) & (time <= (np.inf if end is None else end))
    return {name: values[inside] for name, values in data.items()}, left_out


def _build_signal_panels(
    name: str,
    runs: Sequence[Traces],
    units: Mapping[str, str],
    types: Mapping[str, SignalType],
    data: Sequence[Mapping[str, Vector]],
) -> list[Plot]:
    """Return the panels of a signal of all runs that have it, one per unit."""
    lines_by_unit: dict[str, list[Line]] = {}
    for i, (run, columns) in enumerate(zip(runs, data, strict=True)):
        if name in columns:
            line = make_numbered_line(i, run.label, columns["time"], columns[name], types.get(name, REAL))
            lines_by_unit.setdefault(run.units.get(name, units.get(name, "")), []).append(line)
    items = name_values(types.get(name, REAL))
    return [Plot(unit, tuple(lines), column=name, items=items) for unit, lines in lines_by_unit.items()]
