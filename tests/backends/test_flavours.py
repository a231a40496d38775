"""Every block of ours gives the same bits natively, through PythonFMU and in process."""

import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.fmu.models import FLAVOURS, MODELS, build, fmu_path
from emla_cosim.study.joint import start_values
from fmublock.platforms import host_platform
from hdrm_fmu.spline import Spline, trajectory_parameters
from tests.support import joint_data
from tests.support.joint_data import ROBUST, TILT, gains_of, observers
from tests.support.slaves import BlockSlave, fmu_slave, interface
from tests.support.tiers import mostly_slow

STEP = 1e-4

COMPARED = {
    "x_hat": 1e-3, "v_hat": 0.05, "d_hat": 1, "i_q": 20, "i_d": 5, "u_available": 400,
    "x_d": 1e-3, "v_d": 0.05, "a_d": 0.3,
}  # fmt: skip
"""Scales of the inputs of the controllers that RSBA is compared with."""

CURVES = {
    "lift": [0.2, 0.3, 0.1, 0.25, 0.22, 0.4, 0.31, 0.28, 0.26, 0.24],
    "tilt": [0.4, 0.38, 0.45, 0.5, 0.42, 0.41, 0.35, 0.33, 0.4, 0.44],
    "telescope": [0.5, 0.6, 0.2, 0.3, 0.7, 0.8, 0.1, 0.4, 0.35, 0.36],
}
"""Coefficients of a spline."""

# start values that exercise every branch, and the scale of each input's random walk
DRIVES: dict[str, tuple[dict[str, Any], dict[str, float]]] = {
    "EmlaPlant": (
        start_values(
            MODELS["EmlaPlant"],
            TILT,
            asdict(joint_data.DRIVES["tilt"]),
            {"sigma": 1e-6, "resolution": 1e-7, "L_d": 3e-3, "F_2": 0.01, "F_3": 0.002, "F_4": 0.001},
        ),
        {"u_q": 300, "u_d": 200, "i_q_ref": 10, "F_L": 2e4, "d_2": 1, "d_3": 0.4, "d_4": 0.2}
        | {"supply.sag": 0.1},
    ),
    "EmlaCompliantPlant": (
        start_values(
            MODELS["EmlaCompliantPlant"],
            TILT,
            asdict(joint_data.DRIVES["tilt"]),
            {"sigma": 1e-6, "resolution": 1e-7, "F_2": 0.01, "F_3": 0.002, "F_4": 0.001, "m_load": 1.5e4},
            {"stiffness": 7e7, "damping": 4e4, "backlash": 1e-4, "tau_cog": 0.5, "alpha_R": 4e-3},
            {"eccentricity": 1e-4, "lead_error": 1e-4, "wobble": 4e-6},
        ),
        {"u_q": 300, "u_d": 200, "i_q_ref": 10, "F_L": 2e4, "d_2": 1, "d_3": 0.4, "d_4": 0.2}
        | {"supply.sag": 0.1},
    ),
    "EmlaMotor": (
        start_values(
            MODELS["EmlaMotor"],
            TILT,
            joint_data.DRIVES["tilt"],
            {"sigma": 1e-6, "resolution": 1e-7, "L_d": 3e-3, "F_3": 0.002, "F_4": 0.001},
        ),
        {"u_q": 300, "u_d": 200, "i_q_ref": 10, "x_L": 1e-3, "v_L": 0.05, "d_3": 0.4, "d_4": 0.2}
        | {"supply.sag": 0.1},
    ),
    "EmlaObserver": (
        start_values(MODELS["EmlaObserver"], TILT, observers("robust")["tilt"], {"use_model": True}),
        {"y": 1e-4, "i_q_ref": 10, "i_q": 10},
    ),
    "Reference": (
        {
            "waypoint[1]": 0.1, "waypoint[2]": 0.3, "waypoint[3]": 0.2,
            "move.duration[1]": 0.2, "move.start[2]": 0.25, "move.duration[2]": 0.1, "period": 0.4,
        },
        {},
    ),
    "Trajectory": (
        trajectory_parameters(Spline(4, [0.1] * 5 + [0.2, 0.25, 0.25, 0.5, 0.7] + [0.9] * 5, CURVES)),
        {},
    ),
    "Disturbance": (
        {
            "load.level[1]": 1e4, "load.level[2]": 3e4, "load.start[2]": 0.3, "load.ripple": 5e3,
            "d_2.amplitude[1]": 0.8, "d_2.omega[1]": 7.0, "d_2.high": 2.0,
            "d_2.arctan": 1.2, "d_2.decay": 3.0,
            "d_3.amplitude[1]": 0.42, "d_3.omega[1]": 8.0, "d_3.phase[1]": 1.0, "d_4.amplitude": -0.15,
        },
        {"v_L": 0.1},
    ),
    "RsbaController": (
        start_values(MODELS["RsbaController"], TILT, ROBUST["tilt"]),
        {"x_hat": 1e-3, "v_hat": 0.05, "i_q": 20, "i_d": 5, "x_d": 1e-3, "v_d": 0.05, "a_d": 0.3,
         "d_hat": 0.5, "u_available": 100.0},
    ),
    "FocController": (
        start_values(MODELS["FocController"], TILT, gains_of("foc", "rule")["tilt"]),
        COMPARED,
    ),
    "CacController": (
        start_values(MODELS["CacController"], TILT, gains_of("cac", "published")["tilt"]),
        COMPARED,
    ),
    "AnatcController": (
        start_values(MODELS["AnatcController"], TILT, gains_of("anatc", "published")["tilt"]),
        COMPARED,
    ),
    "SignalFault": ({"freeze": True, "start": 0.1, "duration": 0.2}, {"u": 0.5}),
    "HdrmManipulator": (
        {"lift.a": 1.2, "tube.share": 0.4},
        {"payload.m": 100, "x_L[1]": 0.05, "x_L[2]": 0.05, "x_L[3]": 0.5}
        | {f"{name}_L[{i}]": scale for name, scale in (("v", 0.3), ("a", 3)) for i in (1, 2, 3)},
    ),
    "HdrmPlant": (
        {
            "gravity": 1.0,  # so that nothing falls beyond its stroke
            "screw.B_BS[1]": 50.0, "screw.C_eq[2]": 2.0, "uncertainty.F_2[3]": 0.1, "start.v_L[1]": 0.02,
        },
        {"payload.m": 100, "tau_m[1]": 20, "tau_m[2]": 10, "tau_m[3]": 1}
        | {f"d_2[{i}]": 0.3 for i in (1, 2, 3)},
    ),
}  # fmt: skip


def drive(slave: Any, walks: np.ndarray) -> np.ndarray:
    """Outputs at every communication point while the inputs follow their walks."""
    slave.enter_initialization(0.0, len(walks) * STEP)
    slave.exit_initialization()
    rows = np.empty((len(walks), len(slave.outputs)))
    for k in range(len(walks)):
        slave.inputs[:] = walks[k]
        slave.set_inputs()
        slave.do_step(k * STEP, STEP)
        slave.get_outputs()
        rows[k] = slave.outputs
    return rows


WHOLE, SHORT = 5000, 500
LABORIOUS = {"HdrmPlant", "RsbaController", "FocController", "CacController", "AnatcController"}
"""Models with long equations, which nothing but their inputs changes with time."""
DRIVEN = [(m, s) for m in MODELS for s in ((SHORT, WHOLE) if m in LABORIOUS else (WHOLE,))]


@pytest.mark.parametrize(
    ("model", "steps"), mostly_slow(DRIVEN, [x for x in DRIVEN if x[0] not in LABORIOUS or x[1] == SHORT])
)
def test_both_flavours_agree_bit_for_bit_with_the_block(
    model: str, steps: int, python_fmu_folder: Path
) -> None:
    parameters, scales = DRIVES[model]
    inputs, outputs = interface(MODELS[model])
    assert list(scales) == inputs
    random = np.random.default_rng(7)
    # slow sine plus noise, so that inputs cover their range and never repeat
    phases = random.uniform(0, 2 * np.pi, len(inputs))
    waves = np.sin(np.outer(np.linspace(0.0, 10.0, steps), 1 + np.arange(len(inputs))) + phases)
    walks = (waves + 0.1 * random.normal(size=waves.shape)) * list(scales.values())
    as_numbers = {n: float(v) for n, v in parameters.items()}
    expected = drive(BlockSlave(MODELS[model](), as_numbers), walks)
    assert np.isfinite(expected).all()
    moving = np.ptp(expected, axis=0) > 0
    assert moving.any()
    for flavour in FLAVOURS:
        with fmu_slave(fmu_path(model, flavour, python_fmu_folder), inputs, outputs, parameters) as slave:
            found = drive(slave, walks)
        same = (found.view("i8") == expected.view("i8")).all(axis=0)
        assert [o for o, s in zip(outputs, same, strict=True) if not s] == [], flavour


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("model", mostly_slow(MODELS, ["EmlaPlant", "Reference"]))
def test_building_again_gives_the_same_bytes(
    model: str, flavour: str, python_fmu_folder: Path, tmp_path: Path
) -> None:
    again = build(model, flavour, [], tmp_path)
    assert again.read_bytes() == fmu_path(model, flavour, python_fmu_folder).read_bytes()


def test_an_fmu_that_is_current_is_left_alone_and_others_are_rebuilt(tmp_path: Path) -> None:
    path = build("Reference", "native", [], tmp_path)
    good, written = path.read_bytes(), path.stat().st_mtime_ns
    build("Reference", "native", [], tmp_path)
    assert path.stat().st_mtime_ns == written
    path.write_bytes(good[: len(good) // 2])
    build("Reference", "native", [], tmp_path, overwrite=True)
    assert path.read_bytes() == good
    assert [p.name for p in path.parent.iterdir()] == ["Reference.fmu"]


def test_an_fmu_out_of_date_keeps_its_platforms_when_it_is_rebuilt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = build("Reference", "native", [host_platform(), "win64"], tmp_path)
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(MODELS["Reference"], "__doc__", "Another description.")
        build("Reference", "native", [], tmp_path)
    assert path.read_bytes() != before
    with zipfile.ZipFile(path) as archive:
        platforms = {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")}
    assert platforms == {host_platform(), "win64"}
