"""State matrices, poles and steady states of Model Exchange equal closed forms."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import signal

import emla_cosim as ec
from emla_cosim.cli.app import app
from emla_fmu import EmlaPlant
from fmublock import Block, DefaultExperiment, Input, Output, State, minimum
from tests.support.hand_written_fmus import build_integrated_fmu
from tests.support.linear_drive import LinearDrive
from tests.support.state_feedback import STEP, WIRES, MatrixCart, MatrixGain

ME = {"kind": {"*": "me"}, "step_size": STEP, "stop_time": 0.1}


class MatrixTank(Block):
    """A tank whose outflow is less than 1 m/s."""

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=STEP)
    inflow = Input(0.5, unit="m/s")
    h = State(0.5, unit="m", minimum=0.0)
    outflow = Output(unit="m/s")

    def derivatives(self, v):
        return {"h": v.inflow - v.h / (1.0 + v.h)}

    def outputs(self, v):
        return {"outflow": v.h / (1.0 + v.h)}


class MatrixLimit(Block):
    """An integrator of a limited input."""

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=STEP)
    u = Input(0.0)
    x = State(0.0)

    def derivatives(self, v):
        return {"x": minimum(v.u, 0.0)}


def closed() -> ec.System:
    return ec.System.of({"cart": MatrixCart, "gain": MatrixGain}, WIRES)


def linearize(source: object, **options: object) -> ec.LinearizeResult:
    return ec.linearize(source, matrices=True, **{**ME, **options})


def single_component(block: type[Block], name: str, **values: float) -> ec.System:
    return ec.System.of({name: block}, set={f"{name}.{n}": x for n, x in values.items()})


def test_poles_and_damping_match_a_spring_and_a_damper() -> None:
    omega, zeta = 7.0, 0.2
    system = single_component(MatrixCart, "cart", stiffness=omega**2, damping=2.0 * zeta * omega)
    matrices = linearize(system, perturb="cart.force", read=["cart.speed", "cart.position"]).matrices
    assert matrices.states == ("cart.x", "cart.v")
    assert matrices.A == pytest.approx(np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]]), rel=1e-9)
    assert matrices.B == pytest.approx(np.array([[0.0], [1.0]]))
    assert matrices.C == pytest.approx(np.array([[0.0, 1.0], [1.0, 0.0]]))
    assert not matrices.D.any()
    assert matrices.damping == pytest.approx(zeta)
    expected = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2) * np.array([-1.0, 1.0]))
    assert matrices.poles == pytest.approx(expected)
    assert [matrices.units[n] for n in ("cart.v", "cart.force", "cart.position")] == ["m/s", "N", "m"]


def test_connected_components_have_the_matrices_of_the_closed_loop() -> None:
    """Both inputs act through the connections: one is free, the other one is driven by the loop."""
    inputs, outputs = ["gain.feed", "cart.force"], ["gain.force", "cart.position"]
    matrices = linearize(closed(), perturb=inputs, read=outputs).matrices
    assert matrices.A == pytest.approx(np.array([[0.0, 1.0], [-4.0, -4.0]]))
    assert matrices.B == pytest.approx(np.array([[0.0, 0.0], [2.0, 1.0]]))
    assert matrices.C == pytest.approx(np.array([[-4.0, -4.0], [1.0, 0.0]]))
    assert matrices.D == pytest.approx(np.array([[2.0, 0.0], [0.0, 0.0]]))
    assert matrices.poles == pytest.approx(np.array([-2.0, -2.0]), abs=1e-4)  # a double one


def test_matrices_of_a_plant_equal_its_equations() -> None:
    drive = LinearDrive("foc", 0.05, 33.0, -4.0)
    parameters = ec.load("lift").system.component("lift.plant").parameters
    values = {**parameters, "v_L": drive.v, "i_q": drive.i_q, "i_d": drive.i_d}
    system = ec.System.of({"plant": EmlaPlant}, set={f"plant.{n}": x for n, x in values.items()})
    result = linearize(system, perturb=["plant.u_q", "plant.u_d"], at=0.0, step_size=1e-4)
    A, B = drive.plant()
    matrices = result.matrices
    names = ("x_L", "v_L", "i_q", "i_d", "motor.temperature_rise")
    assert matrices.states == tuple(f"plant.{n}" for n in names)
    scale = np.abs(A).max(axis=1, keepdims=True)
    assert np.abs((matrices.A[:4, :4] - A) / scale).max() < 1e-6
    assert np.abs((matrices.B[:4] - B) / np.abs(B).max()).max() < 1e-6
    assert "hold constant" in result.remarks[-1]


def test_steady_state_with_free_inputs() -> None:
    matrices = linearize(
        single_component(MatrixCart, "cart", gravity=9.81), steady=True, free="cart.force"
    ).matrices
    assert matrices.at_states == pytest.approx(np.array([0.1 - 9.81 * 0.1**2 / 2.0, 0.0]), abs=1e-4)
    assert matrices.at_inputs == pytest.approx(np.array([9.81]))
    result = linearize(
        single_component(MatrixTank, "tank"), steady=True, perturb="tank.inflow", read="tank.outflow"
    )
    assert result.is_steady
    assert result.matrices.at_states == pytest.approx(np.array([1.0]))
    assert result.matrices.A == pytest.approx(np.array([[-0.25]]), rel=1e-6)
    assert result.matrices.C == pytest.approx(np.array([[0.25]]), rel=1e-6)


def test_moving_system_has_no_steady_state() -> None:
    with pytest.raises(ec.RunError, match=r"no steady state.*cart.v \(-9.81 m/s/s\) still changes"):
        linearize(single_component(MatrixCart, "cart", gravity=9.81), steady=True)
    with pytest.raises(ec.RunError, match="no steady state"):
        linearize(single_component(MatrixTank, "tank", inflow=2.0), steady=True)


def test_matrices_of_an_fmu_with_events(tmp_path: Path) -> None:
    """x' = u - x; a ball that falls; a stair with time events."""
    fmu = build_integrated_fmu(tmp_path / "Integrated.fmu", rollback=False)
    result = linearize(fmu, perturb="u", read="y", set={"gain": 3.0}, stop_time=0.3)
    matrices = result.matrices
    row = [name.removeprefix("Integrated.") for name in matrices.states].index("x")
    expected = np.zeros(len(matrices.states))
    expected[row] = -1.0
    assert matrices.A[row] == pytest.approx(expected)
    assert matrices.B[row] == pytest.approx([1.0])
    assert matrices.C[0] == pytest.approx(-expected) and matrices.D == pytest.approx(np.array([[3.0]]))
    assert any("time events" in remark for remark in result.remarks)
    with pytest.raises(ec.RunError, match="no steady state"):  # the ball falls
        linearize(fmu, steady=True, stop_time=0.3)


def test_model_exchange_has_the_same_frequency_response() -> None:
    system = single_component(MatrixCart, "cart", stiffness=400.0, damping=40.0)
    options = {"perturb": "force", "read": "position", "step_size": STEP, "stop_time": 1.1}
    options |= {"duration": 1.0, "amplitude": 1.0}
    results = [
        ec.linearize(system, **options, **more) for more in ({}, {"kind": {"*": "me"}, "fmi_tolerance": 1e-9})
    ]
    H, exchanged = (result["force to position"].value for result in results)
    matrices = linearize(system, perturb="force", read="position").matrices
    sampled = signal.cont2discrete((matrices.A, matrices.B, matrices.C, matrices.D), STEP)
    frequency = results[0]["force to position"].frequency
    a, b, c, _ = sampled[:4]
    z = np.exp(2j * np.pi * frequency * STEP)
    expected = np.array([(c @ np.linalg.solve(x * np.eye(2) - a, b)).item() for x in z])
    below = frequency < 20.0
    assert np.abs(H / expected - 1.0)[below].max() < 1e-4
    assert np.abs(exchanged / expected - 1.0)[below].max() < 1e-4


def test_inputs_inside_a_group_need_separate_integration() -> None:
    h, at = 0.1, {"stop_time": 6.0, "at": 1.0, "duration": 5.0, "amplitude": 1.0}
    options = {"open": "gain.force->cart.force", **ME, "step_size": h, **at}
    with pytest.raises(ec.CommandError, match="integrated together"):
        ec.linearize(closed(), **options)
    result = ec.linearize(closed(), integrate_together=False, fmi_tolerance=1e-8, **options)
    (margins,) = result.margins.values()
    z = np.exp(2j * np.pi * margins.phase_at * h)
    L = 4.0 * h**2 / 2.0 * (z + 1.0) / (z - 1.0) ** 2 + 4.0 * h / (z - 1.0)
    assert abs(L) == pytest.approx(1.0, abs=0.01)
    assert margins.phase_deg == pytest.approx(180.0 + np.degrees(np.angle(L)), abs=0.5)


def test_limit_at_the_operating_point_is_reported() -> None:
    (remark,) = linearize(single_component(MatrixLimit, "limit"), perturb="limit.u").remarks
    assert remark.startswith("the derivative of limit.x is not smooth in limit.u")
    assert linearize(single_component(MatrixLimit, "limit", u=-1.0), perturb="limit.u").remarks == ()


def test_matrices_as_objects_of_scipy_and_python_control() -> None:
    control = pytest.importorskip("control", reason="python-control is not installed.")
    matrices = linearize(closed(), perturb="gain.feed", read="cart.position").matrices
    s = 2j * np.pi * np.array([0.1, 1.0, 10.0])
    expected = 2.0 / (s**2 + 4.0 * s + 4.0)
    for_control = matrices.to_control()
    assert for_control.input_labels == ["gain_feed"] and for_control.state_labels == ["cart_x", "cart_v"]
    assert control.frequency_response(for_control, np.abs(s)).complex == pytest.approx(expected, rel=1e-6)
    for_scipy = matrices.to_scipy()
    assert isinstance(for_scipy, signal.StateSpace)
    response = for_scipy.C @ np.linalg.solve(s[0] * np.eye(2) - for_scipy.A, for_scipy.B) + for_scipy.D
    assert response.item() == pytest.approx(expected[0], rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": {}}, "cart and gain cannot be reached"),
        ({"kind": {"gain": "me"}}, "those of cart cannot be reached"),
        ({"integrate_together": False}, "integrated apart"),
        ({"open": "gain.force->cart.force"}, "leave out 'open'"),
        ({"steady": True, "matrices": False}, "set 'matrices'"),
        ({"free": "gain.feed"}, "set 'steady'"),
        ({"perturb": "cart.position"}, "is not a continuous input"),
        ({"read": "cart.nothing"}, "has no variable 'nothing'"),
        ({"at": 7.0}, "outside of the run"),
    ],
)
def test_invalid_input_gives_one_message(options: dict, message: str) -> None:
    with pytest.raises(ec.CommandError, match=message):
        ec.linearize(closed(), **{**ME, "matrices": True, **options})


def test_components_that_sample_are_named() -> None:
    with pytest.raises(ec.CommandError, match=r"lift.disturbance cannot be reached.*sample"):
        linearize("lift", step_size=1e-4, stop_time=1e-3)


def test_command_writes_matrices(tmp_path: Path) -> None:
    system = tmp_path / "closed.ssp"
    ec.load(closed(), **ME).export(system)
    out = tmp_path / "out"
    inputs = ["--perturb", "gain.feed", "--read", "cart.position", "--steady"]
    arguments = ["linearize", str(system), "--kind", "me", "--matrices", *inputs, "--output", str(out)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "steady state near t = 0.1 s" in result.output and "damping" in result.output
    record = json.loads((out / "linearize.json").read_text())
    assert record["steady"] and record["matrices"]["A"] == [[0.0, 1.0], [-4.0, -4.0]]
    assert record["matrices"]["poles"][0]["damping"] == pytest.approx(1.0)
    assert {x.name for x in out.iterdir() if not x.name.startswith(".")} == {"linearize.json"}
