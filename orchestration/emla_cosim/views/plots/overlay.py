"""Any signals of runs, one or several over one another, whether they just ran or were kept in folders."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, suggest_names
from ...base.files import read_text
from ...base.patterns import matches_pattern
from ...recorders.metrics import TRACKED
from ...recorders.stored import StoredRun, open_stored_run
from ..panels import Line, Plot
from .stacked import MOST_LINES, MOST_PANELS, build_unit_panels, count_panels, draw_stacked, numbered

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...run.result import Result

_MOST_ROWS = 200_000
"""Of longer tables only every n-th row is read."""

_MOST_RUNS = 2 * MOST_LINES
"""So many runs can be told apart by colour and dashes."""


class _Table(Protocol):
    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]: ...


@dataclass(frozen=True)
class Traces:
    """The signals of a run by name, with their units as far as they are known, and the roles they play.

    `label` is what pictures call it; `files` are those it was read from.
    """

    label: str
    names: Sequence[str]
    units: Mapping[str, str]
    table: _Table
    roles: Mapping[str, str]
    files: Sequence[Path] = ()


@dataclass(frozen=True)
class Overlay:
    """A picture of signals of runs, with sentences on what it does not show."""

    figure: "Figure"
    notes: Sequence[str]


def read_traces(places: Sequence[Path]) -> list[Traces]:
    """The runs in folders of results, or in tables; CommandError where there is none, or too many."""
    if len(places) > _MOST_RUNS:
        raise CommandError(f"{len(places)} runs cannot be told apart; a picture shows up to {_MOST_RUNS}.")
    names = [place.resolve().name for place in places]
    labels = names if len(set(names)) == len(names) else [str(place) for place in places]
    return [_read_trace(place, label) for place, label in zip(places, labels, strict=True)]


def plot_signals(result: "Result", patterns: Sequence[str]) -> "Figure":
    """Signals of a result over time, panels by unit; CommandError for what is not there, and for too many."""
    if not patterns:
        raise CommandError("nothing to plot; name one signal or more.")
    for name in patterns:
        if not any(matches_pattern(n, name) for n in result.names):
            result.read([name])  # which says what is wrong
    units = {name: str(unit) for name, unit in result.units.items() if unit is not None}
    run = Traces(result.name, result.names, units, result, result.roles)
    return overlay_runs([run], patterns).figure


def overlay_runs(
    runs: Sequence[Traces],
    patterns: Sequence[str] = (),
    begin: float | None = None,
    end: float | None = None,
) -> Overlay:
    """Draw the signals that the patterns mean; of several runs each signal has a panel, with a line per run.

    Without patterns, those that are followed and what they follow, or the first that there is room for.
    Only times from `begin` to `end` in s are shown. Raises CommandError for a pattern that finds nothing,
    for more signals than a picture has room for, and for times at which there is nothing.
    """
    if begin is not None and end is not None and not begin < end:
        raise CommandError(f"the picture begins at {begin:g} s, which must be before its end, {end:g} s.")
    names = list(dict.fromkeys(name for run in runs for name in run.names))
    units = {name: unit for run in reversed(runs) for name, unit in run.units.items()}
    notes = list[str]()
    if patterns:
        chosen = _matching(patterns, names)
        _check_room(chosen, units, len(runs))
    else:
        chosen, notes = _choose_default_signals(runs, names, units)
    notes += _describe_missing(runs, chosen)
    data = [_cut(run, chosen, begin, end) for run in runs]
    if not any(len(columns["time"]) for columns in data):
        raise CommandError("there are no rows to draw at these times.")
    if len(runs) == 1:
        panels = build_unit_panels(chosen, units, data[0], runs[0].label)
    else:
        panels = [panel for name in chosen for panel in _overlay_signal(name, runs, units, data)]
    return Overlay(draw_stacked(panels, ", ".join(run.label for run in runs)), notes)


def _read_trace(place: Path, label: str) -> Traces:
    stored: StoredRun = open_stored_run(place, "the run")
    record = stored.path.parent / "run.json"
    content = _record(record)
    units, roles = _texts(content, "units"), _texts(content.get("settings"), "roles")
    return Traces(label, stored.names, units, stored, roles, (stored.path, record))


def _record(path: Path) -> dict[str, Any]:
    """What run.json holds; nothing where it is not there or cannot be understood."""
    try:
        found = json.loads(read_text(path, "the record"))
    except (CommandError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _texts(content: Any, key: str) -> dict[str, str]:
    """Texts by name in a part of a record; none where it holds something else."""
    found = content.get(key) if isinstance(content, dict) else None
    return {n: t for n, t in found.items() if isinstance(t, str)} if isinstance(found, dict) else {}


def _matching(patterns: Iterable[str], names: Sequence[str]) -> list[str]:
    found = list[str]()
    for pattern in patterns:
        matching = [name for name in names if matches_pattern(name, pattern)]
        if not matching:
            raise CommandError(
                f"no signal is called '{pattern}'; {suggest_names(pattern, names)}", name=pattern
            )
        found += matching
    return list(dict.fromkeys(found))


def _check_room(chosen: Sequence[str], units: Mapping[str, str], runs: int) -> None:
    needed = len(chosen) if runs > 1 else count_panels(chosen, units)
    if needed > MOST_PANELS:
        raise CommandError(
            f"{len(chosen)} signals take {needed} panels, and a picture has up to {MOST_PANELS}; name fewer, "
            f"such as '{chosen[0]}'."
        )


def _choose_default_signals(
    runs: Sequence[Traces], names: Sequence[str], units: Mapping[str, str]
) -> tuple[list[str], list[str]]:
    """What is drawn where nobody says it, and a sentence where it is not all."""
    roles = {role: name for run in runs for role, name in run.roles.items()}
    found = [pair for find in TRACKED.values() for pair in find(names, roles).values()]
    chosen = list(dict.fromkeys(name for pair in found for name in pair)) or list(names)
    kept = list[str]()
    for name in chosen:
        if (len(kept) < MOST_PANELS) if len(runs) > 1 else count_panels([*kept, name], units) <= MOST_PANELS:
            kept.append(name)
    if len(kept) == len(names):
        return kept, []
    return kept, [f"{len(kept)} of {len(names)} signals are drawn; --signals chooses others."]


def _describe_missing(runs: Sequence[Traces], chosen: Sequence[str]) -> list[str]:
    """Sentences on the signals that not every run has."""
    notes = []
    for run in runs:
        there = set(run.names)
        if lacking := [name for name in chosen if name not in there]:
            more = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
            notes.append(f"{run.label} has no {lacking[0]}{more}.")
    return notes


def _cut(run: Traces, chosen: Sequence[str], begin: float | None, end: float | None) -> dict[str, Vector]:
    """Those of the signals that the run has, and time, between two times."""
    there = set(run.names)
    data = run.table.read(["time", *(name for name in chosen if name in there)], _MOST_ROWS)
    time = data["time"]
    inside = np.ones(len(time), dtype=bool)
    if begin is not None:
        inside &= time >= begin
    if end is not None:
        inside &= time <= end
    return {name: values[inside] for name, values in data.items()}


def _overlay_signal(
    name: str, runs: Sequence[Traces], units: Mapping[str, str], data: Sequence[Mapping[str, Vector]]
) -> list[Plot]:
    """A signal of all runs that have it, each with times of its own; of those with another unit apart."""
    found: dict[str, list[Line]] = {}
    for i, (run, columns) in enumerate(zip(runs, data, strict=True)):
        if name in columns:
            line = numbered(i, run.label, columns["time"], columns[name])
            found.setdefault(run.units.get(name, units.get(name, "")), []).append(line)
    return [Plot(unit, tuple(lines), column=name) for unit, lines in found.items()]
