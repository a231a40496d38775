"""Other masters run the joint with our FMUs, and get the bits of our master.

FMPy has no master: it runs the loop that anyone would write with it. libcosim and Ecos exchange values
in initialization mode until they have gone all the way round. The container of FMU Manipulation Toolbox
passes them on once, in the order of declaration, which is enough for the joint: its plant is declared
first, and the plant's outputs do not depend on inputs. All then exchange values after all have stepped,
as our Jacobi does; a sequential container does what our Gauss-Seidel does.
"""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave, fmi2Error
from fmu_manipulation_toolbox.assembly import AssemblyNode

from emla_cosim.fmu.log import FmuLog
from emla_cosim.study.loading import load
from tests.support.joint_run import STEP, Array, Case, differences, our_run

slow = pytest.mark.slow
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


def run_package(host: Callable[..., Array], case: Case, folder: Path) -> Array:
    """Run the joint as a package in a tool."""
    options = {"fmus": case.folder, "flavour": case.flavour, "step_size": case.step}
    scenario = load(case.system, **options, stop_time=case.times.stop)
    return host(scenario.export(folder / "joint.ssp"), case.signals, case.step, case.steps)


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


HOSTS = [
    pytest.param(fmpy_run, "jacobi", id="FMPy"),
    pytest.param(container_run, "jacobi", id="container", marks=slow),
    pytest.param(
        partial(container_run, sequential=True), "gauss-seidel", id="sequential container", marks=slow
    ),
]
"""Masters, each with our algorithm that does the same."""
if sys.platform == "linux":  # libcosim and Ecos have no packages for other platforms
    from tests.support.package_hosts import connect_in_libcosim, ecos_run

    HOSTS += [
        pytest.param(connect_in_libcosim, "jacobi", id="libcosim", marks=slow),
        pytest.param(partial(run_package, ecos_run), "jacobi", id="Ecos", marks=slow),
    ]


@pytest.mark.parametrize(("master", "algorithm"), HOSTS)
def test_joint_has_the_bits_of_our_master(
    master: Master, algorithm: str, case: Case, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    values = master(case, tmp_path)
    assert differences(case, values, our_run(case, algorithm)) == {}
    assert [line for line in "".join(capfd.readouterr()).splitlines() if "FMI status" not in line] == []


@slow
@pytest.mark.skipif(sys.platform != "linux", reason="libcosim has packages for Linux only.")
def test_libcosim_has_the_bits_of_the_whole_study(fmu_folder: Path, tmp_path: Path) -> None:
    """Three joints, 15 FMUs."""
    case = Case(load("study").system, fmu_folder, "native", 500, STEP)
    assert differences(case, connect_in_libcosim(case, tmp_path), our_run(case, "jacobi")) == {}
