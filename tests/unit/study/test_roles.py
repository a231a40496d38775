"""`--role`: metrics, limits and pictures of joints in systems with other names."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.study.loading import load
from emla_cosim.study.roles import RoleNames, check_roles, find_variable
from tests.support.axis import axis
from tests.support.commands import Emla, sentence

OTHER_NAMES = {"plant": "press", "reference": "plan", "observer": "guess", "controller": "loop"}
ROLES = {
    **{role: f"a.press.{role}" for role in ("x_L", "v_L", "tau_m", "i_q", "i_d")},
    **{role: f"a.press.screw.{role}" for role in ("q_LB", "q_UB", "v_max")},
    **{role: f"a.press.motor.{role}" for role in ("i_max", "temperature_rise", "permitted_rise", "i_N")},
    **{role: f"a.press.friction.{role}" for role in ("F_C", "F_S")},
    "x_d": "a.plan.x_d",
    "v_d": "a.plan.v_d",
    "x_hat": "a.guess.x_hat",
    "limited_control": "a.loop.saturated",
    "limited_inverter": "a.press.inverter.saturated",
}
SLIDE = {"slide.x_L": "gantry.slide.place", "slide.x_d": "gantry.motion.x_d"}


@pytest.fixture(scope="module")
def package(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return axis(tmp_path_factory.mktemp("axis"), fmu_folder)


@pytest.fixture(scope="module")
def slide(package: Path) -> Iterator[ec.Simulation]:
    with load(package).prepare() as simulation:
        yield simulation


def renamed() -> ec.System:
    """The lift with other names for its components."""
    system, joint = load("lift").system, len("lift.")
    called = {c.name: f"a.{OTHER_NAMES.get(c.name[joint:], c.name[joint:])}" for c in system.components}
    return ec.System(
        tuple(replace(c, name=called[c.name]) for c in system.components),
        tuple(replace(x, source=called[x.source], target=called[x.target]) for x in system.connections),
    )


@pytest.mark.parametrize("changes", [{}, {"{plant}.start.x_L": 0.38}])
def test_metrics_and_limits_do_not_depend_on_names(changes: dict[str, float], fmu_folder: Path) -> None:
    how = {"stop_time": 0.5, "step_size": 1e-4, "fmus": fmu_folder}
    with load("lift", **how).prepare() as default:
        expected = default.run(set={n.format(plant="lift.plant"): v for n, v in changes.items()})
    with load(renamed(), **how).prepare() as simulation:
        roles = {f"lift.{role}": name for role, name in ROLES.items()}
        actual = simulation.run(roles=roles, set={n.format(plant="a.press"): v for n, v in changes.items()})
    joint, right = dict(actual.metrics["joints"]["lift"]), dict(expected.metrics["joints"]["lift"])
    trip, right_left = joint.pop("trip"), right.pop("trip")
    effects = [{item["name"] for item in figures.pop("idealised")} for figures in (joint, right)]
    assert effects[0] == {"friction", "heating"} < effects[1]  # other parameters have no roles here
    for figures in (joint, right):
        for name in ("reason", "limits_touched"):
            figures.pop(name)
    np.testing.assert_equal(joint, right)
    assert (trip is None) == (right_left is None) == (not changes)
    if trip is not None:
        assert trip["signal"].startswith("a.press.") and trip["time_s"] == right_left["time_s"]
        assert actual.remarks[0] == expected.remarks[0].replace("lift.plant", "a.press")


@pytest.mark.parametrize("signal", ["j.disturbance.F_L", "j.plant.F_L"])
@pytest.mark.parametrize("kind", [list, RoleNames.fromkeys])
def test_load_of_data_replaces_that_of_the_scenario(signal: str, kind: Any) -> None:
    """Whether data drive the output of the disturbance or the input of the plant."""
    names = ["j.disturbance.F_L", "j.plant.x_L"]
    assert find_variable("j", "F_L", kind(names)) == "j.disturbance.F_L"
    assert find_variable("j", "F_L", kind([*names, f"input_2.{signal}"])) == f"input_2.{signal}"


def test_position_and_reference_are_enough(slide: ec.Simulation) -> None:
    result = slide.run(roles=SLIDE, output_interval=1e-3)
    figures = result.metrics["joints"]["slide"]
    error = np.abs(result["gantry.slide.place"] - result["gantry.motion.x_d"])
    outside = np.flatnonzero(error > 0.05 * error[0])
    assert figures["convergence_time_s"] == pytest.approx(result.time[outside[-1]])
    assert figures["settling_time_s"] == pytest.approx(result.time[np.flatnonzero(error > 1e-3)[-1] + 1])
    since = max(0.3, figures["settling_time_s"] + 0.2)
    assert figures["position_error_m"] == error[result.time >= since - 1e-9].max()
    for name in ("torque_peak_N_m", "torque_effort_N_m", "velocity_error_m_s"):
        assert np.isnan(figures[name]), name
    assert slide.run(roles=SLIDE, require=["slide.held == true"]).problem is None


def test_limit_from_a_parameter(slide: ec.Simulation) -> None:
    result = slide.run(roles={**SLIDE, "slide.q_UB": "gantry.slide.reach"}, output_interval=1e-3)
    positions = result["gantry.slide.place"]
    trip = result.metrics["joints"]["slide"]["trip"]
    assert trip["value"] == positions[positions > 0.081][0] and trip["limit"] == 0.08
    assert result.remarks[0].startswith("slide tripped on its stroke at t = ")


WRONG = [
    ({"x_L": "a.x"}, "there is no role 'x_L'; write JOINT.ROLE, with one of x_L, v_L,"),
    ({"j.x_L": "a.y"}, "there is no signal 'a.y' for the role j.x_L; did you mean a.x?"),
    ({"j.x_L": "zzzz"}, "there is no signal 'zzzz' for the role j.x_L; there are a.x and b.plan."),
    ({"j.v_max": "a.x"}, "there is no parameter 'a.x' for the role j.v_max; there are a.fast."),
    ({"j.x_L": "a.x"}, "the joint 'j' has roles, but lacks j.x_d; add a signal for each."),
]


@pytest.mark.parametrize(("roles", "words"), WRONG)
def test_wrong_roles(roles: dict[str, str], words: str) -> None:
    with pytest.raises(ec.CommandError) as caught:
        check_roles(roles, ["a.x", "b.plan"], ["a.fast"])
    assert str(caught.value).startswith(words)


def test_roles_of_a_scenario_file(package: Path, emla: Emla) -> None:
    roles = "".join(f'{role} = "{signal}"\n' for role, signal in SLIDE.items())
    Path("mine.toml").write_text(f'system = "{package}"\n[roles]\n{roles}')
    result = emla("run", "mine.toml", "--output", "o", "--role", "slide.v_L=gantry.slide.rate")
    assert result.exit_code == 0, result.output
    assert "slide" in result.stdout and "position error" in result.stdout
    changes = json.loads(Path("o/run.json").read_text())["settings"]["roles"]
    assert changes == {**SLIDE, "slide.v_L": "gantry.slide.rate"}
    assert {"tracking.png", "errors.png"} <= {path.name for path in Path("o").iterdir()}
    before = Path("o/results.csv").read_bytes()
    wrong = emla("run", "mine.toml", "--output", "o", "--role", "slide.v_L=gantry.slide.rat")
    assert "did you mean gantry.slide.rate" in sentence(wrong, 2)
    assert Path("o/results.csv").read_bytes() == before
