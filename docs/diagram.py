"""Draw images/study_diagram.png: a joint of the study, from the coordinates that `emla export` writes."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from emla_cosim.ssp.documents.ssd_data import Connector, Element, SsdConnection, SystemElement
from emla_cosim.ssp.documents.ssd_reader import parse_structure
from emla_cosim.ssp.reader.structure_loader import open_package
from emla_cosim.study.loading import load

HERE = Path(__file__).parent
JOINT = "lift"
COLORS = {
    "reference": "#4a9c6d",
    "disturbance": "#8a6bbf",
    "controller": "#d9822b",
    "plant": "#2f6db3",
    "observer": "#c2476b",
}
"""A colour for each component and the lines that leave it."""

Point = tuple[float, float]


def exported(scenario: str) -> SystemElement:
    """Return the root system of the package that `emla export SCENARIO` writes."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / f"{scenario}.ssp"
        load(scenario).export(package, fmus=Path(folder))
        with open_package(package) as content:
            return parse_structure(content.ssd.read_bytes(), package.name).system


def place(element: Element, connector: Connector) -> Point:
    """Return where a connector is drawn."""
    if element.extent is None or connector.position is None:
        raise ValueError(f"{element.name}.{connector.name} has no coordinates")
    x1, y1, x2, y2 = element.extent
    return x1 + connector.position[0] * (x2 - x1), y1 + connector.position[1] * (y2 - y1)


def end(system: SystemElement, element: str | None, connector: str) -> Point:
    """Return where a connection begins or ends."""
    owner = next(e for e in system.elements if e.name == element)
    return place(owner, next(c for c in owner.connectors if c.name == connector))


def line(system: SystemElement, connection: SsdConnection) -> list[Point]:
    """Return the corners of a connection from its source to its target."""
    start = end(system, connection.start_element, connection.start_connector)
    target = end(system, connection.end_element, connection.end_connector)
    return [start, *connection.waypoints, target]


def leaving(system: SystemElement, element: Element) -> list[SsdConnection]:
    """Return the connections that begin at an element."""
    return [c for c in system.connections if c.start_element == element.name]


def role(name: str) -> str:
    """Return the component of a joint that an element represents."""
    return name.removeprefix(f"{JOINT}_")


def draw_element(axes: Axes, element: Element) -> None:
    """Draw a box with its name and its connectors."""
    if element.extent is None:
        return
    x1, y1, x2, y2 = element.extent
    color = COLORS[role(element.name)]
    axes.add_patch(
        FancyBboxPatch(
            (x1, y1),
            x2 - x1,
            y2 - y1,
            boxstyle="round,pad=0,rounding_size=1.5",
            facecolor="white",
            edgecolor=color,
            linewidth=1.6,
            zorder=3,
        )
    )
    axes.text((x1 + x2) / 2, y2 + 1.8, element.name, color=color, ha="center", fontsize=10, weight="bold")
    for connector in element.connectors:
        x, y = place(element, connector)
        if connector.kind == "input":
            axes.text(x + 2.4, y, connector.name, va="center", fontsize=7.5, zorder=4)
        else:
            unit = f" [{connector.unit}]" if connector.unit is not None else ""
            axes.text(x - 1.2, y, f"{connector.name}{unit}", ha="right", va="center", fontsize=7.5, zorder=4)


def draw_lines(axes: Axes, source: str, lines: Sequence[Sequence[Point]]) -> None:
    """Draw the connections that leave a component; earlier ones pass beneath."""
    for width, color in ((4.5, "white"), (1.4, COLORS[source])):
        for points in lines:
            axes.plot(*zip(*points, strict=True), color=color, linewidth=width, solid_joinstyle="round")
    for points in lines:
        x, y = points[-1]
        axes.plot(x + 0.6, y, ">", color=COLORS[source], markersize=5, zorder=4)


def draw(system: SystemElement, path: Path) -> None:
    """Draw one joint of the system."""
    elements = [e for e in system.elements if e.name.startswith(f"{JOINT}_")]
    lines = {role(e.name): [line(system, c) for c in leaving(system, e)] for e in elements}
    corners = [p for group in lines.values() for points in group for p in points]
    corners += [p for e in elements if e.extent for p in (e.extent[:2], e.extent[2:])]
    x, y = zip(*corners, strict=True)
    width, height = max(x) - min(x) + 8, max(y) - min(y) + 14
    figure = Figure(figsize=(10.4, 10.4 * height / width), dpi=120)
    axes = figure.add_axes((0, 0, 1, 1))
    for source, group in lines.items():
        draw_lines(axes, source, group)
    for element in elements:
        draw_element(axes, element)
    axes.set_xlim(min(x) - 4, max(x) + 4)
    axes.set_ylim(min(y) - 4, max(y) + 10)
    axes.set_aspect("equal")
    axes.axis("off")
    FigureCanvasAgg(figure).print_png(path)


if __name__ == "__main__":
    draw(exported("study"), HERE / "images" / "study_diagram.png")
