"""libcosim (Open Simulation Platform) runs the joint as our master does with Jacobi.

It exchanges values in initialization mode until they have gone all the way round, and once more after
it. In a step all FMUs step, then all outputs are read and passed on; what it records at a time are the
outputs at that time. Time is a whole number of nanoseconds: FMUs get it divided by 1e9, and as step the
difference of two such times. Those are the times of our master as well.
"""

from pathlib import Path

import numpy as np
import pytest
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from emla_cosim.study.loading import load
from tests.support.joint_run import STEP, Array, Case, differences, our_run
from tests.support.scenario_runs import run_scenario


def libcosim_run(case: Case) -> Array:
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
    # one step more, because libcosimpy drops the last sample
    assert execution.step(case.steps + 1)
    columns = []
    for signal in case.signals:
        times, _, values = observer.time_series_real_samples(*reference(*signal), 0, case.steps + 2)
        assert times == [k * nanoseconds for k in range(case.steps + 1)]
        columns.append(values)
    return np.array(columns).T.copy()


def test_closed_loop_is_bit_for_bit_that_of_our_master(case: Case) -> None:
    assert differences(case, libcosim_run(case), our_run(case, "jacobi")) == {}


def test_the_study_is_bit_for_bit_what_our_command_writes(fmu_folder: Path, tmp_path: Path) -> None:
    """Three joints, 15 FMUs, as `emla run study --algorithm jacobi` leaves them in results.csv."""
    study = load("study")
    case = Case(study.system, fmu_folder, "native", 2000, STEP)
    options = {"algorithm": "jacobi", "stop_time": case.times.stop, "output_interval": STEP}
    assert run_scenario(study, tmp_path, fmus=fmu_folder, **options).problem is None
    rows = np.genfromtxt(
        tmp_path / "results.csv", delimiter=",", names=True, deletechars="", encoding="utf-8"
    )
    assert rows["time"].tolist() == [case.times.point(k) for k in range(case.steps + 1)]
    expected = np.array([rows[f"{c}.{output}"] for c, output in case.signals]).T.copy()
    assert differences(case, libcosim_run(case), expected) == {}


def test_it_complains_of_nothing(case: Case, capfd: pytest.CaptureFixture[str]) -> None:
    log_output_level(CosimLogLevel.WARNING)
    libcosim_run(case)
    assert "".join(capfd.readouterr()) == ""
