"""Draw images/excavator.png, the first picture of the README: three actuators move an excavator's bucket.

The drives have friction, a computing delay, losses when the load drives, and screws of grade 5 of ISO 3408-3.
They have no noise, so each error has a cause that can be seen: the lead of the screw, which the encoder at
the motor does not measure.
"""

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image

import emla_cosim as ec
from emla_cosim.base.colors import RED
from emla_cosim.study.sketch.movement import Movement, list_recorded_signals, read_movement
from emla_cosim.study.sketch.scene import Scene
from emla_cosim.views.plots.style import save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from emla_cosim.base.arrays import Vector

IMAGE = Path(__file__).parent / "images/excavator.png"
SIZE, DPI, COLORS = (9.0, 4.7), 200, 96
"""Size in inches, and number of colours: shown 900 pixels wide, 12 points are 17 pixels."""

DRIVE = {
    "*.plant.friction.F_C": 600.0,
    "*.plant.friction.F_S": 900.0,
    "*.plant.gearbox.directional": True,
    "*.plant.inverter.delay": 1e-4,
    "*.plant.screw.lead_error": 7.67e-5,
    "*.plant.screw.wobble": 4e-6,
}
STOP, STEP, TRANSIENT = 4.0, 0.01, 0.3
"""Time at which the machine turns back, time between rows, and the initial transient of forces and errors,
which is left out, in s."""

VIEW = ((-0.5, 3.2), (-1.05, 1.75))
"""Limits of the drawing of the machine in m, horizontal and vertical."""

LABELS = {"boom": (-0.4, 0.35), "stick": (0.62, 1.5), "bucket": (2.3, 1.1)}
"""Position of each actuator's name in m."""

DARK, SMALL, LARGE, LINE = "#24292f", 11, 13, 2.0


def run() -> Movement:
    """Return the movement of the excavator."""
    with ec.load("excavator").prepare() as simulation:
        result = simulation.run(set=DRIVE, stop_time=STOP, output_interval=STEP)
    assert all(joint["held"] for joint in result.metrics["joints"].values())
    data: dict[str, Any] = {name: result[name] for name in list_recorded_signals(result)}
    movement = read_movement(result, {"time": np.asarray(result.time), **data})
    assert movement is not None
    return movement


def draw_machine(axes: "Axes", movement: Movement, scene: Scene) -> None:
    """Draw the machine at the start, faintly half-way and at the end, with the path of its load."""
    last = len(movement.time) - 1
    rows = [0, last // 2, last]
    without_box = np.zeros(len(rows))
    first, *others = scene.parts.postures(movement.strokes[rows], without_box, movement.passive[rows])
    scene.reach = []  # the picture is of the motion alone
    scene.draw_surroundings(axes, [first, *others])
    for posture in others:
        scene.draw_ghost(axes, posture)
    scene.build_polygons(first).add_to(axes)
    path = scene.view.flatten(movement.path)
    axes.plot(*path.T, color=RED, linewidth=LINE, zorder=5)
    axes.plot(*path[[0, last]].T, "o", color=RED, markersize=6, zorder=6)
    axes.set_axis_off()
    axes.set(xlim=VIEW[0], ylim=VIEW[1])
    assert movement.forces is not None
    late = movement.time >= TRANSIENT
    for name, force in zip(scene.colors, np.abs(movement.forces[late]).max(axis=0), strict=True):
        text = f"{name}\n{1e-3 * force:.0f} kN"
        axes.text(*LABELS[name], text, fontsize=LARGE, color=scene.colors[name], fontweight="bold")
    (x, y), payload = path[0], movement.payload[0]
    axes.text(x + 0.25, y, f"{payload:g} kg", fontsize=LARGE, color=DARK, va="bottom", fontweight="bold")
    axes.text(x + 0.25, y, f"{movement.time[0]:g} s", fontsize=SMALL, color=RED, va="top")
    x, y = path[last]
    axes.text(x + 0.27, y, f"{movement.time[last]:g} s", fontsize=SMALL, color=RED, va="center")


def draw_curves(
    axes: "Axes", time: "Vector", values: "Vector", colors: Mapping[str, str], title: str
) -> None:
    """Draw a curve for each actuator."""
    for color, column in zip(colors.values(), values.T, strict=True):
        axes.plot(time, column, color=color, linewidth=LINE)
    axes.set_title(title, fontsize=LARGE, loc="left", color=DARK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=SMALL)
    axes.grid(alpha=0.25)
    axes.margins(x=0.01)


def draw() -> None:
    """Draw the machine on the left, and strokes and position errors on the right."""
    movement = run()
    scene = Scene(movement.machine)
    figure = Figure(figsize=SIZE, dpi=DPI, layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.3, 1.0))
    draw_machine(figure.add_subplot(grid[:, 0]), movement, scene)
    upper, lower = (figure.add_subplot(grid[row, 1]) for row in range(2))
    assert movement.errors is not None
    draw_curves(upper, movement.time, movement.strokes, scene.colors, "strokes / m")
    late = movement.time >= TRANSIENT
    errors = 1e6 * movement.errors[late]
    draw_curves(lower, movement.time[late], errors, scene.colors, "position errors / µm")
    lower.set(xlim=upper.get_xlim(), ylim=(0.0, None))
    upper.tick_params(labelbottom=False)
    lower.set_xlabel("time / s", fontsize=SMALL)
    stream = BytesIO()
    save(figure, stream)
    picture = Image.open(stream).convert("RGB")
    picture.quantize(COLORS, dither=Image.Dither.NONE).save(IMAGE, optimize=True)


if __name__ == "__main__":
    draw()
