"""The electromechanical positioning system EMPS is identified: simulated from its equations, and measured.

Source: A. Janot, M. Gautier and M. Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear
System Identification Benchmarks (2019). The measured record is not part of this project.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import emla_cosim as ec
from fmublock import Block, Input, Output, Parameter, State, build, maximum, minimum, tanh
from tests.support.paths import ROOT
from tests.support.toy_fmu import PRODUCER

PUBLISHED = {"M": 95.1089, "F_v": 203.5034, "F_C": 20.3935, "offset": -3.1648}
GAIN = 35.15
"""Force per voltage in N/V."""
K_P, K_V, U_MAX = 160.18, 243.45, 10.0
"""Gains of position in 1/s and of speed in V s/m, largest voltage in V."""
STEP, SMOOTH, DIGIT = 1e-3, 1e-3, 1e-6
"""Sample time in s, speed below which friction acts like a damper in m/s, resolution of the encoder in m."""


RECORD = ROOT.parent / "shared/cases/emps/emps.csv"
"""Time in s, reference and position in m, voltage: 24.84 s at 1 kHz."""


class Carriage(Block):
    """A carriage on a screw, with viscous and Coulomb friction and an offset."""

    M = Parameter(60.0, unit="kg", minimum=1.0, description="Mass")
    F_v = Parameter(100.0, unit="N.s/m", description="Viscous friction")
    F_C = Parameter(10.0, unit="N", description="Coulomb friction")
    offset = Parameter(0.0, unit="N", description="Offset of friction")
    x = State(0.0, unit="m", description="Position")
    v = State(0.0, unit="m/s", description="Speed")

    def accelerate(self, v: Any, force: Any) -> Any:
        """Return the acceleration in m/s^2 under a force of the motor in N."""
        return (force - (v.F_v * v.v + v.F_C * tanh(v.v / SMOOTH) + v.offset)) / v.M


class Emps(Carriage):
    """The carriage, driven by a force."""

    F = Input(unit="N", description="Force of the motor")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.v, "v": self.accelerate(v, v.F)}


def reference_position(time: float) -> float:
    """Return the reference position in m: 0.2 m there and back in 1 s each, and half as far as slowly."""
    far, begin, duration = (0.2, 0.0, 1.0) if time < 2.0 else (0.1, 2.0, 1.0)
    s = (time - begin) / duration
    s = min(s, max(2.0 - s, 0.0))
    return far * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)


def measure(seed: int) -> dict[str, np.ndarray]:
    """Return what is recorded of the machine in its loop, whose voltage has noise, with 1 kHz."""
    M, viscous, coulomb, offset = PUBLISHED.values()
    random, parts = np.random.default_rng(seed), 10
    x = v = before = 0.0
    rows = list[tuple[float, float, float]]()
    for k in range(4001):
        rounded = DIGIT * np.round(x / DIGIT)
        speed = (rounded - before) / STEP if k else 0.0
        before = rounded
        u = np.clip(
            K_V * (K_P * (reference_position(k * STEP) - rounded) - speed) + 0.01 * random.standard_normal(),
            -U_MAX,
            U_MAX,
        )
        rows.append((k * STEP, GAIN * u, rounded))
        for _ in range(parts):  # the midpoint rule
            h = STEP / parts

            def accelerate(v: float, u: float = u) -> float:
                return (GAIN * u - viscous * v - coulomb * np.tanh(v / SMOOTH) - offset) / M

            middle = v + 0.5 * h * accelerate(v)
            x, v = x + h * middle, v + h * accelerate(middle)
    time, force, position = np.array(rows).T
    return {"time": time, "F": force, "x": position}


@pytest.mark.slow
def test_published_parameters_of_emps_are_estimated(tmp_path: Path) -> None:
    path = tmp_path / "emps.fmu"
    build(Emps, path, producer=PRODUCER)
    data = measure(0)
    result = ec.identify(
        str(path),
        {"Emps.M": "30:300", "Emps.F_v": "20:2000", "Emps.F_C": "2:200", "Emps.offset": "-30:30"},
        measured=[ec.Input(data={"time": data["time"], "x": data["x"]}, signals={"Emps.x": ec.Column("x")})],
        input=[
            ec.Input(
                data={"time": data["time"], "F": data["F"]},
                signals={"Emps.F": ec.Column("F")},
                interpolation="held",
            )
        ],
        step_size=STEP,
        stop_time=4.0,
        algorithm="jacobi",
        workers=1,
    )
    for name, true in PUBLISHED.items():
        estimate = result[f"Emps.{name}"]
        assert estimate.problem is None and estimate.interval is not None
        assert estimate.interval[0] <= true <= estimate.interval[1]
        assert estimate.value == pytest.approx(true, rel=0.01)
    (fit,) = result.fits
    assert fit.samples == 4001 and fit.is_white and fit.rms == pytest.approx(DIGIT / np.sqrt(12.0), rel=0.05)


# ---- the measured machine ----

RANGES = {"M": (30.0, 300.0), "F_v": (20.0, 2000.0), "F_C": (2.0, 200.0), "offset": (-30.0, 30.0)}
HALF = 12.4
"""Duration of each half of the record in s."""


class EmpsLoop(Carriage):
    """The carriage in its loop of position and speed."""

    q_g = Input(unit="m", description="Reference")
    u = Output(unit="V", description="Voltage")

    def voltage(self, v: Any) -> Any:
        return minimum(U_MAX, maximum(-U_MAX, K_V * (K_P * (v.q_g - v.x) - v.v)))

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.v, "v": self.accelerate(v, GAIN * self.voltage(v))}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"u": self.voltage(v)}


@pytest.fixture(scope="module")
def record() -> np.ndarray:
    if not RECORD.exists():
        pytest.skip("the measured record of EMPS is not here; it is not part of the project.")
    return np.loadtxt(RECORD, delimiter=",", skiprows=1).T


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("emps") / "EmpsLoop.fmu"
    build(EmpsLoop, path, producer=PRODUCER)
    return str(path)


def part(record: np.ndarray, first: int, last: int) -> dict[str, Any]:
    """Return the options of an experiment with these samples, whose times begin at 0."""
    time, reference, position, voltage = record[:, first : last + 1]
    data = {"time": STEP * np.arange(len(time)), "q_ref": reference, "u": voltage}
    return {
        "measured": [ec.Input(data=data, signals={"EmpsLoop.u": "u"})],
        "input": [ec.Input(data=data, signals={"EmpsLoop.q_g": "q_ref"})],
        "set": {"EmpsLoop.x": float(position[0]), "EmpsLoop.v": find_speed(record, first)},
        "stop_time": STEP * (len(time) - 1),
    }


def find_speed(record: np.ndarray, at: int) -> float:
    """Return the speed in m/s at a sample: the slope of a line through those nearby."""
    near = slice(max(at - 5, 0), at + 6)
    return float(np.polyfit(STEP * np.arange(len(record[2, near])), record[2, near], 1)[0])


def simulate(record: np.ndarray, parameters: np.ndarray, speed: float) -> np.ndarray:
    """Return the voltage at the samples for each column of parameters, by RK4, and lines of the reference."""
    mass, viscous, coulomb, offset = parameters
    reference, x = record[1], np.full(parameters.shape[1], record[2, 0])
    v, rows = np.full_like(x, speed), list[np.ndarray]()

    def voltage(q: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.clip(K_V * (K_P * (q - x) - v), -U_MAX, U_MAX)

    def accelerate(q: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return (GAIN * voltage(q, x, v) - viscous * v - coulomb * np.tanh(v / SMOOTH) - offset) / mass

    for begin, end in pairwise(reference.tolist()):
        rows.append(voltage(begin, x, v))
        middle, h = 0.5 * (begin + end), STEP
        a1 = accelerate(begin, x, v)
        a2 = accelerate(middle, x + 0.5 * h * v, v2 := v + 0.5 * h * a1)
        a3 = accelerate(middle, x + 0.5 * h * v2, v3 := v + 0.5 * h * a2)
        a4 = accelerate(end, x + h * v3, v4 := v + h * a3)
        x, v = x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return np.array([*rows, voltage(float(reference[-1]), x, v)])


def fit_with_scipy(record: np.ndarray) -> np.ndarray:
    """Return the least-squares estimates of SciPy."""
    sizes, speed = np.array([90.0, 200.0, 20.0, 3.0]), find_speed(record, 0)

    def residuals(scaled: np.ndarray) -> np.ndarray:
        return simulate(record, (sizes * scaled)[:, None], speed)[:, 0] - record[3]

    def slopes(scaled: np.ndarray) -> np.ndarray:
        step = 1e-4
        varied = scaled[:, None] + step * np.column_stack([np.zeros(4), np.eye(4)])
        voltages = simulate(record, sizes[:, None] * varied, speed)
        return (voltages[:, 1:] - voltages[:, :1]) / step

    start = np.array([60.0, 100.0, 10.0, 0.0]) / sizes
    solution = least_squares(residuals, start, slopes, xtol=1e-6, ftol=1e-8)
    return sizes * solution.x


@pytest.mark.slow
def test_published_values_are_inside_three_standard_errors_of_the_measured_drive(
    record: np.ndarray, loop: str
) -> None:
    vary = {f"EmpsLoop.{name}": f"{low}:{high}" for name, (low, high) in RANGES.items()}
    result = ec.identify(loop, vary, step_size=STEP, workers=1, **part(record, 0, record.shape[1] - 1))
    for name, published in PUBLISHED.items():
        estimate = result[f"EmpsLoop.{name}"]
        assert estimate.error is not None and abs(estimate.value - published) < 3.0 * estimate.error
        assert estimate.step_change is not None and abs(estimate.step_change) < 0.1
    assert result["EmpsLoop.F_v"].value == pytest.approx(PUBLISHED["F_v"], rel=0.05)
    assert any("ms earlier than predicted" in note for note in result.notes)


@pytest.mark.slow
def test_second_half_is_predicted_as_well_as_by_scipy(record: np.ndarray, loop: str) -> None:
    middle, last = round(HALF / STEP), record.shape[1] - 1
    first, second = part(record, 0, middle), part(record, middle, last)
    vary = {f"EmpsLoop.{name}": f"{low}:{high}" for name, (low, high) in RANGES.items()}
    held_out = ec.Experiment(
        "second", second["measured"], {n: second[n] for n in ("input", "set", "stop_time")}, held_out=True
    )
    result = ec.identify(loop, vary, experiments=[held_out], step_size=STEP, workers=1, **first)
    expected = fit_with_scipy(record[:, : middle + 1])
    for name, value in zip(RANGES, expected, strict=True):
        estimate = result[f"EmpsLoop.{name}"]
        assert estimate.value == pytest.approx(value, abs=0.1 * float(estimate.error or 0.0))
    rest = record[:, middle:]
    predicted = simulate(rest, expected[:, None], find_speed(record, middle))[:, 0]
    rms_of_scipy = np.sqrt(np.mean((predicted - rest[3]) ** 2))
    rms = next(fit.rms for fit in result.fits if fit.held_out)
    assert rms < 1.1 * rms_of_scipy
