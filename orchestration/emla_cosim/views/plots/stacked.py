"""Draw signals over time in stacked panels: by unit, or several runs overlaid."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ...base.arrays import Vector
from ..panels import Line, Plot
from .panel_drawing import draw_line
from .style import COLORS, new_figure, tidy_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_LINES = len(COLORS)
"""Most signals in a panel, each with its own colour."""

MOST_PANELS = 24
"""Most panels in a plot."""

_TALLEST = 8
"""Most panels in a column."""

_LONGEST = 44
"""Most letters of a name to show."""


def build_unit_panels(
    names: Sequence[str], units: Mapping[str, str], data: Mapping[str, Vector], column: str
) -> list[Plot]:
    """Return panels of signals by unit, in order of first appearance. `data` also has `time`."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(units.get(name, ""), []).append(name)
    return [
        Plot(unit, tuple(numbered(i, n, data["time"], data[n]) for i, n in enumerate(part)), column=column)
        for unit, group in groups.items()
        for part in (group[i : i + MOST_LINES] for i in range(0, len(group), MOST_LINES))
    ]


def count_panels(names: Sequence[str], units: Mapping[str, str]) -> int:
    """Return the number of panels that `build_unit_panels` makes."""
    count: dict[str, int] = {}
    for name in names:
        unit = units.get(name, "")
        count[unit] = count.get(unit, 0) + 1
    return sum(-(-number // MOST_LINES) for number in count.values())


def numbered(number: int, label: str, time: Vector, values: Vector) -> Line:
    """Return a line with the style for its number: colours first, then dashes."""
    dashed = number // len(COLORS) % 2 == 1
    return Line(label, time, values, COLORS[number % len(COLORS)], dashed)


def draw_stacked(panels: Sequence[Plot], title: str) -> "Figure":
    """Draw panels below each other, in two columns if there are many.

    If they have different subjects, each panel has its own title.
    """
    columns = 2 if len(panels) > _TALLEST else 1
    figure, grid = new_figure(-(-len(panels) // columns), columns, 7.5)
    axes, of = list(grid.flat), {panel.column for panel in panels}
    for place, panel in zip(axes, panels, strict=False):
        _draw(place, panel, titled=len(of) > 1)
    for place in axes[len(panels) :]:
        place.set_visible(False)
    for place in axes[max(len(panels) - columns, 0) : len(panels)]:
        place.tick_params(labelbottom=True)
        place.set_xlabel("time / s")
    figure.suptitle(title, fontsize=12, fontweight="bold", parse_math=False)
    return figure


def shorten_name(name: str) -> str:
    """Shorten a long name in the middle, because its ends distinguish it."""
    if len(name) <= _LONGEST:
        return name
    return f"{name[: _LONGEST // 2 - 2]}...{name[-(_LONGEST // 2 - 1) :]}"


def _draw(axes: "Axes", panel: Plot, titled: bool) -> None:
    for line in panel.lines:
        draw_line(axes, line)
    axes.set_ylabel(panel.label, parse_math=False)
    if titled:
        axes.set_title(shorten_name(panel.column), fontsize=9, loc="left", parse_math=False)
    tidy_axes(axes, [shorten_name(line.label) for line in panel.lines])
    if (legend := axes.get_legend()) is not None:
        legend.set_loc("center left")
        legend.set_bbox_to_anchor((1.0, 0.5))  # beside the curves, which it would hide
