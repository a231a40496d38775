"""Losses and temperatures of a sizing equal those of runs, of hand calculations and of plain integration."""

import json
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.analyses.size import motor
from emla_cosim.analyses.size.cycle import find_plant
from emla_cosim.analyses.size.motor import Winding
from emla_cosim.analyses.size.pictures import draw_motor
from emla_cosim.study.joints.schema import load_joint
from tests.support.commands import Emla


@pytest.fixture(scope="module")
def size(fmu_folder: Path) -> Callable[..., ec.SizeResult]:
    return partial(ec.size, fmus=fmu_folder, plots=False)


def rms(time: np.ndarray, values: np.ndarray) -> float:
    return math.sqrt(np.trapezoid(values**2, time) / (time[-1] - time[0]))


def shuttle(joint: str, way: float, directional: bool, **plant: float) -> dict[str, Any]:
    """Start values of a joint that moves a way in m out and back without rest: the load drives half the time.

    There is no disturbance.
    """
    start = load_joint(joint).start.x_L
    return {
        f"{joint}.reference.period": 1.0,
        f"{joint}.reference.move.start": [0.0, 0.5, *[2.0] * 6],
        f"{joint}.reference.move.duration": [0.5] * 8,
        f"{joint}.reference.waypoint": [start, start + way, *[start] * 7],
        f"{joint}.plant.gearbox.directional": directional,
        **{f"{joint}.disturbance.d_2.{part}": 0.0 for part in ("amplitude[*]", "arctan", "low", "high")},
        **{f"{joint}.plant.{name}": value for name, value in plant.items()},
    }


# ---- Losses ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("joint", ["lift", "tilt", "telescope"])
@pytest.mark.parametrize("values", [{}, {"gearbox.directional": True, "friction.F_C": 200.0}])
def test_run_and_size_agree(
    joint: str, values: dict[str, Any], size: Callable[..., ec.SizeResult], fmu_folder: Path
) -> None:
    """The torque of the run, with whatever losses its plant has, is that of the sizing."""
    options: dict[str, Any] = {"set": {f"{joint}.plant.{name}": x for name, x in values.items()}}
    figures = size(joint, lead_in=0.0, stop_time=1.5, **options)[joint].figures
    options |= {"stop_time": 1.5, "output_interval": 1e-4, "fmus": fmu_folder}
    run = ec.load(joint, **options).prepare().run()
    torque, power = run[f"{joint}.plant.tau_m"], run[f"{joint}.plant.P_el"]
    assert figures.torque_rms_N_m == pytest.approx(rms(run.time, torque), rel=1e-9)
    assert figures.torque_peak_N_m == pytest.approx(np.abs(torque).max(), rel=1e-9)
    assert figures.electrical_power_peak_W == pytest.approx(power.max(), rel=1e-9)
    assert figures.energy_in_J == pytest.approx(np.trapezoid(np.maximum(power, 0.0), run.time), rel=1e-9)


@pytest.mark.parametrize("directional", [False, True])
@pytest.mark.parametrize(
    ("joint", "way", "plant"),
    [
        ("lift", 0.01, {}),
        ("telescope", -0.03, {"friction.F_C": 150.0, "friction.F_S": 150.0}),
        ("tilt", 0.01, {"gearbox.eta_GB": 0.75, "gearbox.eta_back": 0.6}),
    ],
)
def test_torque_equals_that_of_ideal_tracking(
    joint: str, way: float, plant: dict[str, float], directional: bool, size: Callable[..., ec.SizeResult]
) -> None:
    """The law is written here once more: torque of load, losses by direction, inertia and friction."""
    sizing = size(joint, stop_time=1.0, set=shuttle(joint, way, directional, **plant))[joint]
    assert sizing.reason is None
    p = load_joint(joint).actuator.emla
    efficiency, back = plant.get("gearbox.eta_GB", p.eta_GB), plant.get("gearbox.eta_back", 0.0)
    s = np.linspace(0.0, 1.0, 5001)
    v = way / 0.5 * (30.0 * s**2 - 60.0 * s**3 + 30.0 * s**4)
    a = way / 0.25 * (60.0 * s - 180.0 * s**2 + 120.0 * s**3)
    v, a = np.concatenate([v, -v]), np.concatenate([a, -a])
    load = float(sizing.cycle.load[0])
    alpha = 2.0 * math.pi / (p.rho * p.lead)
    driven = (back or 2.0 - 1.0 / efficiency) if directional else 1.0 / efficiency
    lossy = np.where(load * v > 0.0, 1.0 / efficiency, driven)
    torque = load * lossy / alpha + np.sign(v) * plant.get("friction.F_C", 0.0) / alpha
    torque += (alpha * (p.J_m + p.J_c + p.J_GB) + p.M_BS / alpha) * a + (alpha * p.B_m + p.B_BS / alpha) * v
    time = np.linspace(0.0, 1.0, len(v))
    assert (load * v < 0.0).any() and (load * v > 0.0).any()
    assert sizing.figures.torque_rms_N_m == pytest.approx(rms(time, torque), rel=1e-3)
    assert rms(sizing.cycle.time, sizing.cycle.required) == pytest.approx(rms(time, torque), rel=1e-3)
    assert sizing.figures.required_torque_peak_N_m == pytest.approx(np.abs(torque).max(), rel=2e-3)


@pytest.mark.parametrize("joint", ["lift", "telescope"])
def test_effect_of_the_other_losses_equals_their_run(joint: str, size: Callable[..., ec.SizeResult]) -> None:
    symmetric = size(joint, stop_time=1.0, set=shuttle(joint, 0.02, False))[joint].losses
    directional = size(joint, stop_time=1.0, set=shuttle(joint, 0.02, True))[joint].losses
    assert symmetric.other_torque_rms_N_m == pytest.approx(directional.torque_rms_N_m, rel=1e-3)
    assert directional.other_torque_rms_N_m == pytest.approx(symmetric.torque_rms_N_m, rel=1e-3)
    assert symmetric.setting == f"{joint}.plant.gearbox.directional=true"
    assert directional.setting == f"{joint}.plant.gearbox.directional=false"
    assert f"they {symmetric.other_convention}: rms torque" in symmetric.sentence
    assert symmetric.torque_rms_N_m > 1.02 * directional.torque_rms_N_m


def test_losses_without_an_alternative(size: Callable[..., ec.SizeResult]) -> None:
    lossless = {"telescope.plant.gearbox.eta_GB": 1.0}
    losses = size("telescope", stop_time=0.5, set=lossless)["telescope"].losses
    assert losses.other_torque_rms_N_m is None and "eta_GB is 1" in losses.sentence
    machine = size("hdrm-merged", stop_time=0.4, lead_in=0.0)["lift"].losses
    assert machine.setting is None and "if they oppose the motion" in machine.sentence


def test_required_torque_includes_the_disturbance(size: Callable[..., ec.SizeResult]) -> None:
    """A lift that cannot follow: figures are those of the plant's equation, with its disturbance."""
    wave = {"lift.disturbance.d_2.amplitude[1]": 1.0, "lift.disturbance.d_2.omega[1]": 2.0 * math.pi}
    broken = {"lift.plant.motor.i_max": 1.0}
    values = shuttle("lift", 0.01, False) | wave
    run = size("lift", stop_time=1.0, set=values)["lift"]
    tripped = size("lift", stop_time=1.0, set=values | broken)["lift"]
    assert tripped.required and not run.required
    for name, rel in (("torque_rms_N_m", 2e-3), ("electrical_power_peak_W", 0.02)):
        assert getattr(tripped.figures, name) == pytest.approx(getattr(run.figures, name), rel=rel)


def test_rigid_limit_of_a_compliant_plant() -> None:
    """The load's mass is part of the required torque."""
    sheet = load_joint("lift").actuator.emla
    plant = find_plant("lift", {"lift.plant.load.m": 500.0, "lift.plant.gearbox.eta_GB": 0.8}, sheet)
    assert plant.load_mass == 500.0 and plant.emla.eta_GB == 0.8
    zero, a = np.zeros(2), np.array([1.0, -2.0])
    torque = plant.required_torque(zero, zero, a, plant.load_mass * a, zero)
    alpha = 2.0 * math.pi / (sheet.rho * sheet.lead)
    assert torque == pytest.approx((alpha * sheet.J_m + sheet.M_BS / alpha + 500.0 / (0.8 * alpha)) * a)


def test_axial_force_of_a_compliant_plant_matches_its_transmission(
    size: Callable[..., ec.SizeResult], fmu_folder: Path
) -> None:
    cycle = size("study-compliant", lead_in=0.0, stop_time=0.4)["telescope"].cycle
    options: dict[str, Any] = {"stop_time": 0.4, "output_interval": 1e-4, "fmus": fmu_folder}
    run = ec.load("study-compliant", **options).prepare().run()
    force, a = run["telescope.plant.transmission.force"], run["telescope.plant.a_L"]
    assert cycle.force == pytest.approx(force + cycle.emla.M_BS * a)


# ---- Temperature -------------------------------------------------------------------------------------


def test_time_of_a_trip_in_closed_form() -> None:
    time = np.linspace(2.0, 12.0, 1001)
    steady = motor.repeat_cycle(time, np.full(1001, 1.79), 100.0, 180.0)
    expected = 180.0 * math.log(1.79 / (1.79 - 1.05))
    assert motor.time_until_rise(time, steady, 180.0, 105.0) == pytest.approx(expected, abs=0.01)
    assert motor.time_until_rise(time, steady, 180.0, 180.0) == math.inf


@pytest.mark.parametrize("threshold", [1.0, 60.0, 90.0, 113.0])
def test_time_of_a_trip_in_pulses(threshold: float) -> None:
    """Plain integration over many cycles, of pulses with rests."""
    time = np.linspace(0.0, 4.0, 4001)
    load = np.where(time < 1.0, 4.0, 0.1)
    rise = motor.repeat_cycle(time, load, 100.0, 20.0)
    x, t = 0.0, 0.0
    while x <= threshold:
        x += 1e-3 * (100.0 * (4.0 if t % 4.0 < 1.0 else 0.1) - x) / 20.0
        t += 1e-3
    assert motor.time_until_rise(time, rise, 20.0, threshold) == pytest.approx(t, abs=0.03)


def test_tilt_of_the_study_exceeds_its_temperature_limit(size: Callable[..., ec.SizeResult]) -> None:
    """Its plant has thermal data: 1.79 times its rated losses, and a trip after 158 s in a long run."""
    result = size("study-drive")
    tilt = result["tilt"]
    assert not tilt.holds and tilt.limits[0].name == "winding temperature rise"
    assert tilt.limits[0].fraction == pytest.approx(1.79, abs=0.01)
    assert tilt.limits[0].source == "tilt.plant.motor.permitted_rise"
    assert tilt.figures.trip_time_s == pytest.approx(158.0, abs=2.0)
    assert any("trips after 159" in remark for remark in tilt.remarks)
    for joint in ("lift", "telescope"):
        assert result[joint].figures.trip_time_s == math.inf
        assert "winding temperature rise" in [limit.name for limit in result[joint].limits]


def test_trip_in_the_run_is_reported_as_a_limit(size: Callable[..., ec.SizeResult], fmu_folder: Path) -> None:
    """With a short time constant the joint trips in the run; its figures are still those of the run."""
    values = shuttle("telescope", -0.03, True) | {
        "telescope.plant.motor.i_N": 3.0,
        "telescope.plant.motor.tau_th": 2.0,
        "telescope.plant.motor.permitted_rise": 80.0,
    }
    options: dict[str, Any] = {"set": values, "criteria": {"telescope.over_temperature": 0.2}}
    joint = size("telescope", stop_time=6.0, **options)["telescope"]
    assert joint.holds is False and not joint.required and joint.reason is None
    run = ec.load("telescope", stop_time=6.0, fmus=fmu_folder, **options).prepare().run()
    trip = run.metrics["joints"]["telescope"]["trip"]
    assert trip["what"] == "winding temperature" and trip["threshold"] == pytest.approx(96.0)
    assert joint.figures.trip_time_s == pytest.approx(trip["time_s"], rel=0.02)


def test_missing_thermal_data_are_named(emla: Emla) -> None:
    run = ("size", "telescope", "--stop-time", "0.4", "--lead-in", "0", "--no-plots", "--output", "out")
    result = emla(*run, "--report")
    record = json.loads(Path("out/size.json").read_text())["candidates"][0]["joints"]["telescope"]
    missing = {entry["name"]: entry["missing"] for entry in record["not_examined"]}["winding temperature"]
    for name in ("[thermal] in the data sheet", "telescope.plant.motor.i_N", "telescope.plant.motor.tau_th"):
        assert name in missing
    assert "[thermal]" in result.stdout and record["winding"] is None
    sentence = "the losses of gearbox and screw divide the load by the efficiency in both directions"
    assert f"telescope: {sentence}" in " ".join(result.stdout.split())
    assert sentence in Path("out/size.html").read_text(encoding="utf-8")
    assert record["losses"]["torque_rms_N_m"] == record["figures"]["torque_rms_N_m"]
    emla(*run, "--set", "telescope.plant.motor.i_N=5.5 A")
    record = json.loads(Path("out/size.json").read_text())["candidates"][0]["joints"]["telescope"]
    assert record["winding"]["i_N"] == 5.5


def test_warm_resistance_adds_to_the_losses(size: Callable[..., ec.SizeResult]) -> None:
    base = shuttle("telescope", -0.03, True) | {"telescope.plant.motor.i_N": 5.0}
    cold = size("telescope", stop_time=1.0, set=base)["telescope"]
    warm = size("telescope", stop_time=1.0, set=base | {"telescope.plant.motor.alpha_R": 0.004})["telescope"]
    rise = cold.figures.temperature_rise_mean_K
    assert rise is not None and rise > 10.0
    grown = warm.figures.energy_motor_loss_J / cold.figures.energy_motor_loss_J
    assert grown == pytest.approx(1.0 + 0.004 * rise, rel=2e-3)
    assert warm.figures.voltage_peak_V > cold.figures.voltage_peak_V


def test_drawn_limits_are_the_judged_ones(size: Callable[..., ec.SizeResult]) -> None:
    sizing = size("study-drive", stop_time=0.5)["tilt"]
    torque, _, temperature, *_ = draw_motor({"": sizing}).axes
    examined, drawn = {limit.name: limit.limit for limit in sizing.limits}, dict[str, float]()
    for axes in (torque, temperature):
        labels = [text.get_text() for text in axes.get_legend().get_texts()]
        drawn |= {name: line.get_ydata()[0] for name, line in zip(labels, axes.lines, strict=True)}
    assert drawn["limit of the rms torque"] == pytest.approx(examined["rms torque"])
    assert drawn["permitted rise"] == examined["winding temperature rise"]
    assert isinstance(sizing.winding, Winding)
    assert drawn["trip"] == pytest.approx(1.05 * sizing.winding.permitted_rise)
    assert temperature.get_ylim()[1] > sizing.winding.trip_rise
