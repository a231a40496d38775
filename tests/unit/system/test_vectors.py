"""Vectors and matrices: parameters as nested lists and arrays, connections as a whole."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import emla_cosim as ec
import fmublock
from emla_cosim.base.errors import CommandError
from emla_cosim.base.values import parse_list
from emla_cosim.system.model import System
from emla_cosim.system.structure import connect_elements
from fmublock import Block, Input, Output, Parameter, State, dot
from tests.support.commands import Emla, sentence
from tests.support.ssp_documents import component, connection, rooted, system

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
    with ec.load(system, **{"step_size": STEP, "stop_time": STOP, **options}).prepare() as simulation:
        return simulation.run()


def test_matrix_controller_against_scipy(fmus: dict[str, Path]) -> None:
    result = run(System.of(fmus, VECTORS, MATRICES))
    single = run(System.of(fmus, ELEMENTS), set=MATRICES)
    states = np.column_stack([result[f"plant.x[{i}]"] for i in (1, 2)])
    np.testing.assert_array_equal(states, np.column_stack([single[f"plant.x[{i}]"] for i in (1, 2)]))
    expected = np.array([scipy.linalg.expm((A - B @ K) * t) @ START for t in result["time"]])
    assert np.abs(states[-1]).max() < 0.1 * np.abs(START).max()
    np.testing.assert_allclose(states, expected, atol=2.0 * STEP * np.abs(expected[:, 1]).max() * 10)


def test_command_takes_matrices(fmus: dict[str, Path], emla: Emla) -> None:
    command = ["run", str(fmus["plant"]), "--stop-time", "0.002", "--step-size", "0.001", "--no-plots"]
    process = emla(*command, "--output", "out", "--set", f"A={A.tolist()}")
    assert process.exit_code == 0, process.output
    (record,) = json.loads(Path("out/run.json").read_text())["components"].values()
    parameters = {name: float(value) for name, value in record["parameters"].items() if name[0] == "A"}
    assert parameters == {f"A[{i + 1},{j + 1}]": A[i, j] for i in (0, 1) for j in (0, 1)}
    messages = {
        "A=[[1,2],[3]]": "the rows of",
        "A=[[1,2],[3,4]": "is not a list; write [1,2], or [[1,2],[3,4]]",
    }
    for text, message in messages.items():
        assert message in sentence(emla(*command, "--set", text), 2)


CONTROL = system(
    "control",
    component("lqr", "Lqr.fmu", "x[1]:input x[2]:input u:output"),
    connection("state -> lqr.x"),
    connection("lqr.u -> force"),
    ports="state:input:Real force:output:Real",
)


def test_ssd_connects_whole_vectors(fmus: dict[str, Path], tmp_path: Path) -> None:
    """Vectors also pass the connectors of an inner system; the export has the elements."""
    files = {"Linear__fmu": fmus["plant"], "Lqr__fmu": fmus["lqr"]}
    parts = component("plant", "Linear.fmu", "x:output:Real u:input:Real"), CONTROL
    wires = connection("plant.x -> control.state"), connection("control.force -> plant.u")
    values = {name.replace("lqr.", "control.lqr."): value for name, value in MATRICES.items()}
    options: dict[str, Any] = {"set": values, "step_size": STEP, "stop_time": 0.1}
    expected = run(System.of(fmus, ELEMENTS), set=MATRICES, stop_time=0.1)
    scenario = ec.load(rooted(tmp_path, *parts, *wires, files=files), **options)
    scenario.export(tmp_path / "again.ssp")
    for each_scenario in (scenario, ec.load(tmp_path / "again.ssp")):
        with each_scenario.prepare() as simulation:
            result = simulation.run()
        for i in (1, 2):
            np.testing.assert_array_equal(result[f"plant.x[{i}]"], expected[f"plant.x[{i}]"])
    plant = component("plant", "Linear.fmu", "u:input:Real")
    wrong = rooted(tmp_path, plant, CONTROL, connection("plant.u -> control.state"), files=files)
    with pytest.raises(CommandError, match=r"plant\.u -> control\.state joins 1 element and 2 elements"):
        ec.load(wrong, step_size=STEP, stop_time=0.1)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"a": ["x[1]", "x[2]"], "b": ["u[1]", "u[2]", "u[3]"]}, "a.x has 2 elements, b.u has 3 elements"),
        ({"a": ["x[1,1]", "x[1,2]"], "b": ["u[1]", "u[2]"]}, "b.u has 2 elements with other indices"),
    ],
)
def test_shapes_that_differ_are_refused(names: dict[str, list[str]], message: str) -> None:
    system = System.of({"a": "a.fmu", "b": "b.fmu"}, ["a.x -> b.u"])
    with pytest.raises(CommandError, match=f"joins different shapes: .*{message}"):
        connect_elements(system, names)


def test_scalars_keep_their_connections() -> None:
    system = System.of({"a": "a.fmu", "b": "b.fmu"}, ["a.x -> b.u", "a.y[1] -> b.v", "a.z -> b.w"])
    names = {"a": ["x", "x[1]", "y[1]", "z[1]"], "b": ["u", "u[1]", "v", "w"]}
    assert connect_elements(system, names) == system


def test_lists_are_read_as_texts() -> None:
    assert parse_list("[ [ 1 ,2.5],[3 kN, 4] ]") == [["1", "2.5"], ["3 kN", "4"]]
    assert parse_list("[]") == []
