"""A loop of FMPy calls as most users first write it: dictionaries, lists, and appended rows."""

import time

from fmpy.fmi2 import FMU2Slave

from ..job import Component, Job
from .worker import Measurement, main


def measure(job: Job) -> Measurement:
    """Run the job; every 10th row is a dictionary in a list."""
    slaves = {c.name: _instance(c, job.stop) for c in job.components}
    sources = [f"{c.name}.{output.name}" for c, output in job.signals]
    values = dict.fromkeys(sources, 0.0)
    wires = {c.name: {v.reference: sources[v.signal] for v in c.inputs} for c in job.components}
    results = {c.name: {v.reference: f"{c.name}.{v.name}" for v in c.outputs} for c in job.components}

    def pass_inputs(name: str) -> None:
        if wires[name]:
            slaves[name].setReal(list(wires[name]), [values[source] for source in wires[name].values()])

    def read_outputs(name: str) -> None:
        found = slaves[name].getReal(list(results[name]))
        values.update(zip(results[name].values(), found, strict=True))

    before: dict[str, float] = {}
    while values != before:
        before = dict(values)
        for name in slaves:
            pass_inputs(name)
        for name in slaves:
            read_outputs(name)
    for name, slave in slaves.items():
        slave.exitInitializationMode()
        read_outputs(name)

    rows = [dict(values)]
    started = time.perf_counter()
    for k in range(job.steps):
        for name in slaves:
            pass_inputs(name)
        for slave in slaves.values():
            slave.doStep(k * job.step, job.step)
        for name in slaves:
            read_outputs(name)
        if (k + 1) % job.every == 0:
            rows.append(dict(values))
    return Measurement(time.perf_counter() - started, job.steps, list(rows[-1].values()))


def _instance(c: Component, stop: float) -> FMU2Slave:
    slave = FMU2Slave(guid=c.guid, unzipDirectory=c.folder, modelIdentifier=c.identifier, instanceName=c.name)
    slave.instantiate()
    setters = {"Real": slave.setReal, "Integer": slave.setInteger, "Boolean": slave.setBoolean}
    for v in c.start_values:
        setters[v.type]([v.reference], [v.value])
    slave.setupExperiment(startTime=0.0, stopTime=stop)
    slave.enterInitializationMode()
    return slave


if __name__ == "__main__":
    main(measure, "fmpy")
