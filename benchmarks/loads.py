"""Measure the effect of threads on light and heavy FMUs: python -m benchmarks.loads [--write].

The study runs with unchanged FMUs, with one joint's FMUs a hundred times as heavy, and with all FMUs that
heavy. Each round runs every variant once, in its own process. Rates depend on the machine and its load.
"""

import random
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.errors import BenchmarkError
from benchmarks.registry import C_LOOP, Tool
from benchmarks.rounds import ROOT, run_once
from benchmarks.run import README
from benchmarks.study import study_job
from benchmarks.table import in_readme, three_digits
from benchmarks.tools.c_loop import run_loop

HEAVY = 2e-7
"""Internal step in s: 500 of them in a communication step."""

LOADS: dict[str, tuple[Sequence[str], int]] = {
    "light": ((), 300_000),
    "mix": (("lift.*.solver.internal_step",), 10_000),
    "heavy": (("*.solver.internal_step",), 5_000),
}
"""What is made heavy, and how many steps are measured."""

EMLA, ECOS = Tool("EMLA-Cosim", "emla"), Tool("Ecos", "ecos", clock="sums")
WAYS: dict[str, tuple[Tool, Mapping[str, object]]] = {
    "C loop, jacobi": (C_LOOP, {}),
    "EMLA-Cosim, jacobi, one thread": (EMLA, {"threads": 1}),
    "EMLA-Cosim, jacobi": (EMLA, {}),
    "Ecos, jacobi": (ECOS, {}),
    "EMLA-Cosim, gauss-seidel, one thread": (EMLA, {"threads": 1, "algorithm": "gauss-seidel"}),
    "EMLA-Cosim, gauss-seidel": (EMLA, {"algorithm": "gauss-seidel"}),
}
BASE = {"gauss-seidel": "EMLA-Cosim, gauss-seidel, one thread"}
"""What a rate is compared with, if not with that of our own loop in one thread with `jacobi`."""
ROUNDS = 5
PICTURE = ROOT / "docs" / "images" / "loads.png"
OURS, OTHERS = "#2f6db3", "#9a9a9a"

Rates = Mapping[str, Mapping[str, float]]
"""Steps/s by load and way."""


def main() -> None:
    """Measure and print; with --write also the table in the README, and the picture."""
    with TemporaryDirectory(prefix="emla-benchmark-") as folder:
        rates_by_load = {load: _rates(load, Path(folder, load)) for load in LOADS}
    table = _table(rates_by_load)
    print(table)
    if "--write" in sys.argv:
        README.write_text(in_readme(README.read_text(encoding="utf-8"), table, "loads"), encoding="utf-8")
        _draw(rates_by_load)


def _rates(load: str, folder: Path) -> dict[str, float]:
    """Median rates of all ways; BenchmarkError where one computes anything else than it should."""
    folder.mkdir()
    heavy, steps = LOADS[load]
    job = study_job(ROOT / "fmus", folder, dict.fromkeys(heavy, HEAVY)).with_steps(steps)
    job = replace(job, initial=tuple(run_loop(job.with_steps(0)).signals))
    times: dict[str, list[float]] = {way: [] for way in WAYS}
    signals: dict[tuple[str, str], Sequence[float]] = {}
    chance = random.Random(1)
    for i in range(ROUNDS):
        for way in chance.sample(list(WAYS), len(WAYS)):
            tool, options = WAYS[way]
            result = run_once(replace(job, options=dict(options)), tool)
            if "problem" in result:
                raise BenchmarkError(f"{way}, {load}: {result['problem']}")
            times[way].append(result["seconds"] / result["steps"])
            same = signals.setdefault((tool.clock, str(options.get("algorithm"))), result["signals"])
            if list(same) != list(result["signals"]):
                raise BenchmarkError(f"{way}, {load}, computes something else than others of its kind.")
            print(f"{load}, round {i + 1}: {way}, {1.0 / times[way][-1]:.0f} steps/s", file=sys.stderr)
    return {way: 1.0 / median(each) for way, each in times.items()}


def _ratio(rates: Mapping[str, float], way: str) -> float:
    base = BASE.get("gauss-seidel" if "gauss-seidel" in way else "", "EMLA-Cosim, jacobi, one thread")
    return rates[way] / rates[base]


def _table(rates_by_load: Rates) -> str:
    cells = (f" {load}, steps/s | ratio |" for load in rates_by_load)
    lines = ["| |" + "".join(cells), "|---|" + 2 * len(rates_by_load) * "---:|"]
    for way in WAYS:
        rates = (
            f" {three_digits(rates_by_load[load][way])} | {_ratio(rates_by_load[load], way):.2f} |"
            for load in rates_by_load
        )
        lines.append(f"| {way} |" + "".join(rates))
    return "\n".join(lines)


def _draw(rates_by_load: Rates) -> None:
    """Ratios to one thread, load by load."""
    figure = Figure(figsize=(9.6, 3.4), dpi=150, layout="constrained")
    for axes, (load, rates) in zip(
        figure.subplots(1, len(rates_by_load), sharey=True), rates_by_load.items(), strict=True
    ):
        ratios = [_ratio(rates, way) for way in WAYS]
        colors = [OURS if way.startswith("EMLA") else OTHERS for way in WAYS]
        bars = axes.barh(range(len(WAYS)), ratios, color=colors, height=0.65)
        axes.bar_label(bars, [f"{ratio:.2f}" for ratio in ratios], padding=3, fontsize=8)
        axes.axvline(1.0, color="#555555", linewidth=0.8)
        axes.set_xlim(0.0, 2.2)
        in_c = three_digits(rates["C loop, jacobi"])
        axes.set_title(f"{load}: {in_c} steps/s in C", fontsize=10, loc="left")
        axes.set_xlabel("rate / that of one thread", fontsize=9)
        axes.set_yticks(range(len(WAYS)), list(WAYS), fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(axis="x", labelsize=8)
    figure.axes[0].invert_yaxis()
    FigureCanvasAgg(figure).print_png(PICTURE)


if __name__ == "__main__":
    main()
