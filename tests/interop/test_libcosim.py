"""libcosim (Open Simulation Platform) runs the joint as our master does with Jacobi.

It exchanges values in initialization mode until they have gone all the way round, and once more after
it. In a step all FMUs step, then all outputs are read and passed on; what it records at a time are the
outputs at that time. Time is a whole number of nanoseconds: FMUs get it divided by 1e9, and as step the
difference of two such times.
"""

from itertools import pairwise

import numpy as np
import pytest
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from interop.joint_run import STEP, Array, Case, Steps, differences, our_run

NANOSECONDS = round(STEP * 1e9)


def steps_of_libcosim(count: int) -> Steps:
    times = [k * NANOSECONDS / 1e9 for k in range(count + 1)]
    return [(t, end - t) for t, end in pairwise(times)]


def libcosim_run(case: Case) -> Array:
    variables, execution = case.variables(), CosimExecution.from_step_size(NANOSECONDS)
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
    # one step more, because libcosimpy drops the last sample
    assert execution.step(case.steps + 1)
    columns = []
    for signal in case.signals:
        times, _, values = observer.time_series_real_samples(*reference(*signal), 0, case.steps + 2)
        assert times == [k * NANOSECONDS for k in range(case.steps + 1)]
        columns.append(values)
    return np.array(columns).T.copy()


def test_closed_loop_is_bit_for_bit_that_of_our_master(case: Case) -> None:
    expected = our_run(case, "jacobi", steps_of_libcosim(case.steps))
    assert differences(case, libcosim_run(case), expected) == {}


def test_it_complains_of_nothing_but_enumerations(case: Case, capfd: pytest.CaptureFixture[str]) -> None:
    """Which it leaves at the FMU's default; the joint sets none."""
    log_output_level(CosimLogLevel.WARNING)
    libcosim_run(case)
    lines = "".join(capfd.readouterr()).splitlines()
    ignored = [line.split("with name ")[-1] for line in lines]
    assert ignored == ["torque_source will be ignored", "d_2.reading will be ignored"]
