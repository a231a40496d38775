"""What sizing needs: a life with a unit, and a whole run."""

from dataclasses import replace
from pathlib import Path

import pytest

import emla_cosim as ec
from emla_cosim.base.errors import RunError
from emla_cosim.run.simulation import Simulation
from tests.support.commands import Emla, sentence


@pytest.mark.parametrize("life", ["20000", "2e4"])
def test_a_life_needs_a_unit(life: str, emla: Emla) -> None:
    message = sentence(emla("size", "prototype", "--life", life), 2)
    assert message == f"Error: --life {life} has no unit; write '{life} h' or '{life} s'."


def test_a_temperature_needs_a_unit(emla: Emla) -> None:
    message = sentence(emla("size", "prototype", "--ambient", "40"), 2)
    assert message == "Error: --ambient 40 has no unit; write '40 degC' or '40 degF' or '40 K'."


def test_a_run_that_an_fmu_ends_is_not_sized(fmu_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last rows would count as the whole cycle."""
    run, reason = Simulation.run, "the run ended at t = 0.2 s: it asked to end the simulation."
    monkeypatch.setattr(Simulation, "run", lambda self, **more: replace(run(self, **more), early_end=reason))
    with pytest.raises(RunError, match=r"ended at t = 0\.2 s.*, but emla size needs the whole run\."):
        ec.size("prototype", cycle=0.2, lead_in=0.1, stop_time=0.4, fmus=fmu_folder)
