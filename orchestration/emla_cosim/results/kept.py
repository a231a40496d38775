"""Runs that were kept in folders, or as tables of any tool: their signals, and what is known of them."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Vector
from ..errors import CommandError
from ..files import read_text
from ..master.stepping.timing import Timing
from ..recorders.metrics import TRACKED
from ..recorders.recorder import Outline
from ..recorders.stored import StoredRun, stored_run
from ..recorders.time_series import TimeSeries
from ..report.text import shortened, visible
from .result import Result

_LONGEST = 60
"""Letters of what a run is called in a legend."""


@dataclass(frozen=True)
class Window:
    """The part of a run from a time to another one, in s."""

    start: float
    end: float

    def of(self, time: Vector) -> np.ndarray:
        """Which of these times are in it."""
        return np.isfinite(time) & (time >= self.start) & (time <= self.end)


EVERYTHING = Window(-np.inf, np.inf)


@dataclass(frozen=True)
class KeptRun:
    """A run as it was kept; `record` is its run.json, empty where there is none that can be understood."""

    label: str
    stored: StoredRun
    record: Mapping[str, Any]

    @property
    def names(self) -> Sequence[str]:
        """Its signals."""
        return self.stored.names

    def unit(self, name: str) -> str:
        """The unit of a signal; empty where nobody knows it."""
        units = self.record.get("units")
        found = units.get(name) if isinstance(units, Mapping) else None
        return visible(found) if isinstance(found, str) else ""

    def read(self, names: Collection[str], window: Window) -> dict[str, Vector]:
        """`time` and those of the signals that it has, within a window. Raises CommandError."""
        known = set(self.names)
        found = self.stored.read(["time", *(n for n in dict.fromkeys(names) if n in known)])
        part = window.of(found["time"])
        return {name: values[part] for name, values in found.items()}

    def result(self) -> Result:
        """What is known of how it went, without its values; its figures have names only."""
        table = TimeSeries()
        times = Timing(0.0, 1.0, 0)
        table.begin(Outline(self.names, [None] * len(self.names), times, range(len(self.names))))
        return Result(
            name=self.label,
            units={},
            times=times,
            table=table,
            metrics={kind: {of: {} for of in found(self.names)} for kind, found in TRACKED.items()},
            shown={},
            remarks=(),
            steps=0,
            simulated_s=0.0,
            end_s=0.0,
            wall_s=0.0,
            stepping={},
            pacing=None,
            problem=None,
            interrupted=False,
            record=self.record,
            parameters=_parameters(self.record),
        )


def kept_runs(places: Sequence[Path]) -> list[KeptRun]:
    """The runs in folders of results, or in tables; CommandError where there is none."""
    chosen = list(dict.fromkeys(places))
    stored = [stored_run(place, "the run") for place in chosen]
    short = [_name(run.path) for run in stored]
    labels = short if len(set(short)) == len(short) else [str(p) for p in chosen]
    return [
        KeptRun(shortened(visible(label).replace("\n", " "), _LONGEST), run, _record(run.path))
        for label, run in zip(labels, stored, strict=True)
    ]


def _name(table: Path) -> str:
    """What a table is called: after its folder, if that is one of results."""
    return table.resolve().parent.name if table.stem == "results" else table.name


def _record(table: Path) -> Mapping[str, Any]:
    """The run.json beside a table, if it is one of ours."""
    place = table.parent / "run.json"
    if table.stem != "results" or not place.is_file():
        return {}
    try:
        found = json.loads(read_text(place, "the record"))
    except (CommandError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _parameters(record: Mapping[str, Any]) -> dict[str, float]:
    """The values of all parameters that are numbers, by full name."""
    components = record.get("components")
    found = {}
    for component, told in components.items() if isinstance(components, dict) else ():
        values = told.get("parameters") if isinstance(told, dict) else None
        for name, value in values.items() if isinstance(values, dict) else ():
            if isinstance(value, float):
                found[f"{component}.{name}"] = value
    return found
