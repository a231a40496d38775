"""The built-in scenarios keep what the documentation promises, by their metrics."""

from pathlib import Path

import numpy as np
import pytest

from emla_cosim.inputs.stored_runs import open_stored_run
from emla_cosim.run.result import Result
from emla_cosim.run.scenarios.scenario_file import SCENARIOS
from emla_cosim.study.loading import load
from tests.support.joint_data import EMLAS
from tests.support.scenario_runs import run_scenario
from tests.support.tiers import mostly_slow

# Table VI, column RSBA: position error m, speed error m/s, torque effort N m, convergence s
TABLE_VI = {
    "lift": (6e-5, 3.8e-4, 93.75, 0.083),
    "tilt": (6.5e-5, 2.08e-3, 102.0, 0.085),
    "telescope": (2.13e-3, 4.7e-3, 35.0, 0.086),
}
JOINTS = tuple(TABLE_VI)


@pytest.fixture(scope="module")
def study_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the files of `study` are."""
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def study(fmu_folder: Path, study_folder: Path) -> Result:
    return run_scenario(load("study"), study_folder, fmus=fmu_folder, stop_time=1.0)


def as_table(result: Result, joint: str) -> tuple[float, float, float, float]:
    m = result.metrics["joints"][joint]
    return m["position_error_m"], m["velocity_error_m_s"], m["torque_effort_N_m"], m["convergence_time_s"]


@pytest.mark.parametrize("joint", JOINTS)
def test_study_is_better_than_every_cell_of_table_vi(study: Result, joint: str) -> None:
    assert study.problem is None
    assert study.steps == 10_000 and study.metrics["joints"][joint]["held"]
    for computed, published in zip(as_table(study, joint), TABLE_VI[joint], strict=True):
        assert 0 < computed < published


@pytest.mark.parametrize("joint", JOINTS)
def test_study_reaches_its_limits_and_keeps_them(study: Result, study_folder: Path, joint: str) -> None:
    names = [f"{joint}.{x}" for x in ("plant.inverter.u_q", "plant.inverter.u_d", "plant.tau_m", "plant.i_q")]
    u_q, u_d, tau_m, i_q = open_stored_run(study_folder / "results.csv").read(names).values()
    emla = EMLAS[joint]
    assert study.metrics["joints"][joint]["saturated_fraction"] > 0
    assert np.hypot(u_q, u_d).max() <= emla.u_max * (1 + 1e-12)
    assert np.abs(tau_m).max() <= emla.tau_max
    # true torque: the actual current drives the screw
    assert tau_m == pytest.approx(1.5 * emla.N_p * emla.Phi_PM * i_q, rel=1e-12)


def test_study_has_observers_in_the_loop_and_disturbances() -> None:
    system = load("study").system
    for joint in JOINTS:
        feeding = {
            x.input: (x.source, x.output) for x in system.connections if x.target == f"{joint}.controller"
        }
        assert feeding["x_hat"] == (f"{joint}.observer", "x_hat")
        assert feeding["v_hat"] == (f"{joint}.observer", "v_hat")
        plant = system.component(f"{joint}.plant").parameters
        assert [plant[f"uncertainty.F_{n}"] for n in (2, 3, 4)] == [0.01, 0.002, 0.001]
        assert "use_commanded_current" not in plant  # the default: actual current
        disturbance = system.component(f"{joint}.disturbance").parameters
        assert disturbance["d_3.amplitude[1]"] == 0.42
        assert disturbance["d_2.amplitude[1]"] in (0.8, 0.9)


def test_joint_alone_has_the_rows_of_the_study(
    study: Result, study_folder: Path, fmu_folder: Path, tmp_path: Path
) -> None:
    single_joint = run_scenario(load("telescope"), tmp_path, fmus=fmu_folder, stop_time=0.2)
    name = ["telescope.plant.x_L"]
    in_study = open_stored_run(study_folder / "results.csv").read(name)[name[0]][:201]
    assert np.array_equal(open_stored_run(tmp_path / "results.csv").read(name)[name[0]], in_study)
    assert list(single_joint.metrics["joints"]) == ["telescope"]


def test_published_gains_with_true_states_have_the_errors_of_the_paper(
    fmu_folder: Path, tmp_path: Path
) -> None:
    """Errors within a factor of two of Table VI for lift and tilt, torques within a fifth."""
    result = run_scenario(load("published-true-states"), tmp_path, fmus=fmu_folder, stop_time=3.0)
    assert result.problem is None
    for joint in ("lift", "tilt"):
        position, speed, torque, _ = as_table(result, joint)
        assert TABLE_VI[joint][0] / 2 < position < TABLE_VI[joint][0] * 2
        assert speed < TABLE_VI[joint][1]
        assert torque == pytest.approx(TABLE_VI[joint][2], rel=0.2)


def test_published_gains_leave_large_errors_in_every_joint(fmu_folder: Path) -> None:
    """Their observer does not know the load: decimetres after 1 s, an overflow in steps of 0.1 ms."""
    with load("published").prepare(fmus=fmu_folder) as simulation:
        result = simulation.run()
        assert simulation.attempt(step_size=1e-4).end_s < 1e-2
    assert all(result.metrics["joints"][joint]["position_error_m"] > 0.2 for joint in JOINTS)


@pytest.mark.slow
def test_whole_study_is_better_than_table_vi(fmu_folder: Path) -> None:
    with load("study").prepare(fmus=fmu_folder) as simulation:
        result = simulation.run()
    assert result.steps == 100_000
    for joint in JOINTS:
        assert (np.array(as_table(result, joint)) < TABLE_VI[joint]).all()


STARTED = [(name, gains) for name in SCENARIOS for gains in ("robust", "published")]


@pytest.mark.parametrize(
    ("name", "gains"), mostly_slow(STARTED, [("study-drive", "published"), ("hdrm-merged", "robust")])
)
def test_every_scenario_starts_with_all_gains(name: str, gains: str, fmu_folder: Path) -> None:
    # a computing delay may be 32 steps at the most, and the printed gains lose a drive in 5
    components = load(name, gains=gains).system.components
    delays = [c.parameters.get("inverter.delay", 0.0) for c in components]
    step, count = (max(delays), 3) if any(delays) else (1e-6, 10)
    with load(
        name, gains=gains, step_size=step, stop_time=count * step, fmus=fmu_folder
    ).prepare() as simulation:
        assert simulation.run().problem is None
