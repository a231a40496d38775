"""A user's machine from three files: data sheet, measured load and measured motion."""

import json
import shutil
from pathlib import Path

import numpy as np
import polars
import pytest
from scipy.interpolate import CubicSpline

from tests.support.commands import Emla
from tests.support.paths import ROOT

FILES = ROOT / "tests" / "own_machine"
JOINT = "prototype"


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    return shutil.copytree(FILES, tmp_path / "machine")


def parameters(output: Path) -> dict[str, dict[str, float]]:
    """Start values by component."""
    components = json.loads((output / "run.json").read_text())["components"]
    return {name: component["parameters"] for name, component in components.items()}


def test_load_and_motion_are_those_of_the_files(emla: Emla, machine: Path) -> None:
    done = emla("run", str(machine / "machine.toml"), "--output", "out", "--no-plots")
    assert done.exit_code == 0, done.output
    table = polars.read_csv("out/results.csv")
    time = table["time"].to_numpy()

    load = polars.read_csv(machine / "load.csv")
    forces = 1e3 * np.interp(time, load["t [s]"], load["Force [kN]"])
    assert table["input.prototype.disturbance.F_L"].to_numpy() == pytest.approx(forces, rel=1e-12)

    motion = polars.read_csv(machine / "reference.csv", separator=";")
    spline = CubicSpline(motion["t [ms]"].cast(float) / 1e3, motion["position [mm]"] / 1e3)
    for order, name in enumerate(("x_d", "v_d", "a_d")):
        assert table[f"{JOINT}.reference.{name}"].to_numpy() == pytest.approx(spline(time, order), abs=1e-9)

    figures = json.loads(Path("out/metrics.json").read_text())["joints"][JOINT]
    assert figures["held"]
    errors = np.abs(table[f"{JOINT}.plant.x_L"].to_numpy() - spline(time))
    assert errors.max() <= 1.05 * max(figures["position_error_m"], errors[time < 0.3].max())
    assert figures["position_error_m"] < 1e-3 * np.ptp(spline(time))


def test_sheet_changes_plant_observer_and_controller(emla: Emla, machine: Path) -> None:
    short = ("run", str(machine / "machine.toml"), "--no-plots", "--stop-time", "0.01")
    assert emla(*short, "--output", "before").exit_code == 0
    sheet = machine / "actuator.toml"
    sheet.write_text(sheet.read_text().replace('lead = "10 mm"', 'lead = "8 mm"'))
    assert emla(*short, "--output", "after").exit_code == 0
    before, after = parameters(Path("before")), parameters(Path("after"))
    alpha, wider = (2.0 * np.pi * 5.0 / lead for lead in (0.010, 0.008))  # of the gearbox 5:1
    inertia, mass = (9.60209 + 0.8 + 3.2 / 5.0**2) * 1e-4, 60.0  # of the screw as the motor feels it
    for component in ("observer", "controller"):
        for values, per_travel in ((before, alpha), (after, wider)):
            A_eq = per_travel * (inertia + mass / per_travel**2)
            assert values[f"{JOINT}.{component}"]["model.A_eq"] == pytest.approx(A_eq, rel=1e-9)
    for values, lead in ((before, 0.010), (after, 0.008)):
        plant = values[f"{JOINT}.plant"]
        assert plant["screw.lead"] == pytest.approx(lead, rel=1e-12)
        assert plant["screw.v_max"] == pytest.approx(3500.0 / 60.0 / 5.0 * lead, rel=1e-12)
