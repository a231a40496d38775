"""The joint that other tools run, our own master's run of it, and the comparison of both."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emla_cosim.fmu.models import fmu_path
from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.stepping.timing import CommunicationPoints, make_communication_points
from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from tests.support.simulated import simulated

STEP = 1e-4
"""Communication step in s: the study's. Tools count time in different ways, which differ in the last
digits; the FMUs count steps of one length, so that this does not matter."""

Array = NDArray[np.float64]


def build_study_joint() -> System:
    """The lift joint of the study with all its start values."""
    return load("lift").system


def moving_joint() -> System:
    """The same, already moving and near its reference, so that all initial values depend on each other.

    In the study itself the controller begins at its limits, whatever the observer tells it. Here the
    observer estimates the disturbance as well, and the supply sags for a while.
    """
    start = {
        "plant.start.x_L": 0.244 + 3.0e-6,
        "plant.v_L": 1e-3,
        "plant.i_q": 5.0,
        "plant.i_d": 2.0,
        "observer.start.x_hat": 0.244 + 3.5e-6,
        "observer.v_hat": 2e-3,
        "observer.use_model": True,
        "observer.use_measured_current": True,
        "observer.omega_d": 400.0,
        "disturbance.supply.depth": 0.1,
        "disturbance.supply.start": 0.01,
        "disturbance.supply.duration": 0.01,
    }
    return build_study_joint().with_parameters({f"lift.{name}": value for name, value in start.items()})


@dataclass(frozen=True)
class Case:
    """A system, the folder and the flavour of its FMUs, how many steps to run, and their length in s."""

    system: System
    folder: Path
    flavour: str
    steps: int
    step: float

    @property
    def times(self) -> CommunicationPoints:
        """The communication points of our master."""
        return make_communication_points(self.steps * self.step, self.step)

    @property
    def fmus(self) -> dict[str, Path]:
        """The FMU file of every component."""
        return {c.name: fmu_path(c.model, self.flavour, self.folder) for c in self.system.components}

    @property
    def signals(self) -> list[tuple[str, str]]:
        """Component and output of every connected signal."""
        return list(dict.fromkeys((c.source, c.output) for c in self.system.connections))


def our_run(case: Case, algorithm: str) -> Array:
    """Our master's run: a column per signal, a row per communication point, the initial one included."""
    with Assembly(case.system, case.fmus) as assembly:
        columns = [1 + assembly.network.names.index(f"{c}.{output}") for c, output in case.signals]
        return simulated(assembly.network, ALGORITHMS[algorithm](), case.times)[:, columns]


def differences(case: Case, values: Array, expected: Array) -> dict[str, float]:
    """Largest difference of every signal that is not the same bit for bit, per its largest value."""
    assert values.shape == expected.shape == (case.steps + 1, len(case.signals))
    assert np.isfinite(expected).all()
    same = (values.view("i8") == expected.view("i8")).all(axis=0)
    largest = np.abs(expected).max(axis=0)
    relative = np.abs(values - expected).max(axis=0) / np.where(largest > 0.0, largest, 1.0)
    names = [f"{c}.{output}" for c, output in case.signals]
    return {n: float(r) for n, r, s in zip(names, relative, same, strict=True) if not s}
