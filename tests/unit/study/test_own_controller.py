"""A user's controller takes values of the actuator, as a block and as an FMU."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
import fmublock
from emla_cosim.fmu.models import fmu_path
from emla_cosim.study.joint import _list_actuator_units
from emla_cosim.study.joints.schema import load_joint
from fmublock import Block, Input, Output, Parameter
from rsba_fmu import FocController, RsbaController
from tests.support.commands import Emla
from tests.support.paths import ROOT

ACTUATOR_VALUES = {"machine.Phi_PM": 0.12, "machine.i_max": load_joint("telescope").actuator.emla.i_max}


class OwnController(Block):
    """A controller whose attributes have names of the machine's values."""

    x_d = Input(unit="m", description="Reference position")
    x_hat = Input(unit="m", description="Estimated position")
    R_s = Parameter(9.0, unit="Ohm")
    A_eq = Parameter(7.0, unit="kg.m", name="model.A_eq")
    u_max = Parameter(300.0, unit="V", name="limit.u_max")
    Phi_PM = Parameter(0.5, unit="Wb", name="machine.Phi_PM")
    most = Parameter(1.0, unit="A", name="machine.i_max")
    u_q = Output(unit="V", description="q-axis voltage")
    u_d = Output(unit="V", description="d-axis voltage")

    def outputs(self, v: Any) -> dict[str, Any]:
        u_q = 1e4 * v.R_s * v.A_eq * v.Phi_PM * v.most * (v.x_d - v.x_hat) / v.u_max
        return {"u_q": u_q, "u_d": 0.0 * v.x_d}


class Odd(OwnController):
    """A controller that asks for what no actuator has."""

    colour = Parameter(1.0, name="machine.colour")


class WrongUnit(OwnController):
    """A controller that asks for a resistance in henry."""

    parameter_ = Parameter(1.0, unit="H", name="machine.R_s")


class Derived(FocController):
    """One of the project's controllers with a change."""


@pytest.fixture(scope="module")
def controller_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("mine") / "Mine.fmu"
    fmublock.build(OwnController, file)
    return file


def test_block_and_fmu_take_the_same_values(fmu_folder: Path, controller_file: Path) -> None:
    runs = {}
    for controller in (OwnController, str(controller_file)):
        scenario = ec.load("telescope", controller=controller, fmus=fmu_folder, stop_time=0.02)
        component = scenario.system.component("telescope.controller")
        assert component.parameters == pytest.approx(ACTUATOR_VALUES)
        assert "machine.Phi_PM = 0.12 Wb" in component.note
        with scenario.prepare() as simulation:
            runs[controller] = simulation.run()
    ours, fmu_run = runs.values()
    volts = ours["telescope.controller.u_q"]
    np.testing.assert_array_equal(volts, fmu_run["telescope.controller.u_q"])
    error = ours["telescope.reference.x_d"] - ours["telescope.observer.x_hat"]
    factor = 1e4 * 9.0 * 7.0 * 0.12 * ACTUATOR_VALUES["machine.i_max"] / 300.0
    assert np.abs(volts).max() > 0.0
    np.testing.assert_allclose(volts[0], factor * error[0], rtol=1e-12)


def test_gains_override_values_of_the_actuator(monkeypatch: pytest.MonkeyPatch) -> None:
    sets = {"own": ec.Gains("robust", {"telescope": {"most": 2.0, "R_s": 3.0}})}
    monkeypatch.setitem(ec.CONTROLLERS, "mine", ec.Controller(OwnController, sets))
    values = ec.load("telescope", controller="mine").system.component("telescope.controller").parameters
    assert values["machine.i_max"] == 2.0 and values["R_s"] == 3.0


@pytest.mark.parametrize(
    ("block", "sentence"),
    [
        (Odd, r"no value for telescope\.controller\.machine\.colour; it has machine\.i_max, "),
        (WrongUnit, r"machine\.R_s takes its value from the actuator and has the units Ohm and H"),
    ],
)
def test_unknown_values_of_the_actuator_are_refused(block: type[Block], sentence: str) -> None:
    with pytest.raises(ec.CommandError, match=sentence):
        ec.load("telescope", controller=block)


def test_derived_controllers_take_the_same_values(fmu_folder: Path) -> None:
    ours = ec.load("telescope", controller=FocController).system.component("telescope.controller")
    for controller in (Derived, str(fmu_path("FocController", "native", fmu_folder))):
        component = ec.load("telescope", controller=controller).system.component("telescope.controller")
        assert component.parameters == ours.parameters
        assert "model.Phi_PM = 0.12 Wb" in component.note
    assert not ours.note and issubclass(RsbaController, Block)


def test_documented_names_have_values() -> None:
    page = (ROOT / "docs/own-controller.md").read_text()
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    listed = {name.strip("` ") for row in rows for name in row.split(",")}
    assert set(_list_actuator_units()) <= listed


def test_command_lists_values_of_the_actuator(emla: Emla, controller_file: Path) -> None:
    completed = emla("run", "lift", "--controller", str(controller_file), "--stop-time", "1e-3", "--no-plots")
    assert completed.exit_code == 0, completed.output
    message = "lift.controller takes start values from the actuator: machine.Phi_PM = 0.15 Wb, machine.i_max"
    assert message in " ".join(completed.output.split())
