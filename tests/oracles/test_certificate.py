"""Runs keep the bounds that their certificate predicts."""

from pathlib import Path

import numpy as np
import polars
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.study.joint_certificates import (
    JointCertificate,
    _compute_unknown_acceleration,
    build_certificate_rows,
    certify,
)
from fmublock import Block, Output, Parameter
from tests.support.commands import Emla, sentence
from tests.support.joint_data import ROBUST


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> JointCertificate:
    with ec.load("lift", gains="robust", fmus=fmu_folder, stop_time=1.0).prepare() as simulation:
        (certified,) = certify(simulation)
    return certified


def test_constants_equal_those_of_the_gains(lift: JointCertificate) -> None:
    gains = ROBUST["lift"]
    adapting = [d * s for d, s in zip(gains.delta, gains.sigma, strict=True)]
    assert lift.certificate.phi[1:] == tuple(map(min, gains.beta, adapting))
    assert lift.certificate.direct_rate == min(gains.beta) / 2


def test_simulated_errors_are_below_and_near_the_bounds(lift: JointCertificate) -> None:
    bounds = lift.certificate
    assert lift.position_m < bounds.position < 5 * lift.position_m
    assert lift.current_A < bounds.current < 5 * lift.current_A
    assert lift.length < bounds.direct_ultimate < bounds.ultimate


def test_bound_of_the_speed_error_equals_that_of_the_plant(lift: JointCertificate, fmu_folder: Path) -> None:
    """P_2' by the plant's own acceleration, and the derivative of a_1 = -beta_1 / 2 P_1."""
    options = {"gains": "robust", "stop_time": 1.0, "output_interval": 1e-4, "fmus": fmu_folder}
    run = ec.load("lift", **options).prepare().run()
    P_1, P_2 = run["lift.controller.P[1]"], run["lift.controller.P[2]"]
    beta = ROBUST["lift"].beta
    P_2_dot = run["lift.plant.a_L"] - run["lift.reference.a_d"] + beta[0] / 2 * np.gradient(P_1, run["time"])
    disturbance = np.abs(P_2_dot + beta[1] / 2 * P_2 + P_1)[run["time"] >= 0.3].max()
    assert lift.bounds.total[1] == pytest.approx(disturbance, rel=0.1)


def test_violated_assumptions_are_reported(lift: JointCertificate) -> None:
    message = " ".join(lift.remarks)
    assert "Omega_3 there is no prior bound" in message
    assert "held for 0.1 ms" in message
    assert "zeta_i is 0" not in message


def test_no_adaptation_gives_no_bound(fmu_folder: Path) -> None:
    with ec.load("lift", gains="compensated", fmus=fmu_folder, stop_time=0.5).prepare() as simulation:
        (certified,) = certify(simulation)
    assert certified.remarks[0].startswith("zeta_i is 0 for i = 1, 2, 3, 4")
    rows = {label: values for label, _, values in build_certificate_rows([certified])}
    assert rows["|P|: bound of the proof"] == [float("inf")]
    assert rows["position error: simulated"][0] < rows["position error: bound"][0]


class NoJoint(Block):
    """No joint."""

    x = Parameter(1.0)
    y = Output()

    def outputs(self, v: object) -> dict[str, object]:
        return {"y": v.x}  # type: ignore[attr-defined]


def test_system_without_a_joint_is_refused(fmu_folder: Path) -> None:
    system = ec.System((ec.Component("a.b", NoJoint),), ())
    options = {"stop_time": 0.1, "step_size": 0.1, "fmus": fmu_folder}
    with (
        ec.load(system, **options).prepare() as simulation,
        pytest.raises(CommandError, match="has no joint with"),
    ):
        certify(simulation)


def test_command_certifies_several_gains(emla: Emla, tmp_path: Path) -> None:
    folder = tmp_path / "found"
    arguments = ("--table", "certificate", "--stop-time", "0.4", "--output", str(folder))
    result = emla("compare", "lift", "--gains", "robust,published", "--report", *arguments)
    assert result.exit_code == 0
    assert "Certificate of robust" in result.output
    assert "F* of (34)" not in result.output  # assumptions are for the files
    assert "F* of (34)" in (folder / "certificate.html").read_text(encoding="utf-8")
    rows = polars.read_csv(folder / "certificate.csv")
    assert rows.filter(gains="robust", figure="phi_1")["lift"].item() == 1.0
    text = (folder / "certificate.md").read_text(encoding="utf-8")
    assert "## robust" in text
    assert "## published" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--controllers", "foc"), "certificate supports only the controller rsba"),
        (("--workers", "2"), "certificate does not support --seeds"),
        (("--gains", "soft"), "'soft'"),
    ],
)
def test_unsupported_certificates_are_refused(
    arguments: tuple[str, ...], words: str, emla: Emla, tmp_path: Path
) -> None:
    folder = tmp_path / "found"
    command = ("compare", "lift", "--table", "certificate", *arguments, "--output", str(folder))
    assert words in sentence(emla(*command), 2)
    assert not folder.exists()


@pytest.mark.parametrize("measured", [0.0, 1.0])
@pytest.mark.parametrize("modelled", [0.0, 1.0])
def test_unknown_acceleration(measured: float, modelled: float) -> None:
    parameters = {"use_model": modelled, "use_measured_current": measured}
    parameters |= {"model.N_p": 4.0, "model.Phi_PM": 0.1, "model.B_eq": 3.0, "model.A_eq": 20.0}
    numbers = np.random.default_rng(1).normal(size=(5, 6))
    names = ("plant.a_L", "observer.d_hat", "observer.v_hat", "plant.i_q_measured", "controller.i_q_ref")
    a_L, d_hat, v_hat, i_measured, i_ref = numbers
    current = i_measured if measured else i_ref
    expected = a_L - d_hat
    if modelled:
        expected = expected - (1.5 * 4.0 * 0.1 * current - 3.0 * v_hat) / 20.0
    signals = dict(zip(names, numbers, strict=True))
    actual = _compute_unknown_acceleration(
        signals.__getitem__, {f"observer.{name}": x for name, x in parameters.items()}
    )
    assert actual == pytest.approx(expected, rel=1e-12)
