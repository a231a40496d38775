"""Measure what a run costs beside its steps: python -m benchmarks.front_door.

Times are of this machine at this moment; ratios are to what was measured in the same run.
"""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import emla_cosim as ec

ROUNDS = 5


def main() -> None:
    """Measure and print."""
    print("\n".join([*_starts(), *_preparation(), *_runs()]))


def _starts() -> list[str]:
    """Commands that do nothing heavy, against an empty Python; the minimum of interleaved rounds."""
    emla = str(Path(sys.executable).with_name("emla"))
    commands = {
        "python -c pass": [sys.executable, "-c", "pass"],
        "emla --help": [emla, "--help"],
        "emla list": [emla, "list"],
    }
    best = dict.fromkeys(commands, float("inf"))
    for _ in range(ROUNDS):
        for name, command in commands.items():
            took = _timed(lambda command=command: subprocess.run(command, capture_output=True, check=True))
            best[name] = min(best[name], took)
    empty = best.pop("python -c pass")
    return [f"{name}: {took / empty:.1f} x python -c pass ({took:.3f} s)" for name, took in best.items()]


def _preparation() -> list[str]:
    """`study` prepared in this process, where everything was imported and built before."""
    ec.load("study").prepare().close()
    times = [_timed(lambda: ec.load("study").prepare().close()) for _ in range(ROUNDS)]
    return [f"preparing study: {np.median(times):.3f} s"]


def _runs() -> list[str]:
    """Runs of 0.1 s beyond their stepping, and a hundred with other parameters."""
    with ec.load("study").prepare() as study:
        beyond, stepping = [], []
        for _ in range(10 * ROUNDS):
            start = time.perf_counter()
            result = study.run(stop_time=0.1)
            beyond.append(time.perf_counter() - start - result.wall_s)
            stepping.append(result.wall_s)

    def hundred() -> None:
        with ec.load("lift").prepare() as lift:
            for resistance in np.linspace(0.1, 0.2, 100):
                lift.run(stop_time=0.1, set={"lift.plant.motor.R_s": resistance})

    return [
        f"a run of study over 0.1 s beyond its stepping: {1e3 * np.median(beyond):.1f} ms, "
        f"{np.median(beyond) / np.median(stepping):.2f} of its stepping",
        f"100 runs of lift over 0.1 s, prepared once: {_timed(hundred):.2f} s",
    ]


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
