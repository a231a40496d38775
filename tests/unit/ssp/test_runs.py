"""SSPs that are run: the numbers that arrive where they are computed."""

from pathlib import Path
from typing import Any

import polars
import pytest

from emla_cosim.study.loading import load
from emla_cosim.views.output_folder import results_folder
from tests.support.scenario_runs import run_scenario
from tests.support.ssp_documents import (
    binding,
    component,
    connection,
    folder,
    linear,
    packed,
    ssd,
    ssv,
    system,
)


def gain(name: str, ports: str, b: float = 1.0, **values: Any) -> str:
    """The faulty FMU as y = b u; without units of its own."""
    return component(name, "Faulty.fmu", ports, binding(ssv(a=0.0, b=b, **values)))


def results(path: Path, folder: Path, *signals: str, **options: Any) -> dict[str, float]:
    """The last row of a run of three steps."""
    times = {"stop_time": 0.3, "step_size": 0.1, "output_interval": 0.1}
    assert run_scenario(load(path), folder, **times, **options).problem is None
    (row,) = polars.read_csv(folder / "results.csv").tail(1).to_dicts()
    return {name: row[name] for name in signals}


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel", "strong"])
@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "interpreted"])
def test_conversions_and_transformations(
    algorithm: str, compiled: bool, tmp_path: Path, faulty_fmu: Path
) -> None:
    root = system(
        "root",
        gain("source", "y:output:degC", b=10.0, u=2.0),
        gain("kelvin", "u:input:K y:output:m", b=0.01),
        gain("length", "u:input:mm"),
        gain("plain", "u:input:mm"),
        connection("kelvin.u -> source.y"),
        connection("kelvin.y -> length.u", linear(-2.0, 1.0)),
        connection("kelvin.y -> plain.u", suppress_unit_conversion=True),
    )
    unpacked = folder(tmp_path / "ssp", root=ssd(root), Faulty__fmu=faulty_fmu)
    path = packed(tmp_path / "test.ssp", unpacked)
    names = ("source.y", "kelvin.y", "length.y", "plain.y")
    found = results(path, tmp_path / "out", *names, algorithm=algorithm, compiled=compiled)
    kelvin = 0.01 * (20.0 + 273.15)
    expected = (20.0, kelvin, -2.0 * 1000.0 * kelvin + 1.0, kelvin)
    assert tuple(found.values()) == pytest.approx(expected, rel=1e-12)


def test_a_loop_with_transformations(tmp_path: Path, faulty_fmu: Path) -> None:
    """Both ways, so that the algorithm has to find what fits."""
    root = system(
        "root",
        gain("a", "u:input y:output", b=0.5),
        gain("b", "u:input y:output", b=1.0),
        connection("a.y -> b.u", linear(0.5, 3.0)),
        connection("b.y -> a.u", linear(-1.0, 4.0)),
    )
    path = folder(tmp_path / "ssp", root=ssd(root), Faulty__fmu=faulty_fmu)
    found = results(path, tmp_path / "out", "a.y", "b.y", algorithm="strong")
    # a = 0.5 (4 - b), b = 0.5 a + 3: a = 0.4, b = 3.2
    assert tuple(found.values()) == pytest.approx((0.4, 3.2), rel=1e-7)


def test_parameters_reach_nested_systems(tmp_path: Path, faulty_fmu: Path) -> None:
    inside = system(
        "inner",
        gain("a", "u:input:m y:output:m", b=2.0),
        connection("in -> a.u"),
        connection("a.y -> out"),
        ports="in:input:mm out:output:mm",
    )
    root = system(
        "root",
        inside,
        gain("b", "u:input:m"),
        connection("inner.out -> b.u"),
        bindings=binding(ssv(**{"inner.in": (4.0, "m")})),
    )
    path = folder(tmp_path / "ssp", root=ssd(root), Faulty__fmu=faulty_fmu)
    found = results(path, tmp_path / "out", "inner.a.y", "b.y")
    assert tuple(found.values()) == pytest.approx((8.0, 8.0), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "folder"), [("study", "study"), ("../../x", "x"), ("/etc", "etc"), ("a b", "a_b"), ("..", "run")]
)
def test_the_name_of_a_structure_leads_nowhere_else(name: str, folder: str) -> None:
    assert results_folder(name) == Path("results") / folder
