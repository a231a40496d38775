"""Draw images/benchmark-errors.png and print its table: two public benchmarks with several step sizes.

Needs the project with the extra `test`, which has models and solutions.
"""

import tempfile
from pathlib import Path
from types import ModuleType

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import emla_cosim as ec
from emla_cosim.base.errors import RunError
from emla_cosim.master.algorithms.registry import ALGORITHMS
from tests.support import crane, oscillator

STEPS = {"crane": (0.04, 0.02, 0.01, 0.005, 0.002, 0.001), "oscillator": (0.01, 0.005, 0.002, 0.001, 1e-4)}
"""Step sizes in s."""

EXTRAPOLATIONS = ("none", "master", "fmu")
COLORS = {"jacobi": "#7a7a7a", "gauss-seidel": "#d9822b", "strong": "#2f6db3"}
STYLES = {"none": (0, (4, 2)), "master": ":", "fmu": "-"}
OSCILLATOR_SIGNALS = ("left.x", "right.x", "left.v", "right.v")


def error_of_crane(result: ec.Result) -> float:
    """Return the largest error of the cylinder's length, as a part of its range."""
    times, exact = np.asarray(result["time"]), crane.solution(interval=0.001)
    found = np.asarray(result["crane.mechanics.s"])
    return float(np.abs(found - exact[np.rint(times / 0.001).astype(int), 1]).max() / np.ptp(exact[:, 1]))


def error_of_oscillator(result: ec.Result) -> float:
    """Return the largest error of a position or a speed, as a part of its range."""
    exact = oscillator.solution(np.asarray(result["time"]))
    found = np.column_stack([result[f"oscillator.{name}"] for name in OSCILLATOR_SIGNALS])
    return float((np.abs(found - exact) / np.ptp(exact, axis=0)).max())


def errors(name: str, module: ModuleType, folder: Path) -> dict[tuple[str, str], list[float]]:
    """Return the error of every step size by algorithm and extrapolation; NaN if a run fails."""
    measure = {"crane": error_of_crane, "oscillator": error_of_oscillator}[name]
    found = dict[tuple[str, str], list[float]]()
    with ec.load(module.system(folder), stop_time=module.STOP, step_size=1e-3).prepare() as simulation:
        for algorithm in ALGORITHMS:
            for extrapolation in EXTRAPOLATIONS:
                row = found[algorithm, extrapolation] = []
                for step in STEPS[name]:
                    options = {"algorithm": algorithm, "extrapolation": extrapolation, "step_size": step}
                    try:
                        row.append(measure(simulation.run(**options, output_interval=max(step, 0.01))))
                    except RunError:
                        row.append(np.nan)
    return found


def print_table(name: str, found: dict[tuple[str, str], list[float]]) -> None:
    """Print the errors as a Markdown table."""
    print(f"| {name} | " + " | ".join(f"{1e3 * step:g} ms" for step in STEPS[name]) + " |")
    print("|---|---" + "|---" * (len(STEPS[name]) - 1) + "|")
    for (algorithm, extrapolation), row in found.items():
        cells = ["fails" if np.isnan(x) else f"{x:.1e}" for x in row]
        print(f"| `{algorithm}`, `{extrapolation}` | " + " | ".join(cells) + " |")


def draw(found: dict[str, dict[tuple[str, str], list[float]]], path: Path) -> None:
    """Draw a panel for each benchmark: error against step."""
    figure = Figure(figsize=(9.6, 4.4), dpi=120, layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, (name, errors_of) in zip(panels, found.items(), strict=True):
        for (algorithm, extrapolation), row in errors_of.items():
            axes.plot(
                1e3 * np.array(STEPS[name]),
                np.minimum(row, 1e2),
                color=COLORS[algorithm],
                linestyle=STYLES[extrapolation],
                marker="o",
                markersize=3,
                linewidth=1.3,
                label=f"{algorithm}, {extrapolation}",
            )
        axes.set(xscale="log", yscale="log", xlabel="communication step / ms")
        axes.set_title(name.capitalize(), fontsize=10, loc="left")
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("largest error / range")
    panels[1].legend(fontsize=7, frameon=False)
    FigureCanvasAgg(figure).print_png(path)


def main() -> None:
    """Run, print the tables, draw."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, module in {"crane": crane, "oscillator": oscillator}.items():
            found[name] = errors(name, module, Path(folder))
            print_table(name, found[name])
    draw(found, Path(__file__).parent / "images" / "benchmark-errors.png")


if __name__ == "__main__":
    main()
