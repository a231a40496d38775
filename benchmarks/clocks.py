"""Measure blocks with a periodic clock, which ticks in each step: python -m benchmarks.clocks.

Ten blocks in a chain do steps of 1 ms. The same blocks without a clock show what the ticks cost.
"""

from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import emla_cosim as ec
import fmublock
from emla_cosim.fmu.models import MODELS
from emla_cosim.system.model import System

ROUNDS, BLOCKS, STEP, STOP_TIME = 7, 10, 1e-3, 20.0
"""Rounds, number of blocks, step size in s, and length of a run in s."""
CLOCKS = {"without a clock": None, "with a clock": STEP}
"""The interval of the clock of each variant in s."""


def main() -> None:
    """Measure and print."""
    rates: dict[str, list[float]] = {name: [] for name in CLOCKS}
    with TemporaryDirectory(prefix="emla-benchmark-") as folder:
        for name, clock in CLOCKS.items():
            fmublock.build(MODELS["SignalFault"], Path(folder, f"{name}.fmu"), fmi=3, clock=clock)
        for _ in range(ROUNDS):
            for name, samples in rates.items():
                samples.append(_measure(Path(folder, f"{name}.fmu")))
    reference_rate = np.median(rates["without a clock"])
    print("| Blocks | steps/s | range | ratio |\n|---|---:|---:|---:|")
    for name, samples in rates.items():
        span = f"{min(samples):.0f} - {max(samples):.0f}"
        print(f"| {name} | {np.median(samples):.0f} | {span} | {np.median(samples) / reference_rate:.3g} |")


def _measure(fmu: Path) -> float:
    """Return the steps per second of a run."""
    names = [f"b{i}" for i in range(BLOCKS)]
    wires = [f"{source}.y -> {target}.u" for source, target in pairwise(names)]
    system = System.of(dict.fromkeys(names, fmu), wires)
    with ec.load(system, step_size=STEP, stop_time=STOP_TIME).prepare() as simulation:
        result = simulation.run()
    return result.steps / result.wall_s


if __name__ == "__main__":
    main()
