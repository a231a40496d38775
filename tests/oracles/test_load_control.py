"""Commands of a screw and the observer of its load: properties, poles, and a two-mass model of its own."""

import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import logm

from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.study.joints.motions import LoadFeedback
from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.load_control import observer_parameters
from emla_cosim.study.systems import joint_system
from emla_fmu import EmlaCompliantPlant, LoadObserver, ScrewCommand
from fmublock import Instance
from fmublock.instance import BlockError
from tests.support.in_process import started
from tests.support.reference_drive import Transmission
from tests.support.reference_load_control import STEP, Load, Observer
from tests.support.reference_model import Vector
from tests.support.simulated import simulated
from tests.support.tiers import examples, mostly_slow

Motion = tuple[Vector, Vector, Vector]


def quintic(distance: float, duration: float, t: Vector) -> Motion:
    """Position, speed and acceleration of a move from rest to rest."""
    p = distance * Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    r = np.minimum(t / duration, 1.0)
    return p(r), p.deriv()(r) / duration, p.deriv(2)(r) / duration**2


def commanded(values: dict[str, Any], motion: Motion, h: float, time: float = 0.0, **inputs: float) -> Vector:
    """x_c, v_c and a_c at each row of a motion, whose source steps first."""
    command = Instance(ScrewCommand())
    for name, value in (values | inputs).items():
        command[name] = value
    command.setup_experiment(time)
    rows = []
    for k, row in enumerate(zip(*motion, strict=True)):
        for name, value in zip(("x_d", "v_d", "a_d"), row, strict=True):
            command[name] = float(value)
        if k == 0:
            command.enter_initialization()
            command.exit_initialization()
        else:
            command.do_step(time + (k - 1) * h, h)
        rows.append([command[name] for name in ("x_c", "v_c", "a_c")])
    return np.array(rows).T


# ---- notches -----------------------------------------------------------------------------------


@given(st.floats(1.0, 50.0), st.floats(0.5, 3.0))
@examples(2, 10)
def test_swing_after_a_shaped_move_matches_the_transfer_function(frequency: float, swings: float) -> None:
    """A swing without damping is left with |integral of v exp(-i w t)|; a notch multiplies it by |G(i w)|."""
    duration, h = swings / frequency, 1.0 / (250.0 * frequency)
    t = h * np.arange(round(duration / h) + 1000)
    values = {"notch.frequency[1]": frequency, "solver.internal_step": h}
    shaped = commanded(values, quintic(0.1, duration, t), h)[1]
    ratios = np.array([0.5, 0.8, 0.9, 1.0, 1.1, 1.25, 2.0])
    omega = 2.0 * math.pi * frequency * ratios
    with_notch = np.array([abs(np.trapezoid(shaped * np.exp(-1j * w * t), t)) for w in omega])
    without = np.array(
        [abs(np.trapezoid(quintic(0.1, duration, t)[1] * np.exp(-1j * w * t), t)) for w in omega]
    )
    gain = ((1.0 - ratios**2) / (1.0 + ratios**2)) ** 2
    assert gain[3] == 0.0
    # positions that move on lines between steps leave 8 (w h)^2 / 12 at the notch
    assert (np.abs(with_notch - gain * without) <= 1e-3 * without + 1e-7).all()


def test_damped_swing_rests_after_a_shaped_move() -> None:
    """Two swings with damping, which the move in 0.2 s excites; long after its end."""
    h, swings = 1e-3, ((6.5, 0.05), (15.0, 0.02))
    t = h * np.arange(1201)
    move = quintic(0.1, 0.2, t)
    values: dict[str, Any] = {"solver.internal_step": h}
    for i, (frequency, zeta) in enumerate(swings, 1):
        values |= {f"notch.frequency[{i}]": frequency, f"notch.damping_ratio[{i}]": zeta}
    shaped = commanded(values, move, h)

    def swing(x: Vector, v: Vector, frequency: float, zeta: float) -> float:
        """The largest distance from the end after 0.75 s."""
        w, driven = 2.0 * math.pi * frequency, CubicHermiteSpline(t, x, v)
        rates = lambda s, y: [y[1], w * w * (driven(s) - y[0]) - 2.0 * zeta * w * y[1]]  # noqa: E731
        solution = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], "DOP853", t, rtol=1e-9, atol=1e-12)
        return float(np.abs(solution.y[0][t > 0.75] - 0.1).max())

    for frequency, zeta in swings:
        assert swing(*move[:2], frequency, zeta) > 1e-4
        assert swing(*shaped[:2], frequency, zeta) < 1e-6


@given(
    st.lists(st.floats(0.0, 1e-2), min_size=20, max_size=60),
    st.tuples(st.floats(0.5, 30.0), st.floats(0.5, 30.0)),
    st.floats(0.0, 0.9),
)
@examples(10, 200)
def test_position_that_only_rises_is_never_exceeded(
    rises: list[float], frequencies: tuple[float, float], zeta: float
) -> None:
    x = np.cumsum([0.3, *rises])
    values = {f"notch.frequency[{i}]": f for i, f in enumerate(frequencies, 1)}
    values |= {"notch.damping_ratio[1]": zeta, "solver.internal_step": 2e-3}
    shaped = commanded(values, (x, 0.0 * x, 0.0 * x), 4e-3)[0]
    assert (shaped <= x + 1e-9).all()


# ---- the approach ------------------------------------------------------------------------------


@given(st.floats(-0.02, 0.02), st.floats(0.05, 0.3), st.floats(0.1, 5.0), st.floats(-7.0, 7.0))
@examples(5, 50)
def test_approach_keeps_its_limits_and_begins_and_ends_smoothly(
    gap: float, shortest: float, a_max: float, time: float
) -> None:
    duration = max(shortest, math.sqrt(9.37199 * abs(gap) / a_max))
    values = {"approach.duration": shortest, "approach.a_max": a_max, "limit.v_max": 1e3}
    count = 200
    rest = (np.full(count + 2, 0.3), np.zeros(count + 2), np.zeros(count + 2))
    h = duration / count
    x, _, a = commanded(values | {"solver.internal_step": h}, rest, h, time, x_1=0.3 + gap)
    assert x[0] == pytest.approx(0.3 + gap, abs=1e-15)
    assert x[-1] == pytest.approx(0.3, abs=1e-15)
    assert np.abs(a).max() <= a_max * (1.0 + 1e-9)
    r = np.arange(count + 2) / count
    near = r <= 0.05  # where the first four derivatives are 0, a polynomial grows with r^5
    for distance in (np.abs(x - x[0]), np.abs(x - x[-1])[::-1][1:]):
        ahead = near[: len(distance)]
        assert (distance[ahead] <= 126.0 * abs(gap) * r[: len(distance)][ahead] ** 5 + 1e-12).all()
    assert max(shortest / duration, np.abs(a).max() / a_max) == pytest.approx(1.0, abs=2e-3)


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.3, 1.2))
@examples(2, 30)
def test_approach_waits_while_the_motion_needs_the_speed(gap: float, distance: float, part: float) -> None:
    """Speed and acceleration are derivatives, the largest speed is kept, and the load arrives.

    Where the motion alone needs all the speed, the approach stops, and the acceleration jumps to that of the
    motion: it is not a derivative there.
    """
    h, duration = 2e-3, 1.0
    t = h * np.arange(round(5.0 / h))
    x_d, v_d, a_d = quintic(distance, duration, t)
    v_max = max(1.875 * abs(distance) / (part * duration), 0.03)  # the motion alone can need more
    values = {
        "approach.duration": 0.2,
        "approach.a_max": 1.0,
        "limit.v_max": v_max,
        "solver.internal_step": h,
    }
    x, v, a = commanded(values, (x_d, v_d, a_d), h, x_1=gap)
    assert np.abs(v).max() <= max(v_max, np.abs(v_d).max()) * (1.0 + 1e-9)
    assert x[0] == pytest.approx(gap, abs=1e-15)
    assert x[-1] == pytest.approx(distance, abs=1e-12)
    smooth = slice(2, None)
    assert np.abs(np.gradient(x, h) - v)[smooth].max() < 0.02 * max(np.abs(v).max(), 1e-3)
    if part < 0.95:
        assert np.abs(np.gradient(v, h) - a)[smooth].max() < 0.02 * max(np.abs(a).max(), 1e-3)


def test_jumps_of_force_and_acceleration_command_no_impossible_speed() -> None:
    h, count = 1e-3, 400
    values = {"model.stiffness": 1e7, "model.m_load": 2e4, "limit.v_max": 0.1}
    jumps = np.where(np.arange(count) * h >= 0.2, 1.0, 0.0)
    x, v, _ = commanded(values, (0.0 * jumps, 0.0 * jumps, jumps), h)
    assert np.abs(v).max() == pytest.approx(0.1)
    assert np.abs(np.diff(x)).max() == pytest.approx(0.1 * h)
    assert x[-1] == pytest.approx(2e4 / 1e7)


def test_start_matches_the_first_step_at_any_time() -> None:
    """Also in hosts that do not exchange values in initialization."""
    t = 1e-3 * np.arange(200)
    motion = quintic(0.05, 0.15, t)
    values = {
        "notch.frequency[1]": 12.0,
        "approach.duration": 0.1,
        "model.stiffness": 1e7,
        "model.m_load": 900.0,
    }
    expected = commanded(values, motion, 1e-3, x_1=0.02, F_hat=2e3)
    later = commanded(values, motion, 1e-3, time=40.0, x_1=0.02, F_hat=2e3)
    assert later == pytest.approx(expected, rel=1e-9, abs=1e-9)
    command = started(ScrewCommand, values)
    command["x_1"], command["F_hat"] = 0.02, 2e3
    for k, row in enumerate(zip(*motion, strict=True)):
        for name, value in zip(("x_d", "v_d", "a_d"), row, strict=True):
            command[name] = float(value)
        if k > 0:
            command.do_step((k - 1) * 1e-3, 1e-3)
            assert command["x_c"] == pytest.approx(expected[0][k], abs=1e-7)


# ---- the deflection ----------------------------------------------------------------------------


def test_load_on_a_commanded_screw_follows_the_reference() -> None:
    """The screw makes the commanded motion; the start is 5 mm off, and the load weighs 57 kN."""
    k, m, force, h = 1e8, 43e3, 57e3, 1e-3
    t = h * np.arange(1001)
    move = quintic(0.05, 0.8, t)
    values = {"model.stiffness": k, "model.m_load": m, "approach.duration": 0.3, "approach.a_max": 2.0}
    values["limit.v_max"] = 1e3
    x_c, v_c, a_c = commanded(values | {"solver.internal_step": h}, move, h, x_1=-4.5e-3, F_hat=force)
    planned = x_c - (force + m * a_c) / k
    start = -4.5e-3 - force / k
    assert planned[0] == pytest.approx(start, abs=1e-15)
    assert planned[400:] == pytest.approx(move[0][400:], abs=1e-15)
    # the speed of x_p is that of the step's end
    assert v_c[2:] == pytest.approx(np.diff(x_c)[1:] / h, abs=0.6 * h * np.abs(a_c).max())
    screw = CubicHermiteSpline(t, x_c, np.gradient(x_c, h))
    rates = lambda s, y: [y[1], (k * (screw(s) - y[0]) - force) / m]  # noqa: E731
    load = solve_ivp(rates, (0.0, 1.0), [start, 0.0], "DOP853", t, rtol=1e-11, atol=1e-14).y[0]
    assert load == pytest.approx(planned, abs=2e-8)
    assert np.abs(m * a_c / k).max() > 1e-4


def test_play_is_on_the_side_of_the_force() -> None:
    values = {"model.stiffness": 1e8, "model.backlash": 4e-5}
    for force in (5e3, 0.0, -5e3):
        command = started(ScrewCommand, values | {"F_hat": force, "x_d": 0.2})
        expected = 0.2 + force / 1e8 + 2e-5 * np.sign(force)
        assert command["x_c"] == pytest.approx(expected, abs=1e-15)


def test_correction_stops_at_its_limit() -> None:
    command = started(ScrewCommand, {"feedback.k_0": 10.0, "feedback.limit": 1e-3, "load.x": 0.01})
    for k in range(20):
        command.do_step(1e-3 * k, 1e-3)
    assert command["x_c"] == -1e-3
    assert command["v_c"] == 0.0
    command["load.x"] = -0.01
    command.do_step(20e-3, 1e-3)
    assert command["x_c"] == pytest.approx(-0.9e-3)
    assert command["v_c"] == pytest.approx(0.1)


def test_notch_that_is_too_fast_is_refused() -> None:
    with pytest.raises(BlockError, match=r"2 pi notch\.frequency solver\.internal_step must be at most 1\."):
        started(ScrewCommand, {"notch.frequency[2]": 4000.0})


# ---- the observer ------------------------------------------------------------------------------


def observer_matrix(values: dict[str, float]) -> Vector:
    """A of the estimates, from what one step makes of each of them."""
    h, states = 1e-4, ("travel", "v_hat", "f_hat")
    columns = []
    for name in states:
        observer = started(LoadObserver, values | {name: 1.0, "solver.internal_step": 1e-6})
        observer.do_step(0.0, h)
        columns.append([observer[state] for state in states])
    return np.real(logm(np.array(columns).T)) / h


@pytest.mark.parametrize("joint", ["lift", "tilt", "telescope"])
def test_poles_match_the_joint_file(joint: str) -> None:
    file = load_joint(joint)
    load, feedback = file.compliant_load, file.load_feedback
    attributes = {p.attribute: p.name for p in LoadObserver.layout().parameters}
    values = {attributes[name]: x for name, x in observer_parameters(load, feedback).items()}
    w = feedback.observer * load.omega
    coefficients = np.poly(observer_matrix(values)) / [1.0, w, w * w, w**3]
    assert coefficients == pytest.approx([1.0, 3.0, 3.0, 1.0], rel=1e-6)


@given(st.floats(0.0, 0.7), st.floats(0.0, 1.0), st.floats(5.0, 200.0))
def test_feedback_places_the_poles_of_the_load(zeta: float, p: float, omega: float) -> None:
    """The load's error e behind a screw that follows at once: e'' = omega^2 (z - e)."""
    gains = LoadFeedback(damping_ratio=zeta, integral=p).gains(omega)
    k_0, k_1, k_2 = (gains[f"k_{i}"] for i in range(3))
    square = omega * omega
    A = np.array([[0.0, 1.0, 0.0], [-square, 0.0, square], [k_2 * square - k_0, -k_1, -k_2 * square]])
    expected = np.polymul([1.0, p * omega], [1.0, 2.0 * zeta * omega, square])
    scale = np.array([1.0, omega, square, omega * square])
    assert np.poly(A) / scale == pytest.approx(expected / scale, abs=1e-9)


def test_estimate_is_not_half_a_step_ahead() -> None:
    """Of a load that moves at 0.1 m/s, measured at each step's end: 5 um without interpolation."""
    errors = {}
    for interpolate in (True, False):
        values = {"interpolate": interpolate, "y": 0.2, "x_1": 0.2, "solver.internal_step": 1e-4}
        observer = started(LoadObserver, values)
        for k in range(3000):
            position = 0.2 + 1e-5 * k
            observer["y"], observer["x_1"], observer["v_1"] = position, position, 0.1
            observer.do_step(1e-4 * k, 1e-4)
        errors[interpolate] = observer["x_hat"] - position
    assert errors[True] == pytest.approx(0.0, abs=1e-9)
    assert errors[False] == pytest.approx(5e-6, rel=0.1)


@pytest.mark.parametrize(("deflection", "force"), [(3e-5, 1e3), (-3e-5, -1e3), (1e-5, 0.0), (-2e-5, 0.0)])
def test_force_at_the_start_matches_the_spring(deflection: float, force: float) -> None:
    """A play of 40 um: within it there is no force."""
    values = {"model.backlash": 4e-5, "x_1": 0.2 + deflection, "y": 0.2}
    assert started(LoadObserver, values)["F_0"] == pytest.approx(force, abs=1e-6)


def test_unstable_gains_are_refused() -> None:
    with pytest.raises(BlockError, match=r"the observer is unstable: l_3 must be at most .* of the model\."):
        started(LoadObserver, {"l_3": 1e10})
    started(LoadObserver, {"l_1": 0.0, "l_2": 0.0, "l_3": 0.0})


def test_load_sensor_has_separate_noise_and_resolution() -> None:
    values = {"load.sensor.sigma": 1e-6, "sensor.sigma": 1e-6, "use_commanded_current": True}
    plant = started(EmlaCompliantPlant, values)
    noise = []
    for k in range(2000):
        plant.do_step(1e-4 * k, 1e-4)
        noise.append((plant["load.x_measured"] - plant["load.x"], plant["x_measured"] - plant["x_L"]))
    load, motor = 1e6 * np.array(noise).T
    assert load.mean() == pytest.approx(0.0, abs=0.1)
    assert load.std() == pytest.approx(1.0, rel=0.06)
    assert abs(np.corrcoef(load, motor)[0, 1]) < 0.1
    rounded = started(EmlaCompliantPlant, {"load.sensor.resolution": 1e-3, "start.deflection": 3e-4})
    assert rounded["load.x_measured"] == pytest.approx(0.240, abs=1e-15)
    assert rounded["load.x"] == 0.24 - 3e-4


# ---- the lift of study-compliant against a two-mass model of its own ---------------------------

STOP, H = 1.5, 1e-4


def lift_run(load_control: str, factor: float, folder: Path) -> tuple[Vector, Vector]:
    """Times, and the error of the load in m; the plant has another stiffness than the command knows."""
    load = load_joint("lift").compliant_load
    system = joint_system(load_joint("lift"), "rsba", "compliant", compliant=True, load_control=load_control)
    stiffness = factor * load.stiffness
    start = 57e3 / stiffness + 0.5 * load.backlash
    plant = {"transmission.stiffness": stiffness, "start.deflection": start}
    system = system.with_parameters({f"lift.plant.{name}": value for name, value in plant.items()})
    fmus = {c.name: folder / c.model / f"{c.model}.fmu" for c in system.components}
    with Assembly(system, fmus) as assembly:
        columns = {name: 1 + i for i, name in enumerate(assembly.network.names)}
        rows = simulated(assembly.network, ALGORITHMS["gauss-seidel"](), make_communication_points(STOP, H))
    rows = rows[::10]
    return rows[:, 0], rows[:, columns["lift.plant.load.x"]] - rows[:, columns["lift.reference.x_d"]]


def lift_model(load_control: str, factor: float, t: Vector) -> Vector:
    """The error of the load in m behind a screw that makes the commanded motion, in continuous time."""
    file = load_joint("lift")
    sheet, feedback = file.compliant_load, file.load_feedback
    k, m, c, b = sheet.stiffness, sheet.mass, sheet.damping, sheet.backlash
    actual = Transmission(m=m, k=factor * k, c=c, b=b)
    measured, force = load_control == "sensor", 57e3
    start = 0.24 - force / actual.k - 0.5 * b
    assumed = k * force / actual.k if measured else force
    duration, distance = file.reference.parameters()["duration"][0], 0.026
    move = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    moves, steps = ([p, p.deriv(), p.deriv(2), p.deriv(3)] for p in (move, STEP - 1.0))
    gap = 0.24 - assumed / k - 0.5 * b - 0.244
    # the limit of its acceleration, which is a tenth of what the motor can, is the longest of three
    limit = joint_system(file, "rsba", "compliant", compliant=True).component("lift.command").parameters
    T = math.sqrt(9.37199 * abs(gap) / limit["approach.a_max"])
    A, B = Observer(Load(k, m, c, b), (0.0, 0.0, 0.0)).matrices  # for the acceleration alone
    w = feedback.observer * sheet.omega
    gains = feedback.gains(sheet.omega) if measured else dict.fromkeys(("k_0", "k_1", "k_2"), 0.0)

    def planned_motion(s: float) -> list[float]:
        """Position, speed, acceleration and jerk of the planned motion."""
        moving, arriving = min(s / duration, 1.0), min(s / T, 1.0)
        parts = [
            distance * p(moving) / duration**order - gap * q(arriving) / T**order
            for order, (p, q) in enumerate(zip(moves, steps, strict=True))
        ]
        return [parts[0] + 0.244, *parts[1:]]

    def rates(s: float, state: Vector) -> list[float]:
        x, v, x_hat, v_hat, f_hat, z = state
        x_p, v_p, a_p, j_p = planned_motion(s)
        x_1, v_1 = x_p + (m * a_p + assumed) / k + 0.5 * b + z, v_p + m * j_p / k
        model = A[1] @ [x_hat - start, v_hat, f_hat] + B[1, 1:] @ [x_1 - 0.24, v_1]
        rate = -(gains["k_0"] * (x_hat - x_p) + gains["k_1"] * (v_hat - v_p) + gains["k_2"] * (model - a_p))
        rate /= 1.0 + gains["k_2"] * c / m  # the damper feels it at once
        v_1, model = v_1 + rate, model + c / m * rate
        e = x - x_hat
        l_1 = 3.0 * w - c / m
        return [
            v,
            (actual.force(x_1 - x, v_1 - v) - force) / m,
            v_hat + l_1 * e,
            model + (3.0 * w * w - (k + c * l_1) / m) * e,
            w**3 * e,
            rate,
        ]

    state = [start, 0.0, start, 0.0, 0.0, 0.0]
    solution = solve_ivp(rates, (0.0, STOP), state, "DOP853", t, rtol=1e-8, atol=1e-11, max_step=0.02)
    return solution.y[0] - np.array([0.244 + distance * move(min(s / duration, 1.0)) for s in t])


@pytest.mark.parametrize(
    ("load_control", "factor"),
    mostly_slow(product(("motor", "sensor"), (1.0, 0.7, 1.3)), [("motor", 0.7), ("sensor", 1.3)]),
)
def test_lift_follows_its_two_mass_model(load_control: str, factor: float, fmu_folder: Path) -> None:
    """Up to what the screw itself is off: 251 um motor-side at 70 % of the stiffness, 33 um with a sensor."""
    t, error = lift_run(load_control, factor, fmu_folder)
    expected = lift_model(load_control, factor, t)
    assert error[t >= 0.4] == pytest.approx(expected[t >= 0.4], abs=4e-6)


def test_load_of_the_lift_hangs_on_its_spring_without_control(fmu_folder: Path) -> None:
    t, error = lift_run("none", 1.0, fmu_folder)
    load = load_joint("lift").compliant_load
    period = 2.0 * math.pi / load.omega
    last = t > STOP - 4.0 * period
    assert error[last].mean() == pytest.approx(-57e3 / load.stiffness - 0.5 * load.backlash, rel=0.02)
    assert np.abs(error[t > 0.4]).max() > 800e-6
