"""Draw signals over time in stacked panels: by unit, by part of the system, or several runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...base.arrays import REAL, SignalType, Vector
from ...base.extras import require_extra
from ...pages.panels import Line, Plot
from .panel_drawing import draw_line
from .style import COLORS, add_legend, count_legend_columns, new_figure, tidy_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING

from .pictures import Drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...run.result import Result


@dataclass(frozen=True)
class Layout:
    """Size of a figure: its `width` and the `height` of a panel in inches, and of its `text` in points.

    Its legends are beside the panels, or `above` them in as many columns as fit.
    """

    width: float
    height: float
    text: float
    above: bool = False


SCREEN = "screen"
LAYOUTS = {
    SCREEN: Layout(8.7, 2.1, 10.0),
    "one-column": Layout(3.46, 1.4, 8.0, above=True),
    "two-columns": Layout(7.13, 1.4, 8.0, above=True),
}
"""Layouts of figures by name: for screens, and for papers of one and two columns of 88 mm."""

MOST_LINES = len(COLORS)
"""Most signals in a panel, each with its own colour."""

MOST_PANELS = 24
"""Most panels in a plot."""

_TALLEST = 8
"""Most panels in a column."""

_MOST_ITEMS = 12
"""Most named values on an axis."""

_LONGEST = 44
"""Most letters of a name to show."""


_BESIDE_LEGEND = 1.0
"""Width of a figure in inches that a legend above its panels cannot use."""

_LEGEND_LINE = 0.17
"""Height of a line of a legend in inches."""

_BOOLEANS = {0: "false", 1: "true"}


def name_values(kind: SignalType) -> Mapping[int, str]:
    """Return the names of the values of a type, for an axis."""
    return _BOOLEANS if kind.kind == "Boolean" else kind.items


def build_unit_panels(
    names: Sequence[str],
    units: Mapping[str, str],
    data: Mapping[str, Vector],
    column: str,
    types: Mapping[str, SignalType],
) -> list[Plot]:
    """Return panels of signals by unit and names of values, in order of first appearance.

    `data` also has `time`.
    """
    return [
        Plot(
            units.get(group[0], ""),
            tuple(
                make_numbered_line(i, n, data["time"], data[n], types.get(n, REAL))
                for i, n in enumerate(group[first : first + MOST_LINES])
            ),
            column=column,
            items=name_values(types.get(group[0], REAL)),
        )
        for group in group_by_unit(names, units, types)
        for first in range(0, len(group), MOST_LINES)
    ]


def count_panels(names: Sequence[str], units: Mapping[str, str], types: Mapping[str, SignalType]) -> int:
    """Return the number of panels that `build_unit_panels` makes."""
    return sum(-(-len(group) // MOST_LINES) for group in group_by_unit(names, units, types))


def select_fitting_signals(
    names: Sequence[str], units: Mapping[str, str], types: Mapping[str, SignalType], most: int
) -> list[str]:
    """Return the signals that fit in so many panels; earlier signals take precedence."""
    fitting = list[str]()
    for name in names:
        if count_panels([*fitting, name], units, types) <= most:
            fitting.append(name)
    return fitting


def group_by_unit(
    names: Sequence[str], units: Mapping[str, str], types: Mapping[str, SignalType]
) -> list[list[str]]:
    """Return signals that share an axis: the same unit, and the same names of values."""
    groups: dict[tuple[Any, ...], list[str]] = {}
    for name in names:
        items = name_values(types.get(name, REAL))
        groups.setdefault((units.get(name, ""), *items.items()), []).append(name)
    return list(groups.values())


def make_numbered_line(
    number: int, label: str, time: Vector, values: Vector, kind: SignalType = REAL
) -> Line:
    """Return a line with the style for its number: colours first, then dashes. Discrete values make steps."""
    # after all colours once, dashes distinguish the same colours
    dashed = number // len(COLORS) % 2 == 1
    return Line(label, time, values, COLORS[number % len(COLORS)], dashed, kind.is_discrete)


def draw_stacked(panels: Sequence[Plot], title: str | None, layout: Layout = LAYOUTS[SCREEN]) -> "Figure":
    """Draw panels below each other, on a screen in two columns if there are many.

    If they have different subjects, each panel has its own title.
    """
    require_extra("plots", "a picture")
    from matplotlib import rc_context

    columns = 2 if len(panels) > _TALLEST and not layout.above else 1
    is_titled = len({panel.column for panel in panels}) > 1
    height = layout.height + max((_measure_legend(panel, layout, is_titled) for panel in panels), default=0.0)
    # papers need smaller letters than screens
    with rc_context({"font.size": layout.text, "axes.labelsize": layout.text}):
        figure, grid = new_figure(-(-len(panels) // columns), columns, layout.width - 1.2, height)
        axes = list(grid.flat)
        for cell_axes, panel in zip(axes, panels, strict=False):
            _draw_panel(cell_axes, panel, is_titled, layout)
        for cell_axes in axes[len(panels) :]:
            cell_axes.set_visible(False)
        for cell_axes in axes[max(len(panels) - columns, 0) : len(panels)]:
            cell_axes.tick_params(labelbottom=True)
            cell_axes.set_xlabel("time / s")
        if title:
            size = 1.2 * layout.text
            figure.suptitle(title, fontsize=size, fontweight="bold", parse_math=False)
    return figure


def shorten_name(name: str) -> str:
    """Shorten a long name in the middle, because its ends distinguish it."""
    if len(name) <= _LONGEST:
        return name
    return f"{name[: _LONGEST // 2 - 2]}...{name[-(_LONGEST // 2 - 1) :]}"


def _measure_legend(panel: Plot, layout: Layout, is_titled: bool) -> float:
    """Return the height in inches that legends above panels need beyond two lines."""
    if not layout.above or not panel.lines:
        return 0.0
    labels = [shorten_name(line.label) for line in panel.lines]
    lines = -(-len(labels) // count_legend_columns(labels, layout.width - _BESIDE_LEGEND)) + is_titled
    return _LEGEND_LINE * max(lines - 2, 0)


def _draw_panel(axes: "Axes", panel: Plot, titled: bool, layout: Layout) -> None:
    """Draw the lines of a panel with its labels and legend."""
    entries = [(shorten_name(line.label), draw_line(axes, line)) for line in panel.lines]
    axes.set_ylabel(panel.label, parse_math=False)
    if 0 < len(panel.items) <= _MOST_ITEMS:
        axes.set_yticks(list(panel.items), [shorten_name(name) for name in panel.items.values()])
        for label in axes.get_yticklabels():
            label.set_parse_math(False)
    title = shorten_name(panel.column) if titled else ""
    if not layout.above:
        axes.set_title(title, fontsize=9, loc="left", parse_math=False)
    tidy_axes(axes)
    if layout.above:
        add_legend(axes, entries, layout.width - _BESIDE_LEGEND, title)
    else:
        add_legend(axes, entries)


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
        """Draw the panels of its group below each other; None without a group."""
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
        fitting = select_fitting_signals(signals[:_MOST_SIGNALS], units, result.types, _MOST_PANELS)
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
