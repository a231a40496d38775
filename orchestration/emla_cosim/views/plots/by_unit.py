"""Plots of systems without metrics: signals by unit, for each part of the system."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from ...base.arrays import Vector
from ...pages.panels import Plot
from .pictures import Drawing
from .stacked import build_unit_panels, draw_stacked, fit_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...run.result import Result

_MOST_PICTURES = 6

_MOST_SIGNALS, _MOST_PANELS = 60, 20
"""Most panels in a plot."""


@dataclass(frozen=True)
class Group:
    """Signals that share a plot."""

    title: str
    signals: Sequence[str]

    def panels(self, result: "Result", data: Mapping[str, Vector]) -> list[Plot]:
        """Return the panels for the signals in `data`."""
        names = [n for n in self.signals if n in data]
        return build_unit_panels(names, _format_units(result), data, self.title, result.types)


@dataclass(frozen=True)
class ByUnit(Drawing):
    """The plot at a position, from 0, among the plots of a system without metrics.

    A small system has one plot. Of a larger one each branch (the name before the first dot) has its own, and
    each component of a large branch. Signals that do not change are left out.
    """

    position: int

    def signals(self, result: "Result") -> Iterable[str]:
        """Return the signals of its group."""
        return (name for group in self._find_group(result) for name in group.signals)

    def drawn(self, result: "Result", data: Mapping[str, Vector]) -> "Figure | None":
        """Draw the panels below each other."""
        for group in self._find_group(result):
            return draw_stacked(group.panels(result, data), group.title)
        return None

    def _find_group(self, result: "Result") -> Sequence[Group]:
        """Return its group, or nothing if there are fewer groups or the system has metrics."""
        # systems with metrics have plots of their own
        has_metrics = any(result.metrics.values())
        return [] if has_metrics else group_signals(result)[self.position : self.position + 1]


BY_UNIT: dict[str, Drawing] = {
    "signals" if i == 0 else f"signals-{i + 1}": ByUnit(i) for i in range(_MOST_PICTURES)
}
"""The plots by file name."""


def group_signals(result: "Result") -> list[Group]:
    """Return the signals of a system without metrics in groups that fit in a plot."""
    units = _format_units(result)
    texts = {name for name, kind in result.types.items() if kind.is_text}
    # constant signals say nothing in a plot
    constant = {name for name, x in result.signals.items() if x["minimum"] == x["maximum"]}
    changing = [name for name in result.names if name not in texts and name not in constant]
    parts = {"": changing}
    # the branches of a large system, then the components of a large branch
    for split in (lambda name: name.partition(".")[0], partial(_find_component, result)):
        split_parts: dict[str, list[str]] = {}
        for title, signals in parts.items():
            for name in signals:
                part = split(name) if len(signals) > _MOST_SIGNALS else title
                split_parts.setdefault(part, []).append(name)
        parts = split_parts
    left_out = len(parts) - _MOST_PICTURES
    groups = list[Group]()
    for part, signals in list(parts.items())[:_MOST_PICTURES]:
        fitting = fit_panels(signals[:_MOST_SIGNALS], units, result.types, _MOST_PANELS)
        counted = f" ({len(fitting)} of {len(signals)} signals)" if len(fitting) < len(signals) else ""
        further = f"; {left_out} more parts are not plotted" if left_out > 0 and not groups else ""
        if fitting:
            groups.append(Group(f"{': '.join(filter(None, (result.name, part)))}{counted}{further}", fitting))
    return groups


def _format_units(result: "Result") -> dict[str, str]:
    return {name: str(unit) for name, unit in result.units.items() if unit is not None}


def _find_component(result: "Result", name: str) -> str:
    """Return the component of a signal, or the name before the last dot if it is unknown."""
    candidates = [c for c in result.record.get("components", ()) if name.startswith(f"{c}.")]
    return max(candidates, key=len) if candidates else name.rpartition(".")[0]
