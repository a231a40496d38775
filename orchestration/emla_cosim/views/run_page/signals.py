"""All signals of a run: their metrics, and curves to select."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...base.arrays import Vector
from ...base.signal_types import REAL, SignalType
from ...recorders.signal_figures import NAMES
from ...run.result import Result
from ..pages.curve_data import build_small_curve, condense_curve, mask_undrawable
from ..pages.page import Plots
from ..pages.plot_data import Shape, describe_items
from ..pages.text import make_visible, shorten_text
from ..panels import make_steps
from ..plots.stacked import name_values

MOST = 1000
"""Most signals of a page."""

_POINTS, _MOST_POINTS = 150_000, 5000
"""Most points of all curves together, of about 11 bytes each, and of one curve."""

_LINES = 6
"""Most lines in a plot, which is its number of colours."""


@dataclass(frozen=True)
class SignalRow:
    """A signal with its metrics; missing ones are None."""

    name: str
    unit: str
    minimum: float | None
    maximum: float | None
    rms: float | None
    final: float | None


def list_signal_rows(result: Result, data: Mapping[str, Vector], plots: Plots) -> list[SignalRow]:
    """Return the first signals in `data`, and add their curves to the page."""
    names = [name for name in data if name != "time"][:MOST]
    units = {name: str(result.units.get(name) or "") for name in names}
    plots.hold("signals-data", _curves(data, units, result.types), [Shape(n) for n in range(1, _LINES + 1)])
    return [SignalRow(name, units[name], **_figures(result.signals.get(name, {}))) for name in names]


def _curves(data: Mapping[str, Vector], units: Mapping[str, str], types: Mapping[str, SignalType]) -> str:
    time, kinds = data["time"], {name: types.get(name, REAL) for name in units}
    lines = [make_steps(time, data[n]) if kinds[n].is_discrete else (time, data[n]) for n in units]
    curves = _small([(at, mask_undrawable(values)) for at, values in lines]) if len(time) else []
    units = {name: unit or describe_items(name_values(kinds[name])) for name, unit in units.items()}
    return json.dumps(
        [
            {"label": make_visible(name), "unit": shorten_text(make_visible(unit), 40), **curve}
            for (name, unit), curve in zip(units.items(), curves, strict=bool(curves))
        ],
        separators=(",", ":"),
        allow_nan=False,
    )


def _small(curves: Sequence[tuple[Vector, Vector]]) -> list[dict[str, Any]]:
    """Reduce curves to the points that there is room for. Smooth curves leave room for the others."""
    fair = _POINTS // (2 * len(curves))
    kept = [condense_curve(time, curve, fair) for time, curve in curves]
    used = sum(map(len, kept))
    rough = [k for k, found in enumerate(kept) if len(found) >= fair]
    for k in rough:
        kept[k] = condense_curve(*curves[k], min(fair + (_POINTS - used) // len(rough), _MOST_POINTS))
    return [build_small_curve(*curve, found) for curve, found in zip(curves, kept, strict=True)]


def _figures(figures: Mapping[str, float]) -> dict[str, float | None]:
    """Return the metrics of a signal; those that are no numbers are None."""
    return {name: value if math.isfinite(value := figures.get(name, math.nan)) else None for name in NAMES}
