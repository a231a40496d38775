"""Every block of this project gives the same bits natively, through PythonFMU and in process."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.fmu.models import FLAVOURS, MODELS, build, fmu_path
from fmublock.platforms import host_platform
from tests.support.blocks import FACTS, OWN, WITH_STATES
from tests.support.slaves import BlockSlave, fmu_slave, interface
from tests.support.tiers import mostly_slow

STEP = 1e-4


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


FULL_LENGTH = 5000
BY_DEFAULT = [(m, FULL_LENGTH // 10 ** (FACTS[m].is_laborious + (m in WITH_STATES))) for m in OWN]
"""A tenth for what takes long in each step, and for states; the others change with the time alone."""
DRIVEN = [*BY_DEFAULT, *((model, FULL_LENGTH) for model, steps in BY_DEFAULT if steps < FULL_LENGTH)]


@pytest.mark.parametrize(("model", "steps"), mostly_slow(DRIVEN, BY_DEFAULT))
def test_both_flavours_agree_bit_for_bit_with_the_block(
    model: str, steps: int, python_fmu_folder: Path
) -> None:
    parameters, scales = FACTS[model].start, FACTS[model].inputs
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
            actual = drive(slave, walks)
        same = (actual.view("i8") == expected.view("i8")).all(axis=0)
        assert [o for o, s in zip(outputs, same, strict=True) if not s] == [], flavour


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("model", mostly_slow(MODELS, ["Reference"]))
def test_building_again_gives_the_same_bytes(model: str, flavour: str, tmp_path: Path) -> None:
    first, second = (build(model, flavour, [], tmp_path / name) for name in "ab")
    assert first.read_bytes() == second.read_bytes()


def test_only_fmus_that_are_out_of_date_are_built_again(tmp_path: Path) -> None:
    path = build("Reference", "native", [], tmp_path)
    good, written = path.read_bytes(), path.stat().st_mtime_ns
    build("Reference", "native", [], tmp_path)
    assert path.stat().st_mtime_ns == written
    path.write_bytes(good[: len(good) // 2])
    build("Reference", "native", [], tmp_path, overwrite=True)
    assert path.read_bytes() == good
    assert [p.name for p in path.parent.iterdir()] == ["Reference.fmu"]


@pytest.mark.slow
def test_fmu_out_of_date_keeps_its_platforms_when_it_is_rebuilt(
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
