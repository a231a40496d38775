"""Loads along the stroke in joint files: entries, start at rest, remarks, sizes."""

from pathlib import Path

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.study.actuator.model_parameters import follow_plant_changes
from emla_cosim.study.actuator.remarks import find_largest_load
from emla_cosim.study.joints.schema import read_joint_text

TILT = read_joint_text("tilt")
POINTS = 'position = ["0.36 m", "0.40 m", "0.46 m"]\nforce = ["30 kN", "25 kN", "20 kN"]'


def joint(folder: Path, load: str) -> Path:
    """Write the tilt with another table [load]."""
    before, _, rest = TILT.partition("[load]\n")
    file = folder / "boom.toml"
    disturbance = rest.partition("[disturbance.d_2]")[2]
    file.write_text(f"{before}[load]\n{load}\n\n[disturbance.d_2]{disturbance}")
    return file


def plant(scenario: ec.Scenario) -> dict[str, float]:
    component = next(c for c in scenario.system.components if c.name == "boom.plant")
    return dict(component.parameters)  # type: ignore[arg-type]


def test_force_along_the_stroke_is_added_to_the_load_over_time(tmp_path: Path) -> None:
    file = joint(tmp_path, f'level = ["1 kN", "2 kN"]\nstart = "0.1 s"\nramp = "1 ms"\n{POINTS}')
    with ec.load(file, stop_time=0.2).prepare() as simulation:
        signals = simulation.run().read(["time", "boom.plant.x_L", "boom.plant.load.force"])
    along = np.interp(signals["boom.plant.x_L"], [0.36, 0.40, 0.46], [30e3, 25e3, 20e3])
    over_time = np.where(np.asarray(signals["time"]) < 0.1005, 1e3, 2e3)
    settled = np.abs(np.asarray(signals["time"]) - 0.1005) > 1e-3
    force = np.asarray(signals["boom.plant.load.force"])
    assert force[settled] == pytest.approx((along + over_time)[settled], rel=1e-9)


def test_file_of_a_data_sheet(tmp_path: Path) -> None:
    (tmp_path / "lever.csv").write_text("Stroke [mm],Force [kN]\n360,30\n400,25\n460,20\n")
    from_file = plant(ec.load(joint(tmp_path, 'file = "lever.csv"')))
    assert from_file == plant(ec.load(joint(tmp_path, POINTS)))
    assert from_file["load.table.position[1]"] == 0.36 and from_file["load.table.force[32]"] == 20e3


@pytest.mark.parametrize(
    ("load", "problem"),
    [
        ("position = [0.1, 0.2]", "position without force"),
        ("position = [0.1, 0.2]\nforce = [1.0, 2.0, 3.0]", "2 values of position and 3 of force"),
        ("position = [0.2, 0.1]\nforce = [1.0, 2.0]", "0.1 m after 0.2 m; positions must increase"),
        ("position = [0.2]\nforce = [1.0]", "1 points of force over position; it must have 2 to 32"),
        ("ripple = 3.0", "lacks level, the load force"),
        ('file = "lever.csv"\nposition = [0.1, 0.2]\nforce = [1.0, 2.0]', "both file and position"),
        ('interpolation = "cubic"\nlevel = 1.0', "must be 'held' or 'linear' or 'smooth'"),
    ],
)
def test_wrong_entries_are_named(load: str, problem: str, tmp_path: Path) -> None:
    (tmp_path / "lever.csv").write_text("x [mm],F [kN]\n1,30\n2,25\n")
    with pytest.raises(ec.CommandError) as caught:
        ec.load(joint(tmp_path, load))
    assert problem in str(caught.value) and "[load]" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("x [mm],F [kN],z\n1,30,1\n2,25,1\n", "has 3 columns; it must have two"),
        ("F [kN],x [mm]\n1,30\n2,25\n", "cannot be converted"),
        ("x [mm],F_kN\n1,30\n2,25\n", "ends like the unit 'kN'"),
        ("x [mm],F [kN]\n2,30\n1,25\n", "positions must increase"),
    ],
)
def test_wrong_files_are_named(text: str, problem: str, tmp_path: Path) -> None:
    (tmp_path / "lever.csv").write_text(text)
    with pytest.raises(ec.CommandError, match=r"lever\.csv") as caught:
        ec.load(joint(tmp_path, 'file = "lever.csv"'))
    assert problem in str(caught.value)


def test_motion_beyond_the_table_is_reported(tmp_path: Path) -> None:
    file = joint(tmp_path, 'position = ["380 mm", "430 mm"]\nforce = ["30 kN", "20 kN"]')
    (note,) = ec.load(file).notes
    assert "known from 380 to 430 mm, but the reference goes from 389 to 442 mm" in note
    assert not ec.load(joint(tmp_path, POINTS)).notes


def test_largest_load_counts_the_stroke_that_the_motion_uses(tmp_path: Path) -> None:
    scenario = ec.load(joint(tmp_path, f'level = "1 kN"\n{POINTS}'))
    expected = 1e3 + np.interp(0.389, [0.36, 0.40], [30e3, 25e3])
    assert find_largest_load("boom", scenario.system, scenario.options) == pytest.approx(expected)


def test_load_that_is_not_rigid_rests_at_the_start(tmp_path: Path) -> None:
    """Its force is that at its own position, which the deflection changes; also with another stiffness."""
    points = 'position = ["0.38 m", "0.39 m"]\nforce = ["30 kN", "-200 kN"]'
    file = joint(tmp_path, f'level = "1 kN"\n{points}')
    file.write_text(file.read_text().replace("[compliance]", "[compliance]\nalways = true"))
    scenario = ec.load(file)
    values = plant(scenario)
    model = next(c.model for c in scenario.system.components if c.name == "boom.plant")
    assert model == "EmlaCompliantAxis"
    k, half = values["transmission.stiffness"], 0.5 * values["transmission.backlash"]
    deflection = values["start.deflection"]
    force = 1e3 + np.interp(values["start.x_L"] - deflection, [0.38, 0.39], [30e3, -200e3])
    assert abs(force) > 5e3
    assert k * (abs(deflection) - half) == pytest.approx(abs(force), rel=1e-9)
    command = next(c for c in scenario.system.components if c.name == "boom.command")
    assert command.parameters["F_hat"] == pytest.approx(force)
    harder = ec.load(file, set={"boom.disturbance.load.level[1]": 2e3})
    followed = follow_plant_changes(harder.system, harder.options)
    assert followed["boom.command.F_hat"] == pytest.approx(force + 1e3)
