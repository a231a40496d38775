"""Warnings on loads beyond the motor and on stale models, from every command that runs."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.study.actuator.remarks import find_largest_load, find_reference_range
from tests.oracles.test_actuator import FILE, with_entries
from tests.support.commands import Emla
from tests.support.joint_data import PROTOTYPE

LOAD, PLANT = "prototype.disturbance.load", "prototype.plant"
HOLDABLE, TOO_HEAVY = 6.5e3, 90e3


def loads(first: float, later: float, begin: float, **further: float) -> dict[str, Any]:
    """A load that has its first level until the second one begins, and keeps the second one."""
    levels = {f"{LOAD}.level[1]": first, **{f"{LOAD}.level[{i}]": later for i in range(2, 7)}}
    return {**levels, f"{LOAD}.start[2]": begin, **{f"{LOAD}.{name}": x for name, x in further.items()}}


def profile(t: np.ndarray, first: float, later: float, begin: float, **o: float) -> np.ndarray:
    """The same load over time, by hand."""
    risen = np.clip((t - begin) / o.get("ramp", 0.5), 0.0, 1.0)
    ripple = 0.5 * o.get("ripple", 0.0) * np.sin(o.get("ripple_omega", 0.0) * t)
    return first + (later - first) * risen + ripple


@pytest.mark.parametrize(
    ("case", "times"),
    [
        ((HOLDABLE, TOO_HEAVY, 5.0, {}), (0.0, 4.9)),
        ((HOLDABLE, TOO_HEAVY, 5.0, {}), (0.0, 5.2)),
        ((HOLDABLE, TOO_HEAVY, 1e9, {}), (0.0, 6.0)),
        ((TOO_HEAVY, HOLDABLE, 1.0, {}), (0.0, 6.0)),
        ((TOO_HEAVY, HOLDABLE, 1.0, {}), (1.2, 6.0)),
        ((HOLDABLE, -TOO_HEAVY, 5.0, {}), (0.0, 6.0)),
        ((10e3, 10e3, 1e9, {"ripple": 8e3, "ripple_omega": 3.0}), (0.0, 6.0)),
        ((10e3, 10e3, 1e9, {"ripple": 8e3, "ripple_omega": 3.0}), (0.0, 0.2)),
        ((-10e3, -10e3, 1e9, {"ripple": 8e3, "ripple_omega": 3.0}), (0.0, 6.0)),
        ((10e3, 20e3, 2.0, {"ripple": 8e3, "ripple_omega": 0.1, "ramp": 1.5}), (0.5, 3.0)),
        ((10e3, 20e3, 2.0, {"ripple": 8e3, "ripple_omega": 5e3}), (0.0, 6.0)),
        ((10e3, 10e3, 1e9, {"ripple": 8e3, "ripple_omega": 0.0}), (0.0, 6.0)),
    ],
    ids=str,
)
def test_largest_load_within_the_run(case: Any, times: tuple[float, float]) -> None:
    """Half the width of the ripple counts, and only where its sine comes to it."""
    first, later, begin, further = case
    start, stop = times
    scenario = ec.load(
        "prototype", set=loads(first, later, begin, **further), start_time=start, stop_time=stop
    )
    dense = profile(np.linspace(start, stop, 200_001), first, later, begin, **further)
    actual = find_largest_load("prototype", scenario.system, scenario.options)
    assert actual == pytest.approx(np.abs(dense).max(), rel=1e-4)


def test_warning_follows_options() -> None:
    scenario = ec.load("prototype", actuator={"prototype": FILE}, stop_time=4.0, set=loads(0.0, 0.0, 5.0))
    assert scenario.notes == ()
    first, later = {f"{LOAD}.level[1]": "90 kN"}, {f"{LOAD}.level[2]": TOO_HEAVY}
    (note,) = scenario.with_options({"set": first}).notes
    assert "a load of 9e+04 N" in note and "the motor cannot hold it" in note
    assert scenario.with_options({"set": {f"{LOAD}.level[1]": HOLDABLE}}).notes == ()
    assert scenario.with_options({"set": later}).notes == ()  # it begins after the run
    assert scenario.with_options({"set": later, "stop_time": 6.0}).notes == (note,)
    sooner = {**later, f"{LOAD}.start[2]": "1000 ms"}
    assert scenario.with_options({"set": sooner}).notes == (note,)


MOVE = "prototype.reference.move"


def test_way_points_beyond_the_run_do_not_count() -> None:
    """A second move to 0.3 m, at four times the speed, begins at 5 s."""
    beyond = {f"prototype.reference.waypoint[{i}]": 0.3 for i in range(3, 10)}
    later = {**beyond, f"{MOVE}.start[2]": 5.0, f"{MOVE}.duration[2]": 1.5}
    scenario = ec.load("prototype", set=later)

    def reach(**options: Any) -> Any:
        return find_reference_range("prototype", scenario.system, scenario.options.updated(options))

    speeds = 15 / 8 * 0.1 / 4.0, 15 / 8 * 0.15 / 1.5
    assert reach(stop_time=5.0) == pytest.approx((0.05, 0.15, speeds[0]))
    assert reach(stop_time=5.75) == pytest.approx((0.05, 0.225, speeds[1]))
    assert reach(stop_time=8.0) == pytest.approx((0.05, 0.3, speeds[1]))
    assert reach(stop_time=8.0, start_time=4.5) == pytest.approx((0.15, 0.3, speeds[1]))
    assert reach(stop_time=8.0, start_time=6.6) == pytest.approx((0.3, 0.3, 0.0), abs=1e-12)
    r = 0.25  # of the first move, which the run sees no more of
    assert reach(stop_time=1.0)[1] == pytest.approx(0.05 + 0.1 * (10 * r**3 - 15 * r**4 + 6 * r**5))
    short_actuator = ec.Actuator(**with_entries(screw__stroke="200 mm"))
    options = {"actuator": {"prototype": short_actuator}, "set": later}
    assert not ec.load("prototype", **options, stop_time=5.0).notes
    with pytest.raises(ec.CommandError, match="goes from 50 to 300 mm, outside the stroke"):
        ec.load("prototype", **options, stop_time=8.0)


def test_periodic_moves() -> None:
    scenario = ec.load("prototype", set={"prototype.reference.period": 5.0}, start_time=7.0, stop_time=7.5)
    actual = find_reference_range("prototype", scenario.system, scenario.options)
    assert actual is not None

    def get_position(t: float) -> float:
        r = t / 4.0
        return 0.05 + 0.1 * (10 * r**3 - 15 * r**4 + 6 * r**5)

    assert actual == pytest.approx((get_position(2.0), get_position(2.5), 15 / 8 * 0.1 / 4.0))


A_EQ = {"controller.model.A_eq": 0, "observer.model.A_eq": 0}
RATIO = {**A_EQ, "controller.model.alpha_RL": -1, "controller.model.B_eq": -1, "observer.model.B_eq": -1}
FOLLOWERS = {
    "motor.R_s": {"controller.model.R_s": 1},
    "motor.L_d": {"controller.model.L_d": 1},
    "motor.L_q": {"controller.model.L_q": 1},
    "motor.Phi_PM": {"controller.model.Phi_PM": 1, "observer.model.Phi_PM": 1},
    "motor.N_p": {"controller.model.N_p": 1, "observer.model.N_p": 1},
    "motor.B_m": {"controller.model.B_eq": 1, "observer.model.B_eq": 1},
    "motor.J_m": A_EQ,
    "screw.M_BS": A_EQ,
    "inverter.u_max": {"controller.limit.u_max": 1},
    "screw.v_max": {"controller.limit.v_max": 1},
    "screw.lead": RATIO,
    "gearbox.rho": RATIO,
}
"""What follows from a parameter of the plant, and as which power of it; 0 where it is none."""


def parameters(scenario: Any) -> dict[str, Any]:
    return {f"{c.name}.{name}": x for c in scenario.system.components for name, x in c.parameters.items()}


@pytest.mark.parametrize("parameter", FOLLOWERS)
def test_stale_parameters_are_reported_and_followed(parameter: str, fmu_folder: Path) -> None:
    before = parameters(ec.load("prototype"))
    name, scale = f"{PLANT}.{parameter}", 1.5
    changed = {name: scale * before[name]}
    (note,) = ec.load("prototype", set=changed).notes
    assert note.startswith(f"{name} changes, but prototype.") and "--follow-models" in note
    for follower in FOLLOWERS[parameter]:
        assert f"prototype.{follower}" in note
    assert note.count("prototype.controller.") + note.count("prototype.observer.") == len(
        FOLLOWERS[parameter]
    )

    if parameter == "screw.lead":  # the same value in another unit is not a change
        assert all(ec.load("prototype", set={name: text}).notes == () for text in (0.016, "16 mm", "1.6 cm"))

    followed = ec.load("prototype", set=changed, follow_models=True, fmus=fmu_folder)
    assert followed.notes == ()
    with followed.prepare() as simulation:
        after = parameters(simulation)
    differing = {n for n in after if after[n] != before.get(n)}
    assert differing == {name, *(f"prototype.{follower}" for follower in FOLLOWERS[parameter])}
    for follower, power in FOLLOWERS[parameter].items():
        if power:
            expected = scale**power * before[f"prototype.{follower}"]
            assert after[f"prototype.{follower}"] == pytest.approx(expected, rel=1e-12)


def inertia(lead: float, m: float) -> float:
    """A_eq of the prototype by the paper's (6), with its coupling and gearbox without inertia."""
    alpha = 2 * math.pi / (PROTOTYPE.rho * lead)
    return alpha * PROTOTYPE.J_m + m / alpha


def test_followed_values_use_all_changes(fmu_folder: Path) -> None:
    """Values of the scenario and of a run; what is set by name stays as it is set, also in later runs."""
    name = "prototype.controller.model.A_eq"
    parameter = "prototype.observer.model.A_eq"
    set_ = {f"{PLANT}.screw.lead": "20 mm", parameter: 12.0}
    with ec.load("prototype", set=set_, follow_models=True, fmus=fmu_folder, stop_time=1e-3).prepare() as s:
        for case, mass in (({}, 100.0), ({f"{PLANT}.screw.M_BS": "200 kg"}, 200.0), ({}, 100.0)):
            result = s.run(set=case)
            assert result.parameters[name] == pytest.approx(inertia(0.02, mass), rel=1e-12)
            assert result.parameters[parameter] == 12.0
            assert result.notes == ()
        assert s.run(set={f"{PLANT}.screw.M_BS": 200.0, name: 7.0}).parameters[name] == 7.0
    with ec.load("prototype", fmus=fmu_folder, stop_time=1e-3).prepare() as s:
        assert s.run(set=set_).parameters[name] == pytest.approx(inertia(0.016, 100.0), rel=1e-12)


def test_both_halves_of_a_merged_plant_are_checked(fmu_folder: Path) -> None:
    """Lead and ratio are in both halves; either one is enough."""
    for name in ("lift.motor.screw.lead", "machine.plant.screw.lead[1]"):
        (note,) = ec.load("hdrm-merged", set={name: 0.03}).notes
        assert note.startswith(f"{name} changes, but lift.controller.model.alpha_RL")
        assert "tilt" not in note


LEAD = f"{PLANT}.screw.lead"
STALE = "prototype.plant.screw.lead changes, but prototype.controller.model.alpha_RL"


@pytest.mark.slow
@pytest.mark.usefixtures("on_one_cluster")
def test_every_command_gives_the_warning(emla: Emla, fmu_folder: Path) -> None:
    short_options = ("--stop-time", "0.002", "--no-plots", "--fmus", str(fmu_folder))
    set_ = ("--set", f"{LEAD}=20 mm")
    vary = ("--vary", "prototype.controller.beta[1]=90:110", "--objective", "prototype.torque_peak_N_m")
    tune = ("tune", "prototype", *vary, "--evaluations", "3", "--validation", "0")
    resistances = ("--vary", f"{PLANT}.motor.R_s=0.08,0.09")
    commands = {
        "run": ("run", "prototype", *set_, *short_options),
        "rerun": ("rerun", "run", *short_options),
        "sweep of another": ("sweep", "prototype", *resistances, *set_, *short_options),
        "sweep": ("sweep", "prototype", "--vary", f"{LEAD}=18 mm:20 mm:2", *short_options),
        "compare": ("compare", "prototype", "--controllers", "rsba,foc", *set_, *short_options),
        "tune": (*tune, *set_, *short_options),
    }
    for name, arguments in commands.items():
        completed = emla(*arguments, "--output", name)
        text = completed.stdout + completed.stderr
        expected = 1 if name == "tune" else 0  # too short for a joint to be held, which tunings require
        assert completed.exit_code == expected, text
        assert text.count(STALE) == 1, name
        completed = (
            emla(*arguments, "--follow-models", "--output", f"{name} too") if name != "rerun" else completed
        )
        assert completed.exit_code == expected, completed.output
        assert name == "rerun" or STALE not in completed.stdout + completed.stderr
    for file in ("sweep/sweep.json", "tune/tune.json"):
        (note, *_) = json.loads(Path(file).read_text())["notes"]
        assert note.startswith(STALE)


@pytest.mark.slow
@pytest.mark.usefixtures("on_one_cluster")
def test_sweep_checks_loads_and_strokes_of_its_variants(fmu_folder: Path) -> None:
    """The plan alone has no note; with its largest load or its longest way, a run would have one."""
    case: dict[str, Any] = {
        "actuator": {"prototype": FILE}, "set": loads(0.0, 0.0, 1e9), "fmus": fmu_folder, "workers": 1,
        "stop_time": 0.002, "metrics": ["peak = max(prototype.plant.i_q)"],
    }  # fmt: skip
    level = f"{LOAD}.level[1]"
    (note,) = ec.sweep("prototype", {level: "1 kN:90 kN:2"}, **case).notes
    assert "a load of 9e+04 N" in note and "the motor cannot hold it" in note
    assert ec.sweep("prototype", {level: "1 kN:2 kN:2"}, **case).notes == []
    start = f"{PLANT}.start.x_L"
    (note, *_) = ec.sweep("prototype", {start: "46 mm:900 mm:2"}, **case).notes
    assert note.startswith("some variants cannot run: prototype starts at 900 mm")


@pytest.mark.slow
@pytest.mark.usefixtures("on_one_cluster")
def test_sweep_with_followed_models_equals_single_runs(fmu_folder: Path) -> None:
    """Two sources of a model parameter vary, one source and one model parameter are set."""
    set_ = {f"{PLANT}.motor.J_m": 0.007, "prototype.observer.model.B_eq": 5.5}
    options: dict[str, Any] = {"follow_models": True, "stop_time": 0.01, "fmus": fmu_folder}
    vary = {LEAD: "15 mm:20 mm:2", f"{PLANT}.screw.M_BS": [90.0, 120.0]}
    result = ec.sweep("prototype", vary, set=set_, workers=1, **options)
    assert result.notes == []
    for row in result.variants.to_dicts():
        values_ = {name: row[name] for name in vary}
        with ec.load("prototype", set={**set_, **values_}, **options).prepare() as simulation:
            run = simulation.run()
        assert row["prototype.torque_peak_N_m"] == run.metrics["joints"]["prototype"]["torque_peak_N_m"]
        assert run.parameters["prototype.observer.model.B_eq"] == 5.5
        command = result.command(row["variant"])
        assert command is not None and "--follow-models" in command and f"--set {LEAD}=" in command
