"""The joint as one container FMU of FMU Manipulation Toolbox, whose runtime is an importer in C.

In initialization mode the container passes values on once, from FMU to FMU along the links; a loop it
enters at the FMU that was declared first. The joint declares the plant before observer and controller,
and the plant's outputs depend on no input without delay: so all are right after one pass. In parallel
mode, the default, the container then does what our Jacobi does, in sequential mode what our
Gauss-Seidel does, with the FMUs in the order of their declaration.
"""

from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi2 import fmi2Error
from fmu_manipulation_toolbox.assembly import AssemblyNode

from tests.support.joint_run import Case, differences, our_run

OWN_ERROR = b"Solver configure...."
"""What the container itself reports as an error whenever it is instantiated."""


def container_of(case: Case, sequential: bool, folder: Path) -> Path:
    """One FMU of the joint's FMUs. Its outputs have their own names, which no two share: component.output
    is how the container calls its links."""
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
    for component, output in case.signals:
        node.add_output(names[component], output, output)
    node.make_fmu(folder)
    return folder / "Joint.fmu"


@pytest.mark.parametrize(("sequential", "algorithm"), [(False, "jacobi"), (True, "gauss-seidel")])
def test_container_is_bit_for_bit_our_master(
    sequential: bool, algorithm: str, case: Case, tmp_path: Path
) -> None:
    container = container_of(case, sequential, tmp_path)
    outputs, step = [output for _, output in case.signals], case.step
    errors = []

    def logger(environment: object, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        if status >= fmi2Error:
            errors.append(message)

    result = simulate_fmu(
        str(container),
        stop_time=case.times.stop,
        step_size=step,
        output_interval=step,
        output=outputs,
        logger=logger,
    )
    found = np.array([result[name] for name in outputs]).T.copy()
    assert differences(case, found, our_run(case, algorithm)) == {}
    assert set(errors) <= {OWN_ERROR}
