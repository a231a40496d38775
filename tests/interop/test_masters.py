"""Other masters run the joint with our FMUs, and get the bits of our master.

FMPy has no master: it runs the loop that anyone would write with it. libcosim and Ecos exchange values
in initialization mode until they have gone all the way round. The container of FMU Manipulation Toolbox
passes them on once, in the order of declaration, which is enough for the joint: its plant is declared
first, and the plant's outputs do not depend on inputs. All then exchange values after all have stepped,
as our Jacobi does; a sequential container does what our Gauss-Seidel does.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave, fmi2Error
from fmu_manipulation_toolbox.assembly import AssemblyNode

from emla_cosim.fmu.log import FmuLog
from emla_cosim.fmu.models import build
from tests.support.joint_run import STEP, Array, Case, differences, our_run, study_joint

if sys.platform == "linux":  # libcosim and Ecos have no packages for other platforms
    from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

slow = pytest.mark.slow
linux = pytest.mark.skipif(sys.platform != "linux", reason="The host has packages for Linux only.")
Master = Callable[[Case, Path], Array]


def fmpy_run(case: Case, folder: Path) -> Array:
    """Run Jacobi by hand, one variable at a time."""
    slaves: dict[str, FMU2Slave] = {}
    references, log = {}, FmuLog()
    for c in case.system.components:
        path = str(case.fmus[c.name])
        description = read_model_description(path)
        slaves[c.name] = slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=extract(path, folder / c.name),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=c.name,
        )
        slave.instantiate(callbacks=log.callbacks, loggingOn=True)
        references[c.name] = {v.name: [v.valueReference] for v in description.modelVariables}
        setters = {"Real": slave.setReal, "Integer": slave.setInteger, "Boolean": slave.setBoolean}
        types = {v.name: v.type for v in description.modelVariables}
        for name, value in c.parameters.items():
            setters[types[name]](references[c.name][name], [value])
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()

    def exchange() -> None:
        for x in case.system.connections:
            value = slaves[x.source].getReal(references[x.source][x.output])
            slaves[x.target].setReal(references[x.target][x.input], value)

    def row() -> list[float]:
        return [slaves[c].getReal(references[c][output])[0] for c, output in case.signals]

    for _ in slaves:
        exchange()
    for slave in slaves.values():
        slave.exitInitializationMode()
    rows = [row()]
    for k in range(case.steps):
        exchange()
        for slave in slaves.values():
            slave.doStep(k * case.step, case.step)
        rows.append(row())
    for slave in slaves.values():
        slave.terminate()
        slave.freeInstance()
    assert {name: log.last(name) for name in case.fmus if log.last(name)} == {}
    return np.array(rows)


def libcosim_run(case: Case, folder: Path) -> Array:
    log_output_level(CosimLogLevel.WARNING)
    nanoseconds = round(case.step * 1e9)
    variables, execution = case.variables(), CosimExecution.from_step_size(nanoseconds)
    observer = CosimObserver.create_time_series()
    assert execution.add_observer(observer)
    setters = {
        "Real": execution.real_initial_value,
        "Integer": execution.integer_initial_value,
        "Boolean": execution.boolean_initial_value,
    }
    index = {}
    for c in case.system.components:
        index[c.name] = execution.add_local_slave(CosimLocalSlave(str(case.fmus[c.name]), c.name))
        for name, value in c.parameters.items():
            variable = variables[c.name][name]
            assert setters[variable.type](index[c.name], variable.valueReference, value)

    def reference(component: str, variable: str) -> tuple[int, int]:
        return index[component], variables[component][variable].valueReference

    for x in case.system.connections:
        ends = (*reference(x.source, x.output), *reference(x.target, x.input))
        assert execution.connect_real_variables(*ends) == 0
    for signal in case.signals:
        assert observer.start_time_series(*reference(*signal), CosimVariableType.REAL)
    assert execution.step(case.steps + 1)  # one step more, because libcosimpy drops the last sample
    columns = []
    for signal in case.signals:
        times, _, values = observer.time_series_real_samples(*reference(*signal), 0, case.steps + 2)
        assert times == [k * nanoseconds for k in range(case.steps + 1)]
        columns.append(values)
    return np.array(columns).T.copy()


def ecos_run(case: Case, folder: Path) -> Array:
    EcosLib.set_log_level("warn")
    start = {f"{c.name}::{n}": v for c in case.system.components for n, v in c.parameters.items()}
    with EcosSimulationStructure() as structure:
        for name, path in case.fmus.items():
            structure.add_model(name, path)
        for x in case.system.connections:
            structure.make_real_connection(f"{x.source}::{x.output}", f"{x.target}::{x.input}")
        structure.add_parameter_set("joint", start)
        with EcosSimulation(case.step, structure=structure) as simulation:
            assert simulation.init(parameter_set="joint")
            rows = []
            for k in range(case.steps + 1):
                if k > 0:
                    simulation.step()
                rows.append([simulation.get_real(f"{c}::{output}") for c, output in case.signals])
            simulation.terminate()
    return np.array(rows)


def container_run(case: Case, folder: Path, sequential: bool = False) -> Array:
    node = AssemblyNode(
        "Joint.fmu",
        step_size=case.step,
        sequential=sequential,
        auto_link=False,
        auto_input=False,
        auto_output=False,
    )
    names = {c.name: f"{c.name}.fmu" for c in case.system.components}
    for c in case.system.components:
        node.add_fmu(names[c.name], str(case.fmus[c.name]))
        for variable, value in c.parameters.items():
            text = str(value).lower() if isinstance(value, bool) else repr(value)
            node.add_start_value(names[c.name], variable, text)
    for x in case.system.connections:
        node.add_link(names[x.source], x.output, names[x.target], x.input)
    outputs = [output for _, output in case.signals]  # component.output is how the container calls its links
    for component, output in case.signals:
        node.add_output(names[component], output, output)
    node.make_fmu(folder)
    errors = set()

    def logger(environment: object, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        if status >= fmi2Error:
            errors.add(message)

    result = simulate_fmu(
        str(folder / "Joint.fmu"),
        stop_time=case.times.stop,
        step_size=case.step,
        output_interval=case.step,
        output=outputs,
        logger=logger,
    )
    assert errors <= {b"Solver configure...."}, "the container always logs this one as an error"
    return np.array([result[name] for name in outputs]).T.copy()


def sequential_container_run(case: Case, folder: Path) -> Array:
    return container_run(case, folder, sequential=True)


HOSTS = [
    pytest.param(fmpy_run, "jacobi", id="FMPy"),
    pytest.param(libcosim_run, "jacobi", id="libcosim", marks=[slow, linux]),
    pytest.param(ecos_run, "jacobi", id="Ecos", marks=[slow, linux]),
    pytest.param(container_run, "jacobi", id="container", marks=slow),
    pytest.param(sequential_container_run, "gauss-seidel", id="sequential container", marks=slow),
]
"""Masters, each with our algorithm that does the same."""


@pytest.mark.parametrize(("master", "algorithm"), HOSTS)
def test_joint_has_the_bits_of_our_master(
    master: Master, algorithm: str, case: Case, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    found = master(case, tmp_path)
    assert differences(case, found, our_run(case, algorithm)) == {}
    if master in (libcosim_run, ecos_run):
        assert "".join(capfd.readouterr()) == "", "no warnings"


class Mixed(Case):
    """FMUs of FMI 3.0 in `newer`, where a component needs no arrays: Ecos knows only scalars."""

    newer: Path

    @property
    def fmus(self) -> dict[str, Path]:
        arrays = {c.name for c in self.system.components if any("[" in name for name in c.parameters)}
        third = {c.name: c.model for c in self.system.components if c.name not in arrays}
        built = {name: build(model, "native", [], self.newer, fmi=3) for name, model in third.items()}
        return {**super().fmus, **built}


@slow
@linux
def test_ecos_has_the_same_bits_with_fmi_3(
    fmu_folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = study_joint(), fmu_folder, "native", 300, STEP
    mixed = Mixed(*arguments)
    mixed.newer = tmp_path
    assert len(mixed.fmus) == 5 and len(list(tmp_path.rglob("*.fmu"))) == 2  # plant and observer
    assert differences(mixed, ecos_run(mixed, tmp_path), our_run(Case(*arguments), "jacobi")) == {}
    # Ecos 0.7.2 says the second line of the Reference FMUs, too
    known = {"Loading FMI version 3...", 'Function "fmi3GetVersion" is not provided by this FMU.'}
    assert {line for line in "".join(capfd.readouterr()).splitlines() if line} <= known
