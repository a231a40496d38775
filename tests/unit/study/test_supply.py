"""The supply that joints share: wiring, energy balance, limits of the voltage, and messages."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.study.supply import SUPPLY, supply_components

DRIVES = ("lift.plant", "tilt.plant", "telescope.plant")
ENERGIES = (
    *("source.energy", "source.loss", "joint.drawn", "joint.returned"),
    *("chopper.energy", "link.stored", "link.u"),
)


def signals_of(scenario: ec.Scenario, fmus: Path, more: tuple[str, ...] = ()) -> tuple[dict[str, Any], Any]:
    names = ["time", *(f"{SUPPLY}.{name}" for name in ENERGIES), *more]
    with scenario.prepare(fmus=fmus, output_interval=1e-4) as simulation:
        result = simulation.run()
        signals = {name: np.asarray(values) for name, values in result.read(names).items()}
        return signals, result.metrics


def test_energy_is_balanced_and_is_that_of_the_plants(fmu_folder: Path) -> None:
    """Two actuators regenerate, and the third uses it."""
    powers = tuple(f"{drive}.P_el" for drive in DRIVES)
    signals, metrics = signals_of(ec.load("study-drive", supply=True, stop_time=0.6), fmu_folder, powers)
    source, loss, drawn, returned, burnt, stored, u = (signals[f"{SUPPLY}.{name}"] for name in ENERGIES)
    size = source[-1] + returned[-1]
    assert source + returned == pytest.approx(loss + drawn + burnt + stored, abs=1e-9 * size)
    capacitor = 0.5 * 2e-3 * (u**2 - u[0] ** 2)
    assert stored == pytest.approx(capacitor, abs=1e-9 * size)
    energy_of_plants = sum(np.trapezoid(signals[name], signals["time"]) for name in powers)
    assert drawn[-1] - returned[-1] == pytest.approx(float(energy_of_plants), abs=1e-2 * size)
    figures = metrics[SUPPLY][SUPPLY]
    assert figures["reused_energy_J"] == pytest.approx(returned[-1] - burnt[-1] - max(stored[-1], 0.0))
    assert 0.0 < figures["reused_energy_J"] < figures["regenerated_energy_J"]
    assert figures["lowest_voltage_V"] == u.min() and figures["highest_voltage_V"] == u.max()


def test_weak_supply_limits_the_inverters(fmu_folder: Path) -> None:
    """The voltage falls, each inverter has its share of it, and controllers measure it."""
    scenario = ec.load("lift", supply=True, stop_time=0.02, set={"supply.source.R": 20.0})
    names = ("lift.plant.inverter.u_available", "lift.plant.inverter.u_q", "lift.plant.inverter.u_d")
    signals, _ = signals_of(scenario, fmu_folder, names)
    u, available = signals[f"{SUPPLY}.link.u"], signals[names[0]]
    u_max = available.max()
    assert u.min() < 0.9 * u[0]
    expected = np.minimum(u / math.sqrt(3.0), u_max)
    assert available[2:] == pytest.approx(expected[1:-1], rel=2e-2)
    assert np.hypot(signals[names[1]], signals[names[2]]).max() <= u_max * (1.0 + 1e-9)


def test_sags_of_disturbances_are_kept(fmu_folder: Path) -> None:
    sag = {"lift.disturbance.supply.depth": 0.2, "lift.disturbance.supply.start": 0.005}
    scenario = ec.load("lift", supply=True, stop_time=0.01, set={**sag, "supply.source.R": 1e-3})
    name = "lift.plant.inverter.u_available"
    signals, _ = signals_of(scenario, fmu_folder, (name,))
    assert signals[name][-1] == pytest.approx(0.8 * signals[name][0], rel=1e-2)


def test_supply_changes_no_other_component() -> None:
    assert SUPPLY not in {c.name for c in ec.load("study-drive").system.components}
    shared, unshared = ec.load("study-drive", supply=True).system, ec.load("study-drive").system
    remaining = [c for c in shared.components if c.name != SUPPLY]
    assert [c.parameters for c in remaining] == [c.parameters for c in unshared.components]


@pytest.mark.parametrize("name", ["experiment-1", "hdrm-coupled", "hdrm-merged"])
def test_built_in_systems_share_a_supply(name: str) -> None:
    scenario = ec.load(name, supply=True)
    order = list(scenario.options.class_options.get("order") or ())
    assert not order or order[-1] == SUPPLY
    system = scenario.system
    inputs = {str(x) for x in system.into(SUPPLY)}
    drives = [x.target for x in system.out_of(SUPPLY)]
    assert {f"{drive}.P_el -> {SUPPLY}.joint.P_el[{i}]" for i, drive in enumerate(drives, 1)} <= inputs


def test_too_many_joints_and_another_voltage_are_reported() -> None:
    with pytest.raises(ec.CommandError, match="for 1 to 8 joints"):
        supply_components({f"joint_{i}.plant": 300.0 for i in range(9)}, {})
    changed = ec.load("lift", supply=True, set={"lift.plant.inverter.u_max": 300.0})
    assert any("supply.joint.u_max[1] is 445" in note for note in changed.notes)
