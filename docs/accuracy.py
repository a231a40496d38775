"""Draw images/accuracy.png: error against step and against cost, of the lift joint in smooth motion.

Needs the project with the extra `test`, which has the whole joint as one equation.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.study.loading import load
from tests.support.smooth_lift import STATE_SIGNALS, lift, whole

HERE = Path(__file__).parent

STOP, SAMPLE = 0.03, 5e-4
STEPS = (1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2.5e-6)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
FIRST_STEP = 1e-5
COMPARED = slice(0, 6)
"""Position, speed, currents and estimates; adapted parameters change too little in 0.03 s."""
COLORS = {"jacobi": "#7a7a7a", "gauss-seidel": "#d9822b", "strong": "#2f6db3"}


@dataclass(frozen=True)
class Point:
    """One run: largest error of a state as a part of its range, and number of calls of doStep."""

    error: float
    calls: int


class Joint:
    """The prepared joint and its reference solution."""

    def __init__(self, folder: Path) -> None:
        self.system = lift()
        scenario = load(self.system, fmus=folder, stop_time=STOP, step_size=FIRST_STEP, profile=True)
        self.simulation = scenario.prepare(output_interval=SAMPLE)
        self.solution = whole(np.linspace(0.0, STOP, round(STOP / SAMPLE) + 1))

    def fixed(self, name: str, extrapolation: str, step: float) -> Point:
        """Run in fixed steps."""
        return self._point(algorithm=name, extrapolation=extrapolation, step_size=step)

    def controlled(self, name: str, tolerance: float) -> Point:
        """Run with error control and extrapolated inputs."""
        return self._point(algorithm=name, extrapolation="fmu", error_tolerance=tolerance)

    def _point(self, **options: Any) -> Point:
        result = self.simulation.run(**options)
        calls = sum(fmu["calls"]["steps"]["count"] for fmu in result.profile["fmus"].values())
        states = np.column_stack([result[name] for name in STATE_SIGNALS])
        errors = np.abs(states - self.solution).max(axis=0) / np.ptp(self.solution, axis=0)
        return Point(float(errors[COMPARED].max()), calls)


def draw(fixed: dict[tuple[str, str], list[Point]], controlled: dict[str, list[Point]], path: Path) -> None:
    """Draw two panels: error against step, and error against calls."""
    figure = Figure(figsize=(9.6, 4.4), dpi=150, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    steps = 1e6 * np.array(STEPS)
    for (name, extrapolation), points in fixed.items():
        style = {"color": COLORS[name], "marker": "o", "markersize": 3, "linewidth": 1.3}
        if extrapolation == "none":
            style |= {"linestyle": (0, (4, 2)), "markerfacecolor": "white"}
        left.plot(steps, [p.error for p in points], **style)
        right.plot([p.calls for p in points], [p.error for p in points], **style)
    for name, points in controlled.items():
        right.plot(
            [p.calls for p in points],
            [p.error for p in points],
            color=COLORS[name],
            marker="D",
            markersize=5,
            linewidth=0.8,
            linestyle=":",
        )
    guide(left, steps[-3:], fixed["jacobi", "none"][-2].error * 0.32, 1)
    guide(left, steps[-3:], fixed["strong", "fmu"][-2].error * 0.32, 2)
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_ylim(1.3e-6, 1.5)
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    left.set_xlabel("communication step / µs")
    left.set_ylabel("largest error of a state / its range")
    left.set_xticks([2.5, 5, 10, 20, 50, 100], ["2.5", "5", "10", "20", "50", "100"])
    left.minorticks_off()
    right.set_xlabel("calls of doStep, including repeated and rejected ones")
    left.set_title("Error against step", fontsize=10, loc="left")
    right.set_title("Error against cost", fontsize=10, loc="left")
    label(left, fixed, steps)
    legend(right)
    figure.suptitle("Lift joint, five FMUs, 0.03 s of smooth motion", fontsize=12, fontweight="bold")
    FigureCanvasAgg(figure).print_png(path)


def guide(axes: Axes, steps: np.ndarray, error: float, order: int) -> None:
    """Draw a thin line of this order through an error at the middle step."""
    axes.plot(steps, error * (steps / steps[1]) ** order, color="black", linewidth=0.7, alpha=0.6)
    axes.annotate(
        f"order {order}", (steps[1], error), (6, -11), textcoords="offset points", fontsize=8, alpha=0.7
    )


def label(axes: Axes, fixed: dict[tuple[str, str], list[Point]], steps: np.ndarray) -> None:
    """Write names along the extrapolated lines; those of held inputs coincide."""
    for name, color in COLORS.items():
        axes.annotate(
            name,
            (steps[-1], fixed[name, "fmu"][-1].error),
            (3, 5),
            textcoords="offset points",
            rotation=25,  # order 2 in this figure
            rotation_mode="anchor",
            fontsize=8.5,
            color=color,
            fontweight="bold",
        )
    axes.annotate(
        "inputs held: all three",
        (steps[3], fixed["jacobi", "none"][3].error),
        (-4, 9),
        textcoords="offset points",
        fontsize=8.5,
        ha="right",
    )


def legend(axes: Axes) -> None:
    """Explain dashes and markers; the other panel names the colours."""
    held = axes.plot([], [], "o", color="black", markersize=3, linestyle=(0, (4, 2)), markerfacecolor="white")
    followed = axes.plot([], [], "o-", color="black", markersize=3)
    controlled = axes.plot([], [], "D:", color="black", markersize=5, linewidth=0.8)
    names = [
        "fixed steps, inputs held",
        "fixed steps, extrapolated (fmu)",
        "error control, extrapolated (fmu)",
    ]
    axes.legend([*held, *followed, *controlled], names, fontsize=8, frameon=False, loc="lower left")


def main() -> None:
    """Run, print the numbers, draw."""
    with tempfile.TemporaryDirectory() as folder:
        joint = Joint(Path(folder))
        fixed = {
            (name, extrapolation): [joint.fixed(name, extrapolation, step) for step in STEPS]
            for extrapolation in ("none", "fmu")
            for name in ALGORITHMS
        }
        controlled = {name: [joint.controlled(name, t) for t in TOLERANCES] for name in ALGORITHMS}
    for key, points in {**fixed, **controlled}.items():
        print(key, *(f"{p.error:.2e} ({p.calls})" for p in points))
    draw(fixed, controlled, HERE / "images" / "accuracy.png")


if __name__ == "__main__":
    main()
