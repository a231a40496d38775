"""Vectors and matrices: parameters as nested lists and arrays, connections as a whole."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import emla_cosim as ec
import fmublock
from emla_cosim.base.errors import CommandError
from emla_cosim.base.values import list_elements, parse_list
from emla_cosim.system.model import System
from emla_cosim.system.vectors import connect_elements
from fmublock import Block, Input, Output, Parameter, State, dot
from tests.support.commands import Emla

A, B = np.array([[0.0, 1.0], [-4.0, -0.2]]), np.array([[0.0], [2.0]])
K = scipy.linalg.solve_continuous_are(A, B, np.diag([100.0, 1.0]), [[1.0]])
K = B.T @ K  # R = 1
START, STEP, STOP = np.array([0.3, -0.1]), 1e-3, 1.0


class Linear(Block):
    """A linear system of second order."""

    u = Input(shape=1)
    A = Parameter(np.zeros((2, 2)), shape=(2, 2))
    B = Parameter([[0.0], [1.0]], shape=(2, 1))
    start = Parameter([1.0, 0.0], shape=2)
    x = State(start, shape=2)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": [dot(v.A[i], v.x) + dot(v.B[i], v.u) for i in range(2)]}


class Lqr(Block):
    """A state feedback."""

    x = Input(shape=2)
    K = Parameter([[0.0, 0.0]], shape=(1, 2))
    u = Output(shape=1)

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"u": [-dot(v.K[0], v.x)]}


VECTORS = ["plant.x -> lqr.x", "lqr.u -> plant.u"]
ELEMENTS = ["plant.x[1] -> lqr.x[1]", "plant.x[2] -> lqr.x[2]", "lqr.u[1] -> plant.u[1]"]
MATRICES = {"plant.A": A, "plant.B": B.tolist(), "plant.start": START, "lqr.K": K}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("blocks")
    for block in (Linear, Lqr):
        fmublock.build(block, folder / f"{block.__name__}.fmu")
    return {"plant": folder / "Linear.fmu", "lqr": folder / "Lqr.fmu"}


def run(system: System, **options: Any) -> ec.Result:
    with ec.load(system, step_size=STEP, stop_time=STOP, **options).prepare() as simulation:
        return simulation.run()


def test_a_matrix_controller_stabilizes_what_scipy_says(fmus: dict[str, Path]) -> None:
    whole = run(System.of(fmus, VECTORS, MATRICES))
    single = run(System.of(fmus, ELEMENTS), set=MATRICES)
    found = np.column_stack([whole[f"plant.x[{i}]"] for i in (1, 2)])
    np.testing.assert_array_equal(found, np.column_stack([single[f"plant.x[{i}]"] for i in (1, 2)]))
    expected = np.array([scipy.linalg.expm((A - B @ K) * t) @ START for t in whole["time"]])
    assert np.abs(found[-1]).max() < 0.1 * np.abs(START).max()
    np.testing.assert_allclose(found, expected, atol=2.0 * STEP * np.abs(expected[:, 1]).max() * 10)


def test_the_command_takes_matrices(fmus: dict[str, Path], emla: Emla, tmp_path: Path) -> None:
    texts = [f"{n}={np.asarray(v).tolist()}" for n, v in MATRICES.items() if n.startswith("plant")]
    values = [word for text in texts for word in ("--set", text.replace("plant.", ""))]
    command = ["run", str(fmus["plant"]), *values, "--step-size", "1e-3", "--stop-time", "0.1", "--no-plots"]
    done = emla(*command, "--output", "out")
    assert done.exit_code == 0, done.output
    single = run(System.of({"plant": fmus["plant"]}), set={n: v for n, v in MATRICES.items() if "plant" in n})
    row = np.searchsorted(single["time"], 0.1 - 1e-9)
    last = Path("out/results.csv").read_text().splitlines()
    names, numbers = last[0].split(","), [float(x) for x in last[-1].split(",")]
    for i in (1, 2):
        name = next(n for n in names if n.endswith((f"x[{i}]", f'x[{i}]"')))
        assert numbers[names.index(name)] == single[f"plant.x[{i}]"][row]
    wrong = emla("run", str(fmus["plant"]), "--set", "A=[[1,2],[3]]", "--no-plots", "--stop-time", "1")
    assert wrong.exit_code == 2 and "the rows of" in wrong.output
    wrong = emla("run", str(fmus["plant"]), "--set", "A=[[1,2],[3,4]", "--no-plots", "--stop-time", "1")
    assert wrong.exit_code == 2 and "is not a list; write [1,2], or [[1,2],[3,4]]" in " ".join(
        wrong.output.split()
    )


def test_a_package_has_the_connections_of_the_elements(fmus: dict[str, Path], tmp_path: Path) -> None:
    scenario = ec.load(System.of(fmus, VECTORS, MATRICES), step_size=STEP, stop_time=0.05)
    scenario.export(tmp_path / "it.ssp")
    with ec.load(str(tmp_path / "it.ssp")).prepare() as simulation:
        exported = simulation.run()
    with scenario.prepare() as simulation:
        np.testing.assert_array_equal(exported["plant.x[1]"], simulation.run()["plant.x[1]"])


SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="loop"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="loop">
    <ssd:Elements>
      <ssd:Component name="plant" source="Linear.fmu">
        <ssd:Connectors>
          <ssd:Connector name="x" kind="output"><ssc:Real/></ssd:Connector>
          <ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector>
        </ssd:Connectors>
      </ssd:Component>
      <ssd:System name="control">
        <ssd:Connectors>
          <ssd:Connector name="state" kind="input"><ssc:Real/></ssd:Connector>
          <ssd:Connector name="force" kind="output"><ssc:Real/></ssd:Connector>
        </ssd:Connectors>
        <ssd:Elements>
          <ssd:Component name="lqr" source="Lqr.fmu">
            <ssd:Connectors>
              <ssd:Connector name="x[1]" kind="input"/><ssd:Connector name="x[2]" kind="input"/>
              <ssd:Connector name="u" kind="output"/>
            </ssd:Connectors>
          </ssd:Component>
        </ssd:Elements>
        <ssd:Connections>
          <ssd:Connection startConnector="state" endElement="lqr" endConnector="x"/>
          <ssd:Connection startElement="lqr" startConnector="u" endConnector="force"/>
        </ssd:Connections>
      </ssd:System>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="plant" startConnector="x" endElement="control" endConnector="state"/>
      <ssd:Connection startElement="control" startConnector="force" endElement="plant" endConnector="u"/>
    </ssd:Connections>
  </ssd:System>
</ssd:SystemStructureDescription>
"""


def test_an_ssd_connects_whole_vectors(fmus: dict[str, Path], tmp_path: Path) -> None:
    """Vectors also pass the connectors of an inner system; the export has the elements."""
    for fmu in fmus.values():
        (tmp_path / fmu.name).write_bytes(fmu.read_bytes())
    (tmp_path / "loop.ssd").write_text(SSD)
    values = {name.replace("lqr.", "control.lqr."): value for name, value in MATRICES.items()}
    options: dict[str, Any] = {"set": values, "step_size": STEP, "stop_time": 0.1}
    expected = run(System.of(fmus, ELEMENTS), set=MATRICES)
    scenario = ec.load(tmp_path / "loop.ssd", **options)
    scenario.export(tmp_path / "again.ssp")
    for one in (scenario, ec.load(tmp_path / "again.ssp")):
        with one.prepare() as simulation:
            found = simulation.run()
        assert len(found.time) == 101
        for i in (1, 2):
            np.testing.assert_array_equal(found[f"plant.x[{i}]"], expected[f"plant.x[{i}]"][:101])
    swapped = SSD.replace('name="x" kind="output"', 'name="u" kind="input"').replace(
        'startElement="plant" startConnector="x"', 'startElement="plant" startConnector="u"'
    )
    swapped = swapped.replace('<ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector>', "", 1)
    (tmp_path / "loop.ssd").write_text(swapped)
    with pytest.raises(CommandError, match=r"plant\.u -> control\.state joins 1 element and 2 elements"):
        ec.load(tmp_path / "loop.ssd", step_size=STEP, stop_time=0.1)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ({"a": ["x[1]", "x[2]"], "b": ["u[1]", "u[2]", "u[3]"]}, "a.x has 2 elements, b.u has 3 elements"),
        ({"a": ["x[1,1]", "x[1,2]"], "b": ["u[1]", "u[2]"]}, "b.u has 2 elements with other indices"),
    ],
)
def test_shapes_that_differ_are_refused(names: dict[str, list[str]], sentence: str) -> None:
    system = System.of({"a": "a.fmu", "b": "b.fmu"}, ["a.x -> b.u"])
    with pytest.raises(CommandError, match=f"joins different shapes: .*{sentence}"):
        connect_elements(system, lambda name: names[name])


def test_scalars_keep_their_connections() -> None:
    system = System.of({"a": "a.fmu", "b": "b.fmu"}, ["a.x -> b.u", "a.y[1] -> b.v", "a.z -> b.w"])
    names = {"a": ["x", "x[1]", "y[1]", "z[1]"], "b": ["u", "u[1]", "v", "w"]}
    assert connect_elements(system, lambda name: names[name]) == system


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("[1, 2.5]", ["1", "2.5"]),
        ("[[1,2],[3 kN,4]]", [["1", "2"], ["3 kN", "4"]]),
        ("[ [ 1 ] , [ 2 ] ]", [["1"], ["2"]]),
        ("[]", []),
    ],
)
def test_lists_are_read_as_texts(text: str, value: list[Any]) -> None:
    assert parse_list(text) == value


def test_elements_of_lists_have_the_names_of_fmi() -> None:
    cube = np.arange(8.0).reshape(2, 2, 2)
    found = list_elements({"c": cube, "s": 1.0})
    assert found["c[2,1,2]"] == cube[1, 0, 1] and found["s"] == 1.0 and len(found) == 9
