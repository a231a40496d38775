"""Draw images/coupling.png: hdrm-coupled against hdrm-merged, and the effect of a delayed force.

Needs the project with the extra `test`.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from emla_cosim.base.arrays import Vector
from emla_cosim.run.simulation import Simulation
from emla_cosim.study.loading import load
from tests.support.coupled_machine import SAMPLE, positions

HERE = Path(__file__).parent

PARTS = (1, 2, 4, 8, 16)
"""Parts of a sample of 0.1 ms that are used as communication steps."""
FINEST = 128
LATE = (1e-4, 5e-5, 2.5e-5)
"""Steps in s for the delayed force."""
FORCE = "machine.manipulator.F_L[3]"
SHOWN = 4e-3
CASES: Mapping[str, tuple[str, bool, str]] = {
    "inputs held": ("none", False, "#d9822b"),
    "followed (fmu)": ("fmu", False, "#2f6db3"),
    "followed, without d_2": ("fmu", True, "#4a9c6d"),
}
"""Extrapolation, whether d_2 is left out, and colour by label."""


def errors(coupled: Simulation, merged: Simulation, extrapolation: str, quiet: bool) -> list[float]:
    """Return the largest difference of a position, as a part of its range, for each step."""
    exact = positions(merged, FINEST, extrapolation, quiet)
    found = (positions(coupled, parts, extrapolation, quiet) for parts in PARTS)
    return [float((np.abs(x - exact).max(axis=0) / np.ptp(exact, axis=0)).max()) for x in found]


def forces(coupled: Simulation, algorithm: str, step: float) -> tuple[Vector, Vector]:
    """Return time in ms and largest load force of the telescope so far in kN, until the run ends."""
    result = coupled.attempt(algorithm=algorithm, step_size=step, output_interval=step, stop_time=SHOWN)
    return 1e3 * np.asarray(result.time), 1e-3 * np.maximum.accumulate(np.abs(result[FORCE]))


def draw_errors(axes: Axes, found: Mapping[str, list[float]]) -> None:
    """Draw error against step."""
    steps = 1e6 * SAMPLE / np.array(PARTS)
    for label, values in found.items():
        axes.plot(steps, values, marker="o", markersize=3, color=CASES[label][2], label=label)
    for order, label in ((1, "inputs held"), (2, "followed, without d_2")):
        line = 0.4 * found[label][2] * (steps / steps[2]) ** order
        axes.plot(steps[1:4], line[1:4], color="black", linewidth=0.7, alpha=0.6)
        axes.annotate(
            f"order {order}", (steps[3], line[3]), (-40, -4), textcoords="offset points", fontsize=8
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(steps, [f"{step:g}" for step in steps])
    axes.minorticks_off()
    axes.set_xlabel("communication step / µs")
    axes.set_ylabel("largest error of a position / its range")
    axes.set_title("hdrm-coupled against hdrm-merged", fontsize=10, loc="left")
    axes.legend(fontsize=8, frameon=False, loc="lower right")


def draw_forces(axes: Axes, found: Mapping[str, tuple[Vector, Vector]]) -> None:
    """Draw the largest force so far over time, agreed and delayed."""
    shades = iter(("#2f6db3", "#f0b67f", "#d9822b", "#8c4a0b"))
    for label, (time, force) in found.items():
        axes.plot(time, force, linewidth=1.2, color=next(shades), label=label)
    axes.set_yscale("log")
    axes.set_ylim(1.0, 1e7)
    axes.set_xlim(0.0, 1e3 * SHOWN)
    axes.set_xlabel("time / ms")
    axes.set_ylabel("largest load force of the telescope so far / kN")
    axes.set_title("A force that is one step late", fontsize=10, loc="left")
    axes.legend(fontsize=8, frameon=False, loc="upper right")


def main() -> None:
    """Run, print the numbers, draw."""
    with tempfile.TemporaryDirectory() as folder:
        coupled, merged = (
            load(name, fmus=Path(folder)).prepare() for name in ("hdrm-coupled", "hdrm-merged")
        )
        found = {label: errors(coupled, merged, *case[:2]) for label, case in CASES.items()}
        late = {"strong, 100 µs": forces(coupled, "strong", SAMPLE)}
        late |= {f"jacobi, {1e6 * step:g} µs": forces(coupled, "jacobi", step) for step in LATE}
        coupled.close()
        merged.close()
    for label, values in found.items():
        print(label, *(f"{value:.2e}" for value in values))
    figure = Figure(figsize=(9.6, 4.0), dpi=150, layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_errors(left, found)
    draw_forces(right, late)
    for axes in (left, right):
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    FigureCanvasAgg(figure).print_png(HERE / "images" / "coupling.png")


if __name__ == "__main__":
    main()
