"""The stability certificate of a scenario's RSBA gains: predictions of the proof beside a simulation."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsba_fmu.certificate import Bounds, Certificate, ControlGains, Four, ObserverConstants, certificate

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..recorders.table import TimeSeries
from ..run.simulation import Simulation
from .criteria import EVALUATED_AFTER
from .roles import find_variable

_SUBSYSTEMS = (1, 2, 3, 4)


@dataclass(frozen=True)
class JointCertificate:
    """The certificate of a joint, for bounds measured in a run.

    Attributes:
        position_m: Largest simulated position error from 0.3 s on; so are the next three.
        length: The length of P.
        current_A: P_3.
        observer_m: The observer's position error.
        remarks: Assumptions of the proof that do not hold.
    """

    joint: str
    certificate: Certificate
    bounds: Bounds
    position_m: float
    length: float
    current_A: float
    observer_m: float
    remarks: Sequence[str]


def certify(simulation: Simulation) -> list[JointCertificate]:
    """Run a prepared scenario once, and return the certificate of each joint that has an `RsbaController`.

    The bounds are those of the run itself. D_i is the largest |P_i' + (beta_i + zeta_i theta_i) / 2 P_i|
    without the terms that connect the subsystems. By (36) and (39) it covers Lambda_i r_i, d_max(i) and
    Omega_i.

    Raises:
        CommandError: No joint has such a controller.
        RunError: The run fails.
    """
    names = set(simulation.names)
    needed = (".controller.P[4]", ".observer.x_hat", ".plant.x_L")
    branches = dict.fromkeys(name.partition(".")[0] for name in simulation.names)
    joints = [joint for joint in branches if all(joint + name in names for name in needed)]
    if not joints:
        raise CommandError(
            f"'{simulation.name}' has no joint with our plant, an RSBA controller and our observer."
        )
    references = [name for joint in joints if (name := find_variable(joint, "x_c", names)) is not None]
    patterns = [f"{joint}.{part}" for joint in joints for part in ("controller.*", "plant.*", "observer.*")]
    step = simulation.options.step_size
    result = simulation.run(recorders=[TimeSeries()], signals=[*patterns, *references], output_interval=step)
    columns = result.read(["time", *result.names])
    return [_certify_joint(joint, columns, result.parameters) for joint in joints]


def _certify_joint(
    joint: str, columns: Mapping[str, Vector], parameters: Mapping[str, float]
) -> JointCertificate:
    """Return the certificate of a joint, from the rows of its run."""
    time = columns["time"]
    # a run shorter than that is evaluated in its second half
    is_evaluated = time - time[0] >= min(EVALUATED_AFTER, 0.5 * (time[-1] - time[0]))

    def get_signal(name: str) -> Vector:
        return columns[f"{joint}.{name}"]

    def read_four(name: str) -> Four:
        a, b, c, d = (values[f"controller.{name}[{i}]"] for i in _SUBSYSTEMS)
        return a, b, c, d

    prefix = f"{joint}."
    values = {name.removeprefix(prefix): x for name, x in parameters.items() if name.startswith(prefix)}
    gains = ControlGains(read_four("beta"), read_four("zeta"), read_four("delta"), read_four("sigma"))
    names = ("alpha_1", "alpha_2", "Q_11", "Q_12", "Q_22", "ell", "m_0", "m_decay")
    alpha_1, alpha_2, Q_11, Q_12, Q_22, *scalars = (values[f"observer.{name}"] for name in names)
    observer = ObserverConstants((alpha_1, alpha_2), (Q_11, Q_12, Q_22), *scalars)
    P = np.array([get_signal(f"controller.P[{i}]") for i in _SUBSYSTEMS])
    # the adaptation makes the gain of (39) vary, so D_i is measured with it
    theta = np.array([get_signal(f"controller.theta[{i}]") for i in _SUBSYSTEMS])
    D = np.abs(_compute_disturbances(time, P, theta, gains))[:, is_evaluated].max(axis=1)
    unknown = np.abs(_compute_unknown_acceleration(get_signal, values))[is_evaluated].max()
    bounds = Bounds((D[0], D[1], D[2], D[3]), float(unknown), float(time[-1] - time[0]))
    saturated = np.maximum(get_signal("controller.saturated"), get_signal("plant.inverter.saturated"))
    limited = float(np.mean(saturated[is_evaluated] > 0))
    travel = float(np.abs(np.diff(get_signal("plant.x_L")[is_evaluated])).max())
    step = float(time[1] - time[0])
    error = get_signal("plant.x_L") - columns[str(find_variable(joint, "x_c", columns))]
    observer_error = get_signal("observer.x_hat") - get_signal("plant.x_L")
    return JointCertificate(
        joint,
        certificate(gains, observer, bounds),
        bounds,
        float(np.abs(error[is_evaluated]).max()),
        float(np.linalg.norm(P[:, is_evaluated], axis=0).max()),
        float(np.abs(P[2, is_evaluated]).max()),
        float(np.abs(observer_error[is_evaluated]).max()),
        list(_list_remarks(gains, values, step, limited, travel)),
    )


def _compute_disturbances(time: Vector, P: Vector, theta: Vector, gains: ControlGains) -> Vector:
    """Return F_i + d_i - x_id' of (36), computed from the derivative of P_i by (39)."""
    gain = (np.array(gains.beta)[:, None] + np.array(gains.zeta)[:, None] * theta) / 2.0
    disturbances = np.gradient(P, time, axis=1) + gain * P
    disturbances[0] -= P[1]
    disturbances[1] += P[0]
    return disturbances


def _compute_unknown_acceleration(get_signal: Any, values: Mapping[str, float]) -> Vector:
    """Return K_2 of (17) in m/s2: the acceleration of the screw that the observer does not model."""
    acceleration = get_signal("plant.a_L") - get_signal("observer.d_hat")
    if not values["observer.use_model"]:
        return acceleration
    current = get_signal(
        "plant.i_q_measured" if values["observer.use_measured_current"] else "controller.i_q_ref"
    )
    N_p, Phi_PM, B_eq, A_eq = (values[f"observer.model.{name}"] for name in ("N_p", "Phi_PM", "B_eq", "A_eq"))
    return acceleration - (1.5 * N_p * Phi_PM * current - B_eq * get_signal("observer.v_hat")) / A_eq


def _list_remarks(
    gains: ControlGains, values: Mapping[str, float], step: float, saturated_fraction: float, travel: float
) -> Iterator[str]:
    """Yield the assumptions of the proof that do not hold for this loop."""
    slowest, fastest = min(gains.beta), max(gains.beta)
    forgetting = min(delta * sigma for delta, sigma in zip(gains.delta, gains.sigma, strict=True))
    if no_zeta := [str(i) for i, zeta in zip(_SUBSYSTEMS, gains.zeta, strict=True) if zeta == 0.0]:
        yield f"zeta_i is 0 for i = {', '.join(no_zeta)}: (43) divides by it, so nothing is proved."
    if forgetting < 0.1 * slowest:
        yield (
            f"The smallest of phi_1 to phi_4 is theta_hat's decay, delta_i sigma_i = {forgetting:.3g} 1/s, "
            f"{slowest / max(forgetting, 1e-300):.3g} times slower than the loops."
        )
    if values["observer.m_decay"] > 0.0:
        yield (
            "(22) requires a finite integral of m(t), (55) a positive infimum. Over unlimited time both "
            "are impossible; phi_0 is that of this run."
        )
    yield "(19) requires K along p^-1 C'. Loads act on the speed alone, so they violate this."
    yield (
        f"Measurements are held for a step, in which the joint moves {1e6 * travel:.3g} µm at most. "
        f"Their resolution is {1e6 * values.get('plant.sensor.resolution', 0.0):.2g} µm. The bound of the "
        "observer's error ignores both."
    )
    if values.get("observer.omega_d", 0.0) > 0.0:
        yield "The observer estimates the disturbance as a third state, which (44) does not have."
    if not values["plant.use_commanded_current"]:
        yield (
            "x_3d is u_2, for whose derivative Omega_3 there is no prior bound, and P_3 acts on the speed, "
            "which (36) omits. Both are measured here."
        )
    yield "F* of (34) contains P_1 and P_2 themselves, so Lambda_2 r_2 is known only after the run."
    yield (
        f"The proof is for continuous laws. Here they are held for {1e3 * step:g} ms, in which the "
        f"fastest loop decays by {100 * (1 - math.exp(-0.5 * fastest * step)):.2g} %."
    )
    if values.get("plant.inverter.delay", 0.0) > 0.0:
        yield "The proof ignores the delay of the inverter."
    if saturated_fraction > 0.0:
        yield (
            f"A limit is active {100 * saturated_fraction:.2g} % of the time; the laws are not applied then."
        )


def _list_figures(joint: JointCertificate) -> list[tuple[str, str, float]]:
    """Return label, unit and value of each figure of a certificate."""
    proof, units = joint.certificate, ("m/s", "m/s2", "A/s", "A/s")
    return [
        *((f"phi_{i}", "1/s", proof.phi[i]) for i in range(5)),
        ("phi_total", "1/s", proof.phi_total),
        ("predicted decay of |P|, proof", "1/s", proof.rate),
        ("predicted decay of |P|, without adaptation", "1/s", proof.direct_rate),
        *((f"D_{i + 1} measured", unit, joint.bounds.total[i]) for i, unit in enumerate(units)),
        *((f"theta*_{i + 1}", "", proof.theta_star[i]) for i in range(4)),
        ("|P|: bound of the proof", "", proof.ultimate),
        ("|P|: bound without adaptation", "", proof.direct_ultimate),
        ("|P|: simulated", "", joint.length),
        ("position error: bound", "µm", 1e6 * proof.position),
        ("position error: simulated", "µm", 1e6 * joint.position_m),
        ("current error: bound", "A", proof.current),
        ("current error: simulated", "A", joint.current_A),
        ("observer error: bound, of K_2 alone", "µm", 1e6 * proof.observer_position),
        ("observer error: simulated", "µm", 1e6 * joint.observer_m),
    ]


def build_certificate_rows(certificates: Sequence[JointCertificate]) -> list[tuple[str, str, list[float]]]:
    """Return the rows of the table: label, unit, and the values by joint; inf if there is no bound."""
    rows = zip(*map(_list_figures, certificates), strict=True)
    return [(row[0][0], row[0][1], [value for _, _, value in row]) for row in rows]
