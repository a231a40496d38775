"""Measure what the number of FMUs makes of preparation and rate: python -m benchmarks.size [--write].

Each size in a process of its own, in rounds. Times are of this machine at this moment.
"""

import json
import resource
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import emla_cosim as ec
from benchmarks.rounds import ROOT
from benchmarks.row import ring
from benchmarks.run import README
from benchmarks.table import in_readme, three_digits
from emla_cosim.run.simulation import Simulation

SIZES = (5, 15, 50, 150, 500, 1500)
ROUNDS = 5
STEP = 1e-3
STEPS = 3_000_000
"""Steps of single FMUs in a run, whatever its size."""
PICTURE = ROOT / "docs" / "images" / "size.png"
COLOR, PLAIN = "#2f6db3", "#7a7a7a"

Figures = Mapping[str, float]
"""`preparation_s` of CPU, the largest `memory_MB`, and the `rate` in steps of single FMUs per s."""


def main() -> None:
    """Measure and print; with --write also the table in the README, and the picture."""
    with TemporaryDirectory(prefix="emla-benchmark-") as folder:
        _prepared(min(SIZES), Path(folder)).close()  # builds the FMU, and compiles the loop
        rounds = [{count: _in_process(count, folder) for count in SIZES} for _ in range(ROUNDS)]
    figures = {n: {key: median(r[n][key] for r in rounds) for key in rounds[0][n]} for n in SIZES}
    table = _table(figures)
    print(table)
    if "--write" in sys.argv:
        README.write_text(in_readme(README.read_text(encoding="utf-8"), table, "size"), encoding="utf-8")
        _draw(figures)


def measure(count: int, folder: Path) -> Figures:
    """The figures of a ring of so many FMUs, in a process that has prepared a small one before."""
    _prepared(min(SIZES), folder).close()
    start = time.process_time()
    with _prepared(count, folder) as simulation:
        preparation = time.process_time() - start
        result = simulation.run(recorders=[])
        rate = result.steps * count / result.wall_s
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    return {"preparation_s": preparation, "memory_MB": megabytes, "rate": rate}


def _prepared(count: int, folder: Path) -> Simulation:
    stop = STEPS // count * STEP
    return ec.load(ring(count), fmus=folder, step_size=STEP, stop_time=stop, algorithm="jacobi").prepare()


def _in_process(count: int, folder: str) -> Figures:
    command = [sys.executable, "-m", "benchmarks.size", str(count), folder]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout)


def _table(figures_by_count: Mapping[int, Figures]) -> str:
    rows = [
        f"| {n} | {f['preparation_s']:.3f} | {1e3 * f['preparation_s'] / n:.2f} | {f['memory_MB']:.0f} "
        f"| {three_digits(f['rate'] / n)} | {f['rate'] / 1e6:.2f} |"
        for n, f in figures_by_count.items()
    ]
    head = "| FMUs | Preparation, s of CPU | ms per FMU | Memory, MB | Steps/s | Steps of FMUs, millions/s |"
    return "\n".join([head, "|" + 6 * "---:|", *rows])


def _draw(figures_by_count: Mapping[int, Figures]) -> None:
    """Preparation and rate against the number of FMUs."""
    figure = Figure(figsize=(9.6, 3.6), dpi=150, layout="constrained")
    left, right = figure.subplots(1, 2)
    preparation = [f["preparation_s"] for f in figures_by_count.values()]
    left.plot(SIZES, preparation, marker="o", markersize=4, color=COLOR, label="measured")
    proportional = [preparation[-1] * n / SIZES[-1] for n in SIZES]
    left.plot(SIZES, proportional, color=PLAIN, linewidth=0.9, label="in proportion to 1,500")
    left.set_yscale("log")
    left.set_yticks((0.002, 0.01, 0.05, 0.2, 1.0), ("0.002", "0.01", "0.05", "0.2", "1"))
    left.set_ylabel("preparation / s of CPU", fontsize=9)
    left.legend(fontsize=8, frameon=False)
    rates = [f["rate"] / 1e6 for f in figures_by_count.values()]
    right.plot(SIZES, rates, marker="o", markersize=4, color=COLOR)
    right.set_ylim(0.0, 1.15 * max(rates))
    right.set_ylabel("steps of FMUs / (millions/s)", fontsize=9)
    for axes, title in ((left, "Preparation"), (right, "Rate")):
        _dress(axes, title)
    FigureCanvasAgg(figure).print_png(PICTURE)


def _dress(axes: Axes, title: str) -> None:
    axes.set_xscale("log")
    axes.set_xticks(SIZES, list(map(str, SIZES)))
    axes.minorticks_off()
    axes.set_xlabel("FMUs", fontsize=9)
    axes.set_title(title, fontsize=10, loc="left")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


if __name__ == "__main__":
    if sys.argv[1:2] in ([], ["--write"]):
        main()
    else:
        print(json.dumps(measure(int(sys.argv[1]), Path(sys.argv[2]))))
