"""Measure how well a sweep uses the machine's cores: python -m benchmarks.sweeping.

Rates depend on the machine and its load. Ratios are to the rate of one prepared simulation times the number
of workers. For comparison, the table has the rate of independent processes.
"""

import multiprocessing
import os
import time

import numpy as np

import emla_cosim as ec

ROUNDS, VARIANTS, ALONE = 5, 1000, 100
STOP_TIME = 1.0
VALUES = np.linspace(0.1, 0.2, VARIANTS).tolist()


def main() -> None:
    """Measure and print."""
    workers = len(os.sched_getaffinity(0))
    rows = []
    for _ in range(ROUNDS):
        rate_alone, rate_of_workers = rate_of_one(ALONE), rate_of_processes(workers)
        result = ec.sweep("lift", {"lift.plant.motor.R_s": VALUES}, stop_time=STOP_TIME, workers=workers)
        swept = VARIANTS * steps_of_one() / result.wall_s
        rows.append(
            (
                rate_alone,
                rate_of_workers,
                swept,
                rate_of_workers / (workers * rate_alone),
                swept / (workers * rate_alone),
            )
        )
    rate_alone, rate_of_workers, swept, possible, reached = np.median(rows, axis=0)
    print("| | Steps/s | Ratio |\n|---|---|---|")
    print(f"| one prepared simulation, times {workers} | {workers * rate_alone:.0f} | 1 |")
    print(f"| {workers} processes with one each | {rate_of_workers:.0f} | {possible:.3g} |")
    print(f"| sweep of {VARIANTS} variants | {swept:.0f} | {reached:.3g} |")


def rate_of_one(runs: int) -> float:
    """Steps per second of one simulation that is prepared once, with what is between the runs."""
    with ec.load("lift", stop_time=STOP_TIME).prepare() as lift:
        lift.run(recorders=[])
        start = time.perf_counter()
        for value in VALUES[:runs]:
            lift.run(recorders=[], set={"lift.plant.motor.R_s": value})
        return runs * steps_of_one() / (time.perf_counter() - start)


def rate_of_processes(count: int) -> float:
    """The sum of the rates of so many processes, each with one simulation, at the same time."""
    with multiprocessing.get_context("spawn").Pool(count) as pool:
        return sum(pool.map(rate_of_one, [2 * ALONE] * count, chunksize=1))


def steps_of_one() -> int:
    """Steps of a run."""
    return round(STOP_TIME / 1e-4)


if __name__ == "__main__":
    main()
