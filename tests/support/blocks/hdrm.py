"""Facts about the blocks of the paper's manipulator."""

import random
from itertools import accumulate
from typing import Any

from hypothesis import strategies as st

from machine_fmu.spline import Spline, trajectory_parameters
from machine_fmu.spline_window import DEGREE, KNOTS
from machine_fmu.trajectory import JOINTS
from tests.support.blocks.facts import BlockFacts, Draw, Point, magnitude, magnitudes, signed, signs


@st.composite
def trajectory_points(draw: Draw) -> Point:
    """A time within a span of a spline whose spans are of different length."""
    degree, spans = draw(st.integers(1, DEGREE)), draw(st.integers(1, 20))
    drawn = random.Random(draw(st.integers(0, 1000)))  # a hundred values that need not shrink
    breaks = list(accumulate([0.5, *(drawn.uniform(0.3, 2.0) for _ in range(spans))]))
    knots = [breaks[0]] * degree + breaks + [breaks[-1]] * (KNOTS - degree - len(breaks))
    k, part = draw(st.integers(0, spans - 1)), draw(st.floats(0.1, 0.9))
    values: dict[str, Any] = {f"knot[{i}]": x for i, x in enumerate(knots, 1)}
    reach = dict.fromkeys(values, 0.1)
    for joint in JOINTS:
        values |= {f"coefficient.{joint}[{i + 1}]": drawn.uniform(0.1, 0.5) for i in range(spans + degree)}
    time = breaks[k] + part * (breaks[k + 1] - breaks[k])
    return Point({**values, "degree": degree}, time, reach=reach)


def machine(draw: Draw) -> dict[str, Any]:
    """Parameters of the manipulator, whose triangles close from 0.05 to 0.55 m."""
    values = {
        "lift.a": draw(st.floats(1.1, 1.2)),
        "lift.b": draw(st.floats(0.40, 0.44)),
        "lift.L_0": draw(st.floats(0.82, 0.88)),
        "tilt.a": draw(st.floats(1.2, 1.3)),
        "tilt.b": draw(st.floats(0.43, 0.47)),
        "tilt.L_0": draw(st.floats(0.95, 1.05)),
        "tube.share": draw(st.floats(0.2, 0.8)),
        **magnitudes(draw, {"payload.J": (0.01, 0.1), "payload.m": (100.0, 600.0)}),
        **magnitudes(draw, {"lift_boom.length": (1.0, 3.0), "inner_boom.reach": (1.0, 3.0)}),
        **signs(draw, {"gravity": (5.0, 15.0), "lift.delta": (0.3, 1.5), "tilt.delta": (1.0, 3.0)}),
        **signs(draw, {"lift.epsilon": (0.1, 1.0), "tilt.epsilon": (0.1, 1.0)}),
    }
    for boom in ("lift_boom", "outer_boom", "inner_boom"):
        values |= {
            f"{boom}.m": magnitude(draw, 50.0, 200.0),
            f"{boom}.c": signed(draw, 0.3, 1.0),
            f"{boom}.J": magnitude(draw, 10.0, 50.0),
        }
    for i in (1, 2, 3):
        values |= {
            f"screw.M_BS[{i}]": magnitude(draw, 30.0, 200.0),
            f"motor.m[{i}]": magnitude(draw, 10.0, 50.0),
            f"housing.c[{i}]": signed(draw, 0.2, 0.6),
            f"housing.J[{i}]": magnitude(draw, 2.0, 10.0),
            f"tube.c[{i}]": signed(draw, 0.2, 0.6),
            f"tube.J[{i}]": magnitude(draw, 0.5, 3.0),
            f"screw.q_LB[{i}]": 0.05,
            f"screw.q_UB[{i}]": 0.55,
        }
    return values


@st.composite
def manipulator_points(draw: Draw) -> Point:
    values = machine(draw)
    for i in (1, 2, 3):
        values |= {
            f"x_L[{i}]": draw(st.floats(0.1, 0.5)),
            f"v_L[{i}]": signed(draw, 0.03, 0.3),
            f"a_L[{i}]": signed(draw, 0.1, 3.0),
        }
    return Point(values, terms={f"F_L[{i}]": 1e3 for i in (1, 2, 3)})


@st.composite
def merged_points(draw: Draw) -> Point:
    values = machine(draw)
    for i in (1, 2, 3):
        values |= {
            f"tau_m[{i}]": signed(draw, 3.0, 100.0),
            f"d_2[{i}]": signed(draw, 0.1, 3.0),
            f"motor.J_m[{i}]": magnitude(draw, 1e-3, 0.02),
            f"motor.B_m[{i}]": magnitude(draw, 1e-3, 1e-2),
            f"coupling.J_c[{i}]": magnitude(draw, 1e-3, 1e-2),
            f"gearbox.rho[{i}]": magnitude(draw, 0.2, 1.0),
            f"gearbox.J_GB[{i}]": magnitude(draw, 1e-3, 1e-2),
            f"gearbox.eta_GB[{i}]": draw(st.floats(0.7, 0.95)),
            f"screw.lead[{i}]": magnitude(draw, 0.01, 0.03),
            f"screw.B_BS[{i}]": magnitude(draw, 10.0, 100.0),
            f"screw.C_eq[{i}]": magnitude(draw, 0.3, 3.0),
            f"screw.v_max[{i}]": magnitude(draw, 0.1, 1.0),
            f"uncertainty.F_2[{i}]": signed(draw, 0.03, 0.3),
            f"start.x_L[{i}]": draw(st.floats(0.1, 0.5)),
            f"start.v_L[{i}]": signed(draw, 0.03, 0.3),
        }
    terms = {f"{name}[{i}]": size for name, size in (("F_L", 1e3), ("a_L", 1.0)) for i in (1, 2, 3)}
    accelerations = {f"der(v_L[{i}])": 1.0 for i in (1, 2, 3)}
    return Point({**values, "solver.internal_step": 1e-4}, terms={**terms, **accelerations, "energy": 1e3})


CURVES = {
    "lift": [0.2, 0.3, 0.1, 0.25, 0.22, 0.4, 0.31, 0.28, 0.26, 0.24],
    "tilt": [0.4, 0.38, 0.45, 0.5, 0.42, 0.41, 0.35, 0.33, 0.4, 0.44],
    "telescope": [0.5, 0.6, 0.2, 0.3, 0.7, 0.8, 0.1, 0.4, 0.35, 0.36],
}
"""Coefficients of a spline."""

FACTS = {
    "HdrmManipulator": BlockFacts(
        start={"lift.a": 1.2, "tube.share": 0.4},
        inputs={"payload.m": 100, "x_L[1]": 0.05, "x_L[2]": 0.05, "x_L[3]": 0.5}
        | {f"{name}_L[{i}]": size for name, size in (("v", 0.3), ("a", 3)) for i in (1, 2, 3)},
        smooth={"payload.m": 400.0, "x_L[1]": 0.2, "x_L[2]": 0.3, "x_L[3]": 0.4}
        | {"v_L[1]": 0.1, "v_L[2]": -0.2, "v_L[3]": 0.3, "a_L[1]": 1.0, "a_L[2]": 2.0, "a_L[3]": -3.0},
        points=manipulator_points,
        is_laborious=True,
    ),
    "HdrmPlant": BlockFacts(
        start={"gravity": 1.0}  # so that nothing falls beyond its stroke
        | {"screw.B_BS[1]": 50.0, "screw.C_eq[2]": 2.0, "uncertainty.F_2[3]": 0.1, "start.v_L[1]": 0.02},
        inputs={"payload.m": 100, "tau_m[1]": 20, "tau_m[2]": 10, "tau_m[3]": 1}
        | {f"d_2[{i}]": 0.3 for i in (1, 2, 3)},
        smooth={"tau_m[1]": 30.0, "tau_m[2]": 9.0, "tau_m[3]": -6.0, "d_2[1]": 0.1}
        | {"start.v_L[1]": 0.02, "start.v_L[2]": -0.05, "start.v_L[3]": 0.1}
        | {"screw.B_BS[1]": 50.0, "uncertainty.F_2[1]": 0.1},
        points=merged_points,
        exchange=(0.4, 0.4),
        is_laborious=True,
    ),
    "Trajectory": BlockFacts(
        start=trajectory_parameters(Spline(4, [0.1] * 5 + [0.2, 0.25, 0.25, 0.5, 0.7] + [0.9] * 5, CURVES)),
        inputs={},
        smooth={f"knot[{i}]": 1.0 for i in range(7, 55)}
        | {"coefficient.lift[2]": 0.1, "coefficient.telescope[4]": 0.9},
        points=trajectory_points,
    ),
}
