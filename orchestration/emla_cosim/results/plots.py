"""Pictures of a run, made from its results.csv."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..master.slaves.slave import Vector
from .csv_file import read_results

_BLUE, _ORANGE, _GREY = "#2f6db3", "#d9822b", "#7a7a7a"
_MOST_ROWS = 20_000
"""Of longer results only every n-th row is drawn; a panel is a few hundred pixels wide."""

_TRANSIENT = 0.3
"""Time in s after which errors are small enough to show on a scale of their own."""


@dataclass(frozen=True)
class Curve:
    """One line of a panel: what it shows and how; `less` is subtracted, `scale` multiplied."""

    label: str
    signal: str
    color: str = _BLUE
    less: str | None = None
    scale: float = 1.0
    dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """One row of axes: the same curves for every joint. `late` leaves the initial transient out."""

    label: str
    curves: tuple[Curve, ...]
    late: bool = False


FIGURES: dict[str, tuple[str, tuple[Panel, ...]]] = {
    "tracking": (
        "Tracking",
        (
            Panel(
                "position / m",
                (Curve("reference", "reference.x_d", _ORANGE, dashed=True), Curve("screw", "plant.x_L")),
            ),
            Panel(
                "speed / (m/s)",
                (Curve("screw", "plant.v_L"), Curve("reference", "reference.v_d", _ORANGE, dashed=True)),
            ),
        ),
    ),
    "errors": (
        "Tracking errors",
        (
            Panel("position / mm", (Curve("", "plant.x_L", less="reference.x_d", scale=1e3),)),
            Panel("position / µm, settled", (Curve("", "plant.x_L", less="reference.x_d", scale=1e6),), True),
            Panel(
                "speed / (mm/s), settled", (Curve("", "plant.v_L", less="reference.v_d", scale=1e3),), True
            ),
        ),
    ),
    "currents": (
        "Motor currents",
        (
            Panel(
                "q axis / A",
                (
                    Curve("actual", "plant.i_q"),
                    Curve("commanded", "controller.i_q_ref", _ORANGE, dashed=True),
                ),
            ),
            Panel("d axis / A", (Curve("actual", "plant.i_d"),)),
        ),
    ),
    "voltages": (
        "Motor voltages after the inverter's limit",
        (
            Panel("q axis / V", (Curve("", "plant.inverter.u_q"),)),
            Panel("d axis / V", (Curve("", "plant.inverter.u_d"),)),
        ),
    ),
    "torque": (
        "Motor torque and load",
        (
            Panel("motor torque / (N m)", (Curve("", "plant.tau_m"),)),
            Panel("load force / kN", (Curve("", "disturbance.F_L", _GREY, scale=1e-3),)),
        ),
    ),
    "observer": (
        "Observer errors",
        (
            Panel("position / µm", (Curve("", "observer.x_hat", less="plant.x_L", scale=1e6),)),
            Panel("speed / (mm/s)", (Curve("", "observer.v_hat", less="plant.v_L", scale=1e3),)),
        ),
    ),
}
"""Title and panels of each picture by file name."""


def plot_run(results: Path, joints: Sequence[str], folder: Path, done: Callable[[str], None]) -> list[Path]:
    """Draw all pictures that the results have signals for; returns the files written.

    `done` is called with the name of each. Raises OSError.
    """
    signals = {
        s for _, panels in FIGURES.values() for p in panels for c in p.curves for s in (c.signal, c.less) if s
    }
    names = [f"{joint}.{signal}" for joint in joints for signal in sorted(signals)]
    data = read_results(results, ["time", *names], _MOST_ROWS)
    if len(data["time"]) < 2:
        return []
    written = []
    for name, (title, panels) in FIGURES.items():
        figure = _draw(title, panels, joints, data)
        if figure is not None:
            path = folder / f"{name}.png"
            FigureCanvasAgg(figure).print_png(path)
            written.append(path)
        done(name)
    return written


def _draw(
    title: str, panels: Sequence[Panel], joints: Sequence[str], data: dict[str, Vector]
) -> Figure | None:
    shown = [j for j in joints if any(f"{j}.{c.signal}" in data for p in panels for c in p.curves)]
    if not shown:
        return None
    figure = Figure(figsize=(1.2 + 3.9 * len(shown), 0.8 + 2.1 * len(panels)), dpi=120, layout="constrained")
    grid = figure.subplots(len(panels), len(shown), squeeze=False, sharex="col")
    for column, joint in enumerate(shown):
        grid[0, column].set_title(joint, fontsize=11)
        grid[-1, column].set_xlabel("time / s")
        for row, panel in enumerate(panels):
            _draw_panel(grid[row, column], panel, joint, data)
            if column == 0:
                grid[row, 0].set_ylabel(panel.label)
    figure.align_ylabels()
    figure.suptitle(title, fontsize=12, fontweight="bold")
    return figure


def _draw_panel(axes: Axes, panel: Panel, joint: str, data: dict[str, Vector]) -> None:
    time = data["time"]
    part = (
        time >= time[0] + _TRANSIENT
        if panel.late and time[-1] > time[0] + 2 * _TRANSIENT
        else time >= time[0]
    )
    for curve in panel.curves:
        values = data.get(f"{joint}.{curve.signal}")
        minus = data.get(f"{joint}.{curve.less}") if curve.less else np.zeros_like(time)
        if values is None or minus is None:
            continue
        axes.plot(
            time[part],
            curve.scale * (values - minus)[part],
            color=curve.color,
            label=curve.label,
            linestyle=(0, (4, 2)) if curve.dashed else "-",
            linewidth=1.1,
        )
    if len(panel.curves) > 1:
        axes.legend(fontsize=8, frameon=False)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    axes.margins(x=0.01)
