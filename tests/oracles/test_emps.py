"""The electromechanical positioning system EMPS, simulated from its published equations, is identified.

Source: A. Janot, M. Gautier and M. Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear
System Identification Benchmarks (2019). The measured data are not used: this is a simulation.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from fmublock import Block, Input, Parameter, State, build, tanh
from tests.support.toy_fmu import PRODUCER

PUBLISHED = {"M": 95.1089, "F_v": 203.5034, "F_C": 20.3935, "offset": -3.1648}
GAIN = 35.15
"""Force per voltage in N/V."""
K_P, K_V, U_MAX = 160.18, 243.45, 10.0
"""Gains of position in 1/s and of speed in V s/m, largest voltage in V."""
STEP, SMOOTH, DIGIT = 1e-3, 1e-3, 1e-6
"""Sample time in s, speed below which friction acts like a damper in m/s, resolution of the encoder in m."""


class Emps(Block):
    """A carriage on a screw, with viscous and Coulomb friction and an offset."""

    F = Input(unit="N", description="Force of the motor")
    M = Parameter(60.0, unit="kg", minimum=1.0, description="Mass")
    F_v = Parameter(100.0, unit="N.s/m", description="Viscous friction")
    F_C = Parameter(10.0, unit="N", description="Coulomb friction")
    offset = Parameter(0.0, unit="N", description="Offset of friction")
    x = State(0.0, unit="m", description="Position")
    v = State(0.0, unit="m/s", description="Speed")

    def derivatives(self, v: Any) -> dict[str, Any]:
        friction = v.F_v * v.v + v.F_C * tanh(v.v / SMOOTH) + v.offset
        return {"x": v.v, "v": (v.F - friction) / v.M}


def wanted(time: float) -> float:
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
        seen = DIGIT * np.round(x / DIGIT)
        speed = (seen - before) / STEP if k else 0.0
        before = seen
        u = np.clip(
            K_V * (K_P * (wanted(k * STEP) - seen) - speed) + 0.01 * random.standard_normal(), -U_MAX, U_MAX
        )
        rows.append((k * STEP, GAIN * u, seen))
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
    found = ec.identify(
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
        one = found[f"Emps.{name}"]
        assert one.problem is None and one.interval is not None
        assert one.interval[0] <= true <= one.interval[1]
        assert one.value == pytest.approx(true, rel=0.01)
    (fit,) = found.fits
    assert fit.samples == 4001 and fit.is_white and fit.rms == pytest.approx(DIGIT / np.sqrt(12.0), rel=0.05)
