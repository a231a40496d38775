"""CoFMPy (package cofmupy), by its master, with the method `jacobi`.

It records to lists in memory by itself; its master can leave that out, and here does so for nine steps
of ten. It orders FMUs before it steps them, so that only those in a loop are Jacobi; here it is set
to take all of them together. It sets every start value as a Real one and exchanges nothing at
initialization: both are done by hand.
"""

import tempfile
import time

from cofmupy.config_parser import ConfigParser
from cofmupy.master import DefaultMaster

from ..job import Component, Job
from .worker import Measurement, main


def measure(job: Job) -> Measurement:
    """Run the job step by step."""
    tempfile.tempdir = job.scratch  # where it leaves unpacked FMUs
    config = ConfigParser(_configuration(job)).master_config
    group = [[c.name for c in job.components]]
    master = DefaultMaster(config["fmus"], config["connections"], group, "jacobi")
    for c in job.components:
        fmu = master.fmu_handlers[c.name].fmu
        setters = {"Integer": fmu.setInteger, "Boolean": fmu.setBoolean}
        for v in c.start_values:
            if v.type in setters:
                setters[v.type]([v.reference], [v.value])
    master.init_simulation()
    started = time.perf_counter()
    for k in range(job.steps):
        master.do_step(job.step, record_outputs=(k + 1) % job.every == 0)
    seconds = time.perf_counter() - started
    outputs = master.get_outputs()
    return Measurement(seconds, job.steps, [outputs[c.name][output.name][0] for c, output in job.signals])


def _configuration(job: Job) -> dict:
    connections = []
    for c in job.components:
        for v in c.inputs:
            source, output = job.signals[v.signal]
            start = {"type": "fmu", "id": source.name, "variable": output.name}
            end = {"type": "fmu", "id": c.name, "variable": v.name}
            connections.append({"source": start, "target": [end]})
    fmus = [{"id": c.name, "path": c.fmu, "initialization": _real_values(c, job)} for c in job.components]
    return {"fmus": fmus, "connections": connections, "cosim_method": "jacobi"}


def _real_values(c: Component, job: Job) -> dict[str, float]:
    start = {v.name: v.value for v in c.start_values if v.type == "Real"}
    return start | {v.name: job.initial[v.signal] for v in c.inputs}


if __name__ == "__main__":
    main(measure, "cofmupy")
