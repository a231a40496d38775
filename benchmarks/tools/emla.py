"""EMLA-Cosim, this project's own master."""

from dataclasses import replace
from pathlib import Path

from emla_cosim.recorders.csv_file import CsvFile
from emla_cosim.recorders.table import TimeSeries
from emla_cosim.study.loading import load

from ..job import Job
from ..study import SCENARIO
from .worker import Measurement, main


def measure(job: Job, to_disk: bool = False) -> Measurement:
    """Run the job; every 10th row goes to an array, or to a file with all its digits.

    Like every run, this one computes metrics of every step, which is part of what is measured.
    """
    files = {c.name: Path(c.fmu) for c in job.components}
    values = {c.name: {v.name: v.value for v in c.start_values} for c in job.components}
    study = load(SCENARIO).system
    parts = (replace(c, fmu=files[c.name], parameters=values[c.name]) for c in study.components)
    system = replace(study, components=tuple(parts))
    scenario = load(
        system,
        stop_time=job.steps * job.step,
        step_size=job.step,
        output_interval=job.every * job.step,
        **{"algorithm": "jacobi", **job.options},
    )
    table = CsvFile(Path(job.scratch, "results.csv")) if to_disk else TimeSeries()
    with scenario.prepare() as simulation:
        result = simulation.run(recorders=[table])
    signals = [float(values[-1]) for values in result.read(result.names).values()]
    return Measurement(result.wall_s, result.steps, signals)


if __name__ == "__main__":
    main(measure, "emla-cosim")
