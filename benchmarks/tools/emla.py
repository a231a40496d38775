"""EMLA-Cosim, this project's own master."""

import time
from pathlib import Path

from emla_cosim.results.csv_file import CsvFile
from emla_cosim.results.recorder import Recorder

from emla_cosim.loading import load
from emla_cosim.master.algorithms.jacobi import Jacobi
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.stepping.fixed_steps import FixedSteps
from emla_cosim.master.stepping.timing import timing
from emla_cosim.master.stretches import simulate

from ..job import Job
from ..study import SCENARIO
from .worker import Measurement, main


def measure(job: Job, to_disk: bool = False) -> Measurement:
    """Run the job; every 10th row goes to an array, or to a file with all its digits."""
    system = load(SCENARIO).system
    fmus = {c.name: Path(c.fmu) for c in job.components}
    times = timing(job.steps * job.step, job.step)
    with Assembly(system, fmus) as assembly:
        network, algorithm = assembly.network, Jacobi()
        algorithm.setup(network)
        stepping = FixedSteps(algorithm, times)
        algorithm.initialize(times.start, times.stop)
        width, rows = 1 + len(network.signals), job.steps // job.every + 1
        if to_disk:
            recorder = Recorder(
                width, [CsvFile(Path(job.scratch, "results.csv"), network.names, 1)], job.every
            )
        else:
            recorder = Recorder(width, [], job.every, block_rows=rows)
            recorder.room(rows).fill(0.0)  # the C loop touches its memory before, too
        stepping.record(recorder)
        started = time.perf_counter()
        simulate(stepping, recorder)
        recorder.close()
        return Measurement(time.perf_counter() - started, job.steps, network.signals.tolist())


if __name__ == "__main__":
    main(measure, "emla-cosim")
