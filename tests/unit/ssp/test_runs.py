"""SSPs that are run: the numbers that arrive where they are computed."""

from pathlib import Path
from typing import Any

import pytest

from emla_cosim.study.loading import load
from emla_cosim.views.output_folder import results_folder
from tests.support.ssp_documents import (
    binding,
    component,
    connection,
    linear,
    packed,
    rooted,
    ssv,
    system,
)


def gain(name: str, ports: str, b: float = 1.0, **values: Any) -> str:
    """The faulty FMU as y = b u, which has no units."""
    return component(name, "Faulty.fmu", ports, binding(ssv(a=0.0, b=b, **values)))


def last(path: Path, *signals: str, **options: Any) -> list[float]:
    """Values of signals at the end of a run of three steps."""
    with load(path, stop_time=0.3, step_size=0.1, **options).prepare() as simulation:
        result = simulation.run()
    return [float(result[name][-1]) for name in signals]


@pytest.mark.parametrize(
    ("algorithm", "compiled"),
    [("jacobi", True), ("gauss-seidel", False), ("gauss-seidel", True), ("strong", False)],
)
def test_conversions_and_transformations(
    algorithm: str, compiled: bool, tmp_path: Path, faulty_fmu: Path
) -> None:
    parts = (
        gain("source", "y:output:degC", b=10.0, u=2.0),
        gain("kelvin", "u:input:K y:output:m", b=0.01),
        gain("length", "u:input:mm"),
        gain("plain", "u:input:mm"),
        connection("kelvin.u -> source.y"),
        connection("kelvin.y -> length.u", linear(-2.0, 1.0)),
        connection("kelvin.y -> plain.u", suppress_unit_conversion=True),
    )
    path = packed(tmp_path / "test.ssp", rooted(tmp_path, *parts, files={"Faulty__fmu": faulty_fmu}))
    names = ("source.y", "kelvin.y", "length.y", "plain.y")
    kelvin = 0.01 * (20.0 + 273.15)
    expected = (20.0, kelvin, -2.0 * 1000.0 * kelvin + 1.0, kelvin)
    found = last(path, *names, algorithm=algorithm, compiled=compiled)
    assert found == pytest.approx(expected, rel=1e-12)


def test_loop_with_transformations_is_solved(tmp_path: Path, faulty_fmu: Path) -> None:
    parts = (
        gain("a", "u:input y:output", b=0.5),
        gain("b", "u:input y:output", b=1.0),
        connection("a.y -> b.u", linear(0.5, 3.0)),
        connection("b.y -> a.u", linear(-1.0, 4.0)),
    )
    path = rooted(tmp_path, *parts, files={"Faulty__fmu": faulty_fmu})
    # a = 0.5 (4 - b), b = 0.5 a + 3: a = 0.4, b = 3.2
    assert last(path, "a.y", "b.y", algorithm="strong") == pytest.approx((0.4, 3.2), rel=1e-7)


def test_parameters_reach_nested_systems(tmp_path: Path, faulty_fmu: Path) -> None:
    part = gain("a", "u:input:m y:output:m", b=2.0), connection("in -> a.u"), connection("a.y -> out")
    inside = system("inner", *part, ports="in:input:mm out:output:mm")
    given = binding(ssv(**{"inner.in": (4.0, "m")}))
    parts = inside, gain("b", "u:input:m"), connection("inner.out -> b.u")
    path = rooted(tmp_path, *parts, files={"Faulty__fmu": faulty_fmu}, bindings=given)
    assert last(path, "inner.a.y", "b.y") == pytest.approx((8.0, 8.0), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "folder"), [("study", "study"), ("../../x", "x"), ("/etc", "etc"), ("a b", "a_b"), ("..", "run")]
)
def test_results_stay_in_the_results_folder(name: str, folder: str) -> None:
    assert results_folder(name) == Path("results") / folder
