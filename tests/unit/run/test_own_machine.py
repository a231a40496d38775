"""A user's machine from three files: data sheet, measured load and measured motion."""

import json
from pathlib import Path

import numpy as np
import polars
import pytest
from scipy.interpolate import CubicSpline

from tests.support.commands import Emla
from tests.support.paths import ROOT

MACHINE = ROOT / "tests" / "own_machine"
JOINT = "prototype"


def test_load_and_motion_are_those_of_the_files(emla: Emla) -> None:
    result = emla("run", str(MACHINE / "machine.toml"), "--output", "out", "--no-plots")
    assert result.exit_code == 0, result.output
    table = polars.read_csv("out/results.csv")
    time = table["time"].to_numpy()

    load = polars.read_csv(MACHINE / "load.csv")
    forces = 1e3 * np.interp(time, load["t [s]"], load["Force [kN]"])
    assert table["input.prototype.disturbance.F_L"].to_numpy() == pytest.approx(forces, rel=1e-12)

    motion = polars.read_csv(MACHINE / "reference.csv", separator=";")
    spline = CubicSpline(motion["t [ms]"].cast(float) / 1e3, motion["position [mm]"] / 1e3)
    for order, name in enumerate(("x_d", "v_d", "a_d")):
        assert table[f"{JOINT}.reference.{name}"].to_numpy() == pytest.approx(spline(time, order), abs=1e-9)

    figures = json.loads(Path("out/metrics.json").read_text())["joints"][JOINT]
    assert figures["held"]
    errors = np.abs(table[f"{JOINT}.plant.x_L"].to_numpy() - spline(time))
    assert errors.max() <= 1.05 * max(figures["position_error_m"], errors[time < 0.3].max())
    assert figures["position_error_m"] < 1e-3 * np.ptp(spline(time))
