"""Ecos runs the joint as our master does with Jacobi.

It exchanges values in initialization mode until they have gone all the way round, and once more after
it. In a step all FMUs step, then all outputs are read and passed on; what it returns at a time are the
outputs at that time. Time is summed up step by step; the FMUs count steps, so that its rounding
does not matter.
"""

from pathlib import Path

import numpy as np
import pytest
from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure

from emla_cosim.fmu.models import build
from tests.support.joint_run import STEP, Array, Case, differences, our_run, study_joint


def ecos_run(case: Case) -> Array:
    # Ecos names variables component::variable
    start = {f"{c.name}::{n}": v for c in case.system.components for n, v in c.parameters.items()}
    with EcosSimulationStructure() as structure:
        for name, path in case.fmus.items():
            structure.add_model(name, path)
        for x in case.system.connections:
            structure.make_real_connection(f"{x.source}::{x.output}", f"{x.target}::{x.input}")
        structure.add_parameter_set("joint", start)
        with EcosSimulation(case.step, structure=structure) as simulation:
            assert simulation.init(parameter_set="joint")
            rows = []
            for k in range(case.steps + 1):
                if k > 0:
                    simulation.step()
                rows.append([simulation.get_real(f"{c}::{output}") for c, output in case.signals])
            simulation.terminate()
    return np.array(rows)


def test_closed_loop_is_bit_for_bit_that_of_our_master(case: Case) -> None:
    assert differences(case, ecos_run(case), our_run(case, "jacobi")) == {}


def test_it_complains_of_nothing(case: Case, capfd: pytest.CaptureFixture[str]) -> None:
    EcosLib.set_log_level("warn")
    ecos_run(case)
    assert "".join(capfd.readouterr()) == ""


_SAID_OF_ANY_FMU = ('Function "fmi3GetVersion" is not provided by this FMU.',)
"""What Ecos 0.7.2 also says of the Reference FMUs, although they have this function."""


class Mixed(Case):
    """FMUs of FMI 3.0 in `newer`, where a component needs no arrays: Ecos knows only scalars."""

    newer: Path

    @property
    def fmus(self) -> dict[str, Path]:
        arrays = {c.name for c in self.system.components if any("[" in name for name in c.parameters)}
        third = {c.name: c.model for c in self.system.components if c.name not in arrays}
        made = {name: build(model, "native", [], self.newer, fmi=3) for name, model in third.items()}
        return {**super().fmus, **made}


def test_fmus_of_fmi_3_beside_others_give_the_same_bits(
    fmu_folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    given = study_joint(), fmu_folder, "native", 300, STEP
    mixed = Mixed(*given)
    mixed.newer = tmp_path
    assert len(mixed.fmus) == 5 and len(list(tmp_path.rglob("*.fmu"))) == 2  # plant and observer
    EcosLib.set_log_level("warn")
    assert differences(mixed, ecos_run(mixed), our_run(Case(*given), "jacobi")) == {}
    said = {line for line in "".join(capfd.readouterr()).splitlines() if line}
    assert said <= {"Loading FMI version 3...", *_SAID_OF_ANY_FMU}
