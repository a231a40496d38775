"""Masses of machines are estimated from strokes, speeds, accelerations and forces with noise."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.study.machines.schema import load_machine
from fmublock import build
from machine_fmu import load_block
from machine_fmu.naming import name_numbers
from tests.support.pinocchio_machine import PinocchioMachine
from tests.support.toy_fmu import PRODUCER

NOISE, STEP, STOP = 40.0, 0.04, 8.0
"""Standard deviation of measured forces in N, sample time and length of a record in s."""

Data = dict[str, Any]


@cache
def load_fmu(name: str, folder: Path) -> str:
    """Return the FMU of a machine's load block."""
    path = folder / f"{name}.fmu"
    build(load_block(load_machine(name), "Load"), path, producer=PRODUCER)
    return str(path)


def motion(name: str) -> Data:
    """Return two tones for each actuator, over four fifths of its stroke, as columns of the load's inputs."""
    t = np.arange(0.0, STOP + 0.5 * STEP, STEP)
    data: Data = {"time": t}
    machine = load_machine(name)
    for i, actuator in enumerate(machine.actuators.values()):
        low, high = (machine.parameters[x].value if isinstance(x, str) else x for x in actuator.stroke)
        columns = [np.full_like(t, 0.5 * (low + high)), np.zeros_like(t), np.zeros_like(t)]
        for w, share in ((0.7 + 0.3 * i, 0.3), (2.3 - 0.3 * i, 0.1)):
            A = share * (high - low)
            columns[0] += A * np.sin(w * t)
            columns[1] += A * w * np.cos(w * t)
            columns[2] -= A * w * w * np.sin(w * t)
        data |= {f"{v}[{i + 1}]": x for v, x in zip(("x_L", "v_L", "a_L"), columns, strict=True)}
    return data


def inputs(data: Data) -> list[ec.Input]:
    """Return the motion as inputs of the load."""
    signals = {f"Load.{name}": ec.Column(name) for name in data if name[:3] in ("x_L", "v_L", "a_L")}
    return [ec.Input(data=data, signals=signals)]


def estimate(fmu: str, data: Data, vary: Mapping[str, str]) -> ec.IdentificationResult:
    """Estimate parameters of the load from a record of motion and forces."""
    forces = {f"Load.{name}": ec.Column(name) for name in data if name.startswith("F_L")}
    measured = {name: x for name, x in data.items() if name == "time" or name.startswith("F_L")}
    return ec.identify(
        fmu,
        {f"Load.{name}": span for name, span in vary.items()},
        measured=[ec.Input(data=measured, signals=forces)],
        input=inputs(data),
        sigma=dict.fromkeys(forces, NOISE),
        step_size=STEP,
        stop_time=STOP,
        workers=1,
    )


def with_noise(forces: np.ndarray) -> Data:
    """Return measured forces, one column for each actuator."""
    measured = forces + NOISE * np.random.default_rng(2).standard_normal(forces.shape)
    return {f"F_L[{i + 1}]": x for i, x in enumerate(measured.T)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("loads")


@pytest.fixture(scope="module")
def manipulator() -> Data:
    """A record of the paper's manipulator with other masses, from its tree in Pinocchio."""
    machine = name_numbers(load_machine("hdrm"))
    changed = {"lift_boom.m": 190.0, "outer_boom.m": 100.0, "inner_boom.m": 70.0}
    parameters = {
        name: replace(p, value=changed.get(name, p.value)) for name, p in machine.parameters.items()
    }
    oracle = PinocchioMachine(replace(machine, parameters=parameters))
    data = motion("hdrm")
    q, v, a = (np.array([data[f"{x}_L[{i}]"] for i in (1, 2, 3)]).T for x in "xva")
    return data | with_noise(np.array([oracle.forces(*row) for row in zip(q, v, a, strict=True)]))


def test_masses_of_the_manipulator(folder: Path, manipulator: Data) -> None:
    fmu = load_fmu("hdrm", folder)
    vary = {
        "lift_boom.m": "50:400",
        "outer_boom.m": "30:300",
        "inner_boom.m": "10:200",
        "payload.m": "200:800",
    }
    result = estimate(fmu, manipulator, vary)
    truth = {"lift_boom.m": 190.0, "outer_boom.m": 100.0, "inner_boom.m": 70.0, "payload.m": 470.0}
    for name, value in truth.items():
        estimate_ = result[f"Load.{name}"]
        assert estimate_.problem is None and estimate_.interval is not None
        assert estimate_.interval[0] < value < estimate_.interval[1]
        assert estimate_.interval[1] - estimate_.interval[0] < 0.25 * value


@pytest.mark.slow
def test_indistinguishable_masses_are_reported(folder: Path, manipulator: Data) -> None:
    """The lift boom turns about a fixed axis: only the product with its centre, and its inertia, count."""
    fmu = load_fmu("hdrm", folder)
    result = estimate(
        fmu, manipulator, {"lift_boom.m": "150:250", "lift_boom.c": "0.6:1.1", "lift_boom.J": "20:80"}
    )
    for name in ("m", "c", "J"):
        assert "combination" in str(result[f"Load.lift_boom.{name}"].problem)


@pytest.mark.slow
def test_masses_of_a_crane_whose_load_swings(folder: Path) -> None:
    """The record has the hook's motion in its forces; the estimate needs its angle at the start."""
    fmu, data = load_fmu("crane", folder), motion("crane")
    truth = {"boom.m": 160.0, "jib.m": 90.0, "payload.m": 230.0, "start.passive.q[1]": -1.4}
    run = ec.load(
        fmu,
        input=inputs(data),
        set={f"Load.{name}": value for name, value in truth.items()},
        step_size=STEP,
        stop_time=STOP,
        output_interval=STEP,
    )
    result = run.prepare().run()
    assert np.allclose(result.time, data["time"])
    data |= with_noise(np.array([result[f"Load.F_L[{i}]"] for i in (1, 2, 3)]).T)
    vary = {"boom.m": "50:400", "jib.m": "30:300", "payload.m": "50:500", "start.passive.q[1]": "-2:-1"}
    identified = estimate(fmu, data, vary)
    for name, value in truth.items():
        estimate_ = identified[f"Load.{name}"]
        assert estimate_.problem is None and estimate_.interval is not None
        assert estimate_.interval[0] < value < estimate_.interval[1]
