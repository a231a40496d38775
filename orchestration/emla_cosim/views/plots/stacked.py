"""Signals over time in panels that stand one below the other: by unit, or runs over one another."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ...base.arrays import Vector
from ..pages.curves import drawable, thinned
from .panels import ShownLine, ShownPanel
from .style import COLORS, new_figure, tidied

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_LINES = len(COLORS)
"""So many signals share a panel, each in a colour of its own."""

MOST_PANELS = 24
"""So many panels stand in a picture."""

_TALLEST = 8
"""So many panels stand below one another."""

_LONGEST = 44
"""Letters of a name that are shown."""


def unit_panels(
    names: Sequence[str], units: Mapping[str, str], data: Mapping[str, Vector], column: str
) -> list[ShownPanel]:
    """Panels of signals by their unit, in the order of the first one with it; `data` has `time` too."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(units.get(name, ""), []).append(name)
    return [
        panel(column, unit, data["time"], {name: data[name] for name in group[i : i + MOST_LINES]})
        for unit, group in groups.items()
        for i in range(0, len(group), MOST_LINES)
    ]


def panels_needed(names: Sequence[str], units: Mapping[str, str]) -> int:
    """How many panels `unit_panels` makes."""
    count: dict[str, int] = {}
    for name in names:
        unit = units.get(name, "")
        count[unit] = count.get(unit, 0) + 1
    return sum(-(-number // MOST_LINES) for number in count.values())


def panel(column: str, unit: str, time: Vector, values: Mapping[str, Vector], first: int = 0) -> ShownPanel:
    """A panel of lines by their labels, thinned; colours begin with the one at `first`."""
    drawn = {label: drawable(each) for label, each in values.items()}
    rows = thinned(*drawn.values()) if len(time) else slice(None)
    lines = (
        ShownLine(label, each[rows], COLORS[i % len(COLORS)], dashed=i // len(COLORS) % 2 == 1)
        for i, (label, each) in enumerate(drawn.items(), first)
    )
    return ShownPanel(column, unit, time[rows], tuple(lines))


def stacked(rows: Sequence[Sequence[ShownPanel]], title: str) -> "Figure":
    """A picture with axes for each row, on which all panels of the row are drawn; many stand in two columns.

    Where rows are of different things, each has its own as a title.
    """
    columns = 2 if len(rows) > _TALLEST else 1
    figure, grid = new_figure(-(-len(rows) // columns), columns, 7.5)
    axes, of = list(grid.flat), {row[0].column for row in rows}
    for place, row in zip(axes, rows, strict=False):
        _draw(place, row, titled=len(of) > 1)
    for place in axes[len(rows) :]:
        place.set_visible(False)
    for place in axes[max(len(rows) - columns, 0) : len(rows)]:
        place.tick_params(labelbottom=True)
        place.set_xlabel("time / s")
    figure.suptitle(title, fontsize=12, fontweight="bold", parse_math=False)
    return figure


def shortened(name: str) -> str:
    """A name whose middle is left out where it is long; its ends tell names apart."""
    if len(name) <= _LONGEST:
        return name
    return f"{name[: _LONGEST // 2 - 2]}...{name[-(_LONGEST // 2 - 1) :]}"


def _draw(axes: "Axes", row: Sequence[ShownPanel], titled: bool) -> None:
    labels = []
    for shown in row:
        for line in shown.lines:
            dashes = (0, (4, 2)) if line.dashed else "-"
            axes.plot(
                shown.time, line.values, color=line.color, linestyle=dashes, linewidth=1.1, label=line.label
            )
            labels.append(shortened(line.label))
    axes.set_ylabel(row[0].label, parse_math=False)
    if titled:
        axes.set_title(shortened(row[0].column), fontsize=9, loc="left", parse_math=False)
    tidied(axes, labels)
    if (legend := axes.get_legend()) is not None:
        legend.set_loc("center left")
        legend.set_bbox_to_anchor((1.0, 0.5))  # beside the curves, which it would hide
