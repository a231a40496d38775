"""What sizing needs: quantities with units, and a whole run."""

from dataclasses import replace
from pathlib import Path

import pytest

import emla_cosim as ec
from emla_cosim.base.errors import RunError
from emla_cosim.run.simulation import Simulation
from tests.support.commands import Emla, sentence


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--life 20000", "--life 20000 has no unit; write '20000 h' or '20000 s'."),
        ("--ambient 40", "--ambient 40 has no unit; write '40 degC' or '40 degF' or '40 K'."),
        ("--vary load", "--vary load has no name or no values; write --vary NAME="),
    ],
)
def test_invalid_options_of_the_command(option: str, message: str, emla: Emla) -> None:
    assert sentence(emla("size", "prototype", *option.split()), 2).startswith(f"Error: {message}")


def test_a_run_that_an_fmu_ends_is_not_sized(fmu_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last rows would count as the whole cycle."""
    run, reason = Simulation.run, "the run ended at t = 0.2 s: it asked to end the simulation."
    monkeypatch.setattr(Simulation, "run", lambda self, **more: replace(run(self, **more), early_end=reason))
    with pytest.raises(RunError, match=r"ended at t = 0\.2 s.*, but emla size needs the whole run\."):
        ec.size("prototype", cycle=0.2, lead_in=0.1, stop_time=0.4, fmus=fmu_folder)
