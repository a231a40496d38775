"""Packages without a stop time or a step size take those of their FMUs, and say so."""

from pathlib import Path

import pytest

from emla_cosim.study.loading import load
from fmublock.archive import write_archive
from tests.support.ssp_documents import component, connection, description, folder, ssd, system

EXPERIMENT = '<DefaultExperiment stopTime="2" stepSize="0.01"/>'


def package(path: Path, first: str, second: str) -> Path:
    """A package of two FMUs with these default experiments, and without times of its own."""
    for name, variable, times in (("a", "y:output", first), ("b", "u:input", second)):
        text = description(name, variable).replace("<ModelVariables>", f"{times}<ModelVariables>")
        path.mkdir(parents=True, exist_ok=True)
        write_archive(path / f"{name}.fmu", {"modelDescription.xml": text.encode()})
    parts = (component("a", "a.fmu", "y:output"), component("b", "b.fmu", "u:input"))
    root = ssd(system("r", *parts, connection("a.y -> b.u")))
    return folder(path / "ssp", root=root, a__fmu=path / "a.fmu", b__fmu=path / "b.fmu")


@pytest.mark.parametrize(
    ("first", "second", "stop", "step", "origins"),
    [
        (EXPERIMENT, EXPERIMENT.replace("2", "3").replace("0.01", "0.005"), 3.0, 0.005, True),
        (EXPERIMENT, "", 2.0, 0.01, True),
        ("", "", 10.0, 0.01, False),
    ],
)
def test_times_come_from_the_fmus(
    tmp_path: Path, first: str, second: str, stop: float, step: float, origins: bool
) -> None:
    scenario = load(package(tmp_path, first, second))
    assert (scenario.options.stop_time, scenario.options.step_size) == (stop, step)
    assert scenario.notes == (
        f"the package has no stop time; without --stop-time it runs for {stop:g} s"
        + ", the longest of its FMUs" * origins,
        f"the package has no step size; without --step-size it is {step:g} s"
        + ", the shortest of its FMUs" * origins,
    )


def test_times_of_the_user_come_first(tmp_path: Path) -> None:
    path = package(tmp_path, EXPERIMENT, "")
    scenario = load(path, stop_time=0.5, step_size=0.25)
    assert (scenario.options.stop_time, scenario.options.step_size, scenario.notes) == (0.5, 0.25, ())
    short = load(path, stop_time=0.005)  # shorter than the steps of the FMUs
    assert (short.options.stop_time, short.options.step_size) == (0.005, pytest.approx(5e-6))
    assert len(short.notes) == 1
