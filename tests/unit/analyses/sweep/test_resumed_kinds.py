"""A sweep is continued only as the kinds with which it began."""

from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError


def test_sweep_is_not_continued_as_another_kind(
    fmu_folder: Path, tmp_path: Path, on_one_cluster: None
) -> None:
    options: Any = {"stop_time": 0.001, "vary": {"lift.plant.motor.R_s": [0.1, 0.2]}, "fmus": fmu_folder}
    options |= {"metrics": ["x = last(lift.plant.x_L)"], "output": tmp_path / "out"}
    first = ec.sweep("lift", **options)
    with pytest.raises(CommandError, match="resume"):
        ec.sweep("lift", kind={"lift.plant": "me"}, resume=True, **options)
    assert ec.sweep("lift", resume=True, **options).variants["x"].to_list() == first.variants["x"].to_list()
