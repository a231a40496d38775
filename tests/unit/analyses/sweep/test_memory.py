"""A sweep of many variants needs no more memory than one of a few; EMLA_SWEEP_VARIANTS sets how many."""

import os
from pathlib import Path

import numpy as np
import psutil
import pytest

from emla_cosim.analyses.sweep.runner import sweep
from emla_cosim.base.progress import Progress
from tests.support.clusters import shared_cluster

VARIANTS = int(os.environ.get("EMLA_SWEEP_VARIANTS", "250"))
MOST = 8 * 2**20
"""Bytes by which a process may grow after the first fifth."""


class Watching(Progress):
    """Looks at the memory of processes whenever something has come back."""

    def __init__(self, processes: list[int]) -> None:
        self._processes = [psutil.Process(number) for number in processes]
        self._done = 0
        self.sizes: list[tuple[int, list[int]]] = []

    def advance(self, count: int) -> None:
        self._done += count
        if not self.sizes:  # the process in which the worker runs variants starts with the sweep
            self._processes += self._processes[-1].children()
        if len(self._processes) < 3:
            return
        self.sizes.append((self._done, [process.memory_info().rss for process in self._processes]))


@pytest.mark.slow
def test_many_variants_need_no_more_memory_than_a_few(fmu_folder: Path) -> None:
    with shared_cluster(1) as cluster:
        watching = Watching([os.getpid(), *cluster.run(os.getpid).values()])
        values = np.linspace(0.1, 0.2, VARIANTS).tolist()
        result = sweep(
            "lift",
            {"lift.plant.motor.R_s": values},
            metrics=["lift.torque_peak_N_m", "last = last(lift.plant.x_L)"],
            signals=["lift.plant.x_L"],
            stop_time=0.002,
            fmus=fmu_folder,
            scheduler=cluster,
            progress=watching,
        )
    assert result.variants.height == VARIANTS
    early = np.array([sizes for done, sizes in watching.sizes if done <= VARIANTS // 5][-1])
    late = np.array(watching.sizes[-1][1])
    grown = late - early
    caller, worker, process = grown / 2**20
    print(
        f"{VARIANTS} variants: growth in MiB: caller {caller:.1f}, worker {worker:.1f}, process {process:.1f}"
    )
    assert grown.max() < MOST
