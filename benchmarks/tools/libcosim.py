"""libcosim (Open Simulation Platform) through libcosimpy, with its fixed-step algorithm.

Its own file observer records: a CSV file per FMU, every 10th step, six significant digits. Of what it
offers this is the fastest: its time series in memory take every step, and its last-value observer
reads every variable of every FMU at every step.

It steps FMUs in worker threads, one less than there are processors, and neither its Python package
nor its C interface lets one choose how many.
"""

import ctypes
import time
from pathlib import Path
from tempfile import mkdtemp
from xml.etree.ElementTree import Element, ElementTree, SubElement

from libcosimpy._internal import get_last_error_message, libcosimc, wrap_function
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from ..job import Job
from .worker import Measurement, main


def measure(job: Job) -> Measurement:
    """Run the job. The first step initializes and the last is observed in full: both are not timed."""
    log_output_level(CosimLogLevel.ERROR)  # it warns of enumerations, which it ignores; the study sets none
    execution = CosimExecution.from_step_size(round(job.step * 1e9))
    _checked(execution.add_observer(_file_observer(job)))
    index = _add_fmus(execution, job)
    _checked(execution.step(1))
    started = time.perf_counter()
    _checked(execution.step(job.steps - 2))
    seconds = time.perf_counter() - started
    return Measurement(seconds, job.steps - 2, _signals_of_last_step(execution, job, index))


def _checked(succeeded: bool) -> None:
    if not succeeded:
        raise RuntimeError(get_last_error_message())


def _add_fmus(execution: CosimExecution, job: Job) -> dict[str, int]:
    setters = {
        "Real": execution.real_initial_value,
        "Integer": execution.integer_initial_value,
        "Boolean": execution.boolean_initial_value,
    }
    index = {c.name: execution.add_local_slave(CosimLocalSlave(c.fmu, c.name)) for c in job.components}
    for c in job.components:
        for v in c.start_values:
            _checked(setters[v.type](index[c.name], v.reference, v.value))
        for v in c.inputs:
            source, output = job.signals[v.signal]
            ends = (index[source.name], output.reference, index[c.name], v.reference)
            _checked(execution.connect_real_variables(*ends) == 0)
    return index


def _file_observer(job: Job) -> CosimObserver:
    """Which libcosimpy has, but not with a configuration; the C function is there."""
    folder = Path(mkdtemp(dir=job.scratch))
    root = Element("simulators", timeStampedFileNames="false")
    for c in job.components:
        simulator = SubElement(root, "simulator", name=c.name, decimationFactor=str(job.every))
        for output in c.outputs:
            SubElement(simulator, "variable", name=output.name)
    ElementTree(root).write(folder / "LogConfig.xml")
    create = wrap_function(
        lib=libcosimc(),
        funcname="cosim_file_observer_create_from_cfg",
        argtypes=[ctypes.c_char_p, ctypes.c_char_p],
        restype=ctypes.POINTER(CosimObserver),
    )
    pointer = create(str(folder).encode(), str(folder / "LogConfig.xml").encode())
    _checked(bool(pointer))
    return CosimObserver(CosimObserver._CosimObserver__create_key, pointer)


def _signals_of_last_step(execution: CosimExecution, job: Job, index: dict[str, int]) -> list[float]:
    observer = CosimObserver.create_time_series()
    _checked(execution.add_observer(observer))
    for c, output in job.signals:
        _checked(observer.start_time_series(index[c.name], output.reference, CosimVariableType.REAL))
    _checked(execution.step(1))
    return [
        observer.time_series_real_samples(index[c.name], output.reference, job.steps, 1)[2][0]
        for c, output in job.signals
    ]


if __name__ == "__main__":
    main(measure, "libcosimpy")
