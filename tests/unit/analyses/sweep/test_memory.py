"""A sweep of many variants needs no more memory than one of a few; EMLA_SWEEP_VARIANTS sets how many."""

import os
from pathlib import Path

import numpy as np
import psutil
import pytest

from emla_cosim.analyses.sweep.runner import sweep
from emla_cosim.base.progress import Progress

VARIANTS = int(os.environ.get("EMLA_SWEEP_VARIANTS", "250"))
MOST = 8 * 2**20
"""Bytes by which a process may grow after the first fifth."""


class Watching(Progress):
    """Looks at the memory of this process and of its child whenever a chunk has come back."""

    def __init__(self) -> None:
        self._processes = [psutil.Process()]
        self._count = 0
        self.sizes: list[tuple[int, list[int]]] = []

    def begin(self, task: str, total: int, unit: str = "") -> None:
        self._count = 0
        if unit == "variants":
            command = "emla_cosim.analyses.execution.variant_processes:run_variants"
            self._processes += [p for p in psutil.Process().children() if command in p.cmdline()]

    def advance(self, count: int) -> None:
        self._count += count
        if len(self._processes) > 1:
            self.sizes.append((self._count, [process.memory_info().rss for process in self._processes]))


@pytest.mark.slow
def test_many_variants_need_no_more_memory_than_a_few(fmu_folder: Path) -> None:
    watching = Watching()
    values = np.linspace(0.1, 0.2, VARIANTS).tolist()
    result = sweep(
        "lift",
        {"lift.plant.motor.R_s": values},
        metrics=["lift.torque_peak_N_m", "last = last(lift.plant.x_L)"],
        signals=["lift.plant.x_L"],
        stop_time=0.002,
        fmus=fmu_folder,
        workers=1,
        progress=watching,
    )
    assert result.variants.height == VARIANTS
    first_sizes = [sizes for count, sizes in watching.sizes if 0 < count <= VARIANTS // 5][-1]
    grown = np.subtract(watching.sizes[-1][1], first_sizes)
    print(f"{VARIANTS} variants: caller and process grew by {grown / 2**20} MiB")
    assert grown.max() < MOST
