"""Ecos through ecospy, with its fixed-step algorithm.

Its own CSV writer records: one file, every 10th step, six digits after the decimal point. Reading
all signals with `get_real` after every 10 steps gives full values, but is slower.

It steps FMUs in threads of TBB, as many as TBB chooses; ecospy does not let one choose how many.
"""

import ctypes
import sys
import time
from pathlib import Path

from ..job import Job
from .worker import Measurement, main


def measure(job: Job) -> Measurement:
    """Run the job in one call."""
    # ecospy needs this library at its import and does not find it in the package tbb by itself
    ctypes.CDLL(str(Path(sys.prefix, "lib", "libtbb.so.12")), ctypes.RTLD_GLOBAL)
    from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure

    EcosLib.set_log_level("err")
    start = {f"{c.name}::{v.name}": v.value for c in job.components for v in c.start_values}
    names = [f"{c.name}::{output.name}" for c, output in job.signals]
    with EcosSimulationStructure() as structure:
        for c in job.components:
            structure.add_model(c.name, c.fmu)
        for c in job.components:
            for v in c.inputs:
                structure.make_real_connection(names[v.signal], f"{c.name}::{v.name}")
        structure.add_parameter_set("start", start)
        with EcosSimulation(job.step, structure=structure) as simulation:
            file = Path(job.scratch, "ecos.csv")
            simulation.add_csv_writer(str(file), identifiers=names, decimation_factor=job.every)
            if not simulation.init(parameter_set="start"):
                raise RuntimeError(EcosLib.get_last_error())
            started = time.perf_counter()
            simulation.step(job.steps)
            seconds = time.perf_counter() - started
            signals = [simulation.get_real(name) for name in names]
            simulation.terminate()
    return Measurement(seconds, job.steps, signals)


if __name__ == "__main__":
    main(measure, "ecospy")
