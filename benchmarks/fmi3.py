"""Compare FMUs of FMI 3.0 with the same ones of FMI 2.0 in the study: python -m benchmarks.fmi3 [--write].

All FMUs are built for both versions. Both systems run in this process, in turn, and give the same bits.
"""

import random
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy import stats

import emla_cosim as ec
import fmublock
from benchmarks.errors import BenchmarkError
from benchmarks.run import README
from benchmarks.table import in_readme, three_digits
from emla_cosim.fmu.models import MODELS

ROUNDS, RUNS, STOP_TIME = 20, 6, 4.0
"""Rounds, runs of each version in a round of which the fastest counts, and their length in s."""
VERSIONS = 2, 3


def main() -> None:
    """Measure and print; with --write also the table in the README."""
    with TemporaryDirectory(prefix="emla-benchmark-") as folder:
        two, three = (_prepare(Path(folder), version) for version in VERSIONS)
        with two, three:
            times = _measure({2: two, 3: three})
    logarithms = np.log(times[2] / times[3])
    middle, error = logarithms.mean(), stats.sem(logarithms)
    low, high = np.exp(stats.t.interval(0.95, ROUNDS - 1, loc=middle, scale=error))
    lines = ["| FMUs | steps/s of CPU time | ratio | 95 % interval |", "|---|---:|---:|---:|"]
    lines.append(f"| FMI 2.0 | {three_digits(1.0 / np.median(times[2]))} | 1 | |")
    rate = three_digits(1.0 / np.median(times[3]))
    lines.append(f"| FMI 3.0 | {rate} | {np.exp(middle):.3f} | {low:.3f} - {high:.3f} |")
    table = "\n".join(lines)
    print(table)
    if "--write" in sys.argv:
        README.write_text(in_readme(README.read_text(encoding="utf-8"), table, "fmi3"), encoding="utf-8")


def _prepare(folder: Path, version: int) -> ec.Simulation:
    """Return the study with all FMUs built for a version of FMI."""
    study = ec.load("study").system
    fmus = dict[str, Path]()
    for component in study.components:
        path = folder / str(version) / f"{component.model}.fmu"
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            fmublock.build(MODELS[str(component.model)], path, fmi=version)
        fmus[component.name] = path
    return ec.load("study", replace=fmus).prepare()


def _measure(studies: dict[int, ec.Simulation]) -> dict[int, np.ndarray]:
    """Return the CPU time of a step in s, by version and round; BenchmarkError if the results differ."""
    chance, times = random.Random(1), {version: np.full(ROUNDS, np.inf) for version in VERSIONS}
    signals = {version: _signals(studies[version].run(stop_time=STOP_TIME)) for version in VERSIONS}
    if not np.array_equal(signals[2], signals[3], equal_nan=True):
        raise BenchmarkError("the study has other results with FMUs for FMI 3.0")
    for i in range(ROUNDS):
        for version in chance.sample(RUNS * VERSIONS, RUNS * len(VERSIONS)):
            start = time.process_time()
            result = studies[version].run(stop_time=STOP_TIME)
            spent = (time.process_time() - start) / result.steps
            times[version][i] = min(times[version][i], spent)
        print(f"round {i + 1}: {times[2][i] / times[3][i]:.3f}", file=sys.stderr)
    return times


def _signals(result: ec.Result) -> np.ndarray:
    return np.array([result[name] for name in result.names if result[name].dtype != object])


if __name__ == "__main__":
    main()
