"""FMUs that several files here run, and runs of them."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from tests.support.hand_written_fmus import build_event_fmu, build_reluctant_fmu


def run(source: Any, step: float = 0.125, stop: float = 2.0, **options: Any) -> ec.Result:
    with ec.load(source, step_size=step, stop_time=stop, **options).prepare() as simulation:
        return simulation.run()


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return a function that builds the FMU with events, each variant once."""
    folder = tmp_path_factory.mktemp("events")

    @cache
    def build_once(**options: Any) -> Path:
        name = "Events" + "".join(f"{k}{v}" for k, v in sorted(options.items()))
        return build_event_fmu(folder / f"{name}.fmu", **options)

    return build_once


@pytest.fixture(scope="module")
def reluctant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the FMU that loses start values, or is slow."""
    return build_reluctant_fmu(tmp_path_factory.mktemp("reluctant") / "Reluctant.fmu")
