"""Libcosim and Ecos: tools that run packages (SSP) and single FMUs."""

from pathlib import Path

import numpy as np
from ecospy import EcosLib, EcosSimulation
from fmpy import read_model_description
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from tests.support.joint_run import Array, Case

Signal = tuple[str, str]
"""Component and output."""


def libcosim_run(package: Path, signals: list[Signal], step: float, count: int) -> Array:
    """Run a package with the step size that it tells libcosim."""
    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_ssp_file(str(package))
    indices = {c: execution.slave_index_from_instance_name(c.replace(".", "_")) for c, _ in signals}
    references = {
        c: {v.name.decode(): v.reference for v in execution.slave_variables(i)} for c, i in indices.items()
    }
    return observed(execution, [(indices[c], references[c][name]) for c, name in signals], step, count)


def connect_in_libcosim(case: Case, folder: Path) -> Array:
    """Run a case whose FMUs are connected by hand: of a package, libcosim ignores start values of outputs."""
    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(round(case.step * 1e9))
    setters = {
        "Real": execution.real_initial_value,
        "Integer": execution.integer_initial_value,
        "Boolean": execution.boolean_initial_value,
    }
    references = {}
    for c in case.system.components:
        index = execution.add_local_slave(CosimLocalSlave(str(case.fmus[c.name]), c.name))
        for v in read_model_description(str(case.fmus[c.name])).modelVariables:
            references[c.name, v.name] = index, v.valueReference
            if v.name in c.parameters:
                assert setters[v.type](index, v.valueReference, c.parameters[v.name])
    for x in case.system.connections:
        ends = (*references[x.source, x.output], *references[x.target, x.input])
        assert execution.connect_real_variables(*ends) == 0
    return observed(execution, [references[signal] for signal in case.signals], case.step, case.steps)


def observed(execution: CosimExecution, series: list[tuple[int, int]], step: float, count: int) -> Array:
    observer = CosimObserver.create_time_series()
    assert execution.add_observer(observer)
    for variable in series:
        assert observer.start_time_series(*variable, CosimVariableType.REAL)
    assert execution.step(count + 1)  # one step more, because libcosimpy drops the last sample
    columns = []
    for variable in series:
        times, _, values = observer.time_series_real_samples(*variable, 0, count + 2)
        assert times == [round(k * step * 1e9) for k in range(count + 1)]
        columns.append(values)
    return np.array(columns).T


def ecos_run(package: Path, signals: list[Signal], step: float, count: int) -> Array:
    EcosLib.set_log_level("warn")
    with EcosSimulation(step, ssp_path=str(package)) as simulation:
        assert simulation.init(parameter_set="initialValues")
        return stepped(simulation, [f"{c.replace('.', '_')}::{name}" for c, name in signals], count)


def stepped(simulation: EcosSimulation, names: list[str], count: int) -> Array:
    rows = []
    for k in range(count + 1):
        if k > 0:
            simulation.step()
        rows.append([simulation.get_real(name) for name in names])
    simulation.terminate()
    return np.array(rows)
