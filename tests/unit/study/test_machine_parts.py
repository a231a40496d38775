"""The drawn machine has the points and lengths of the machine, and its workspace has what it reaches."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.path import Path
from scipy.spatial import ConvexHull

from emla_cosim.study.machines.schema import list_machine_names, load_machine
from emla_cosim.study.sketch.parts import MachineParts, Posture
from emla_cosim.study.sketch.scene import actuator_colors, build_polygons, convex_line
from emla_cosim.study.sketch.workspace import (
    OBLIQUE,
    PLANE,
    THREE_SIDES,
    Workspace,
    find_workspace,
    main_view,
)
from machine_fmu import Body, Joint, Machine, Payload, Point
from machine_fmu.model import MachineModel
from tests.support.machines import named_values
from tests.support.manipulator_geometry import HDRM, Manipulator, joint_angles, points

STROKES = np.random.default_rng(3).uniform(HDRM.q_LB, HDRM.q_UB, (40, 3))

OTHER_MACHINES = (
    HDRM,
    replace(HDRM, lift_length=1.2, reach=2.4),
    replace(HDRM, lift_delta=math.radians(-110.0), tilt_epsilon=math.radians(10.0)),
    replace(HDRM, q_LB=(0.1, 0.2, 0.3), q_UB=(0.2, 0.25, 0.4)),
    replace(HDRM, q_UB=(0.0001, 0.611, 1.0)),
)
"""Machines whose reach has other forms: a ring that is thin, turned, small, or hardly lifted."""


def model_of(p: Manipulator) -> MachineModel:
    return MachineModel(load_machine("hdrm"), named_values(p))


def posture(model: MachineModel, q: np.ndarray, payload: float | None = None) -> Posture:
    mass = model.payload if payload is None else payload
    return MachineParts(model).postures(np.array([q]), np.array([mass]))[0]


@pytest.mark.parametrize("q", STROKES[:3])
def test_pins_and_payload_are_where_the_kinematics_have_them(q: np.ndarray) -> None:
    at = {name: np.array([x.real, x.imag]) for name, x in points(HDRM, q).items()}
    drawn = posture(model_of(HDRM), q)
    outer_end = at["O_2"] + HDRM.reach / (HDRM.reach + q[2]) * (at["tip"] - at["O_2"])
    assert drawn["pin of outer_boom"].points[0] == pytest.approx(at["O_2"])
    assert drawn["tilt second pin"].points[0] == pytest.approx(at["B_2"])
    assert drawn["payload"].points.mean(axis=0) == pytest.approx(at["tip"], abs=1e-12)
    assert drawn["lift_boom"].points == pytest.approx(np.array([np.zeros(2), at["O_2"]]))
    assert drawn["outer_boom"].points == pytest.approx(np.array([at["O_2"], outer_end]))
    assert drawn["inner_boom"].points[1] == pytest.approx(at["tip"])
    assert drawn["telescope rod"].points[1] == pytest.approx(at["tip"])


@pytest.mark.parametrize("name", list_machine_names())
def test_actuators_are_as_long_as_their_pins_are_apart(name: str) -> None:
    machine = MachineModel(load_machine(name))
    q = 0.9 * np.array(machine.start) + 0.1 * np.array(machine.q_UB)
    drawn = posture(machine, q)
    rests = [float(bar.length) for bar in machine.mechanism.actuators]
    for joint, rest, stroke in zip(machine.names, rests, q, strict=True):
        rod, housing = drawn[f"{joint} rod"], drawn[f"{joint} housing"]
        if joint != "telescope":  # whose pins may be beside its slide
            assert math.dist(*rod.points) == pytest.approx(rest + stroke, abs=1e-9)
        assert math.dist(*housing.points) == pytest.approx(rest, abs=1e-9)
        flat = build_polygons([rod], PLANE, {}).lines[0] if machine.dimensions == 2 else rod.points
        longest = np.linalg.norm(flat[:, None] - flat[None, :], axis=-1).max()
        round_ends = 2.0 * rod.radii[0] if machine.dimensions == 2 else 0.0
        assert longest == pytest.approx(math.dist(*rod.points) + round_ends, rel=0.02)


def test_the_box_grows_with_the_payload() -> None:
    machine = model_of(HDRM)
    boxes = [posture(machine, STROKES[0], kg)["payload"] for kg in (0.0, 470.0, 8 * 470.0)]
    sides = [np.ptp(box.points, axis=0).max() for box in boxes]
    assert sides[0] == 0.0
    assert sides[2] == pytest.approx(2.0 * sides[1])


def test_base_does_not_move() -> None:
    machine = model_of(HDRM)
    bases = [posture(machine, q)["ground"].points for q in STROKES[:5]]
    assert all(np.array_equal(base, bases[0]) for base in bases)


def test_outlines_are_drawn_instead_of_beams() -> None:
    corners = (Point((0.0, 0.1)), Point((1.0, 0.2)), Point(origin="pin"), Point((0.5, -0.4), origin="pin"))
    pin = {"pin": Point((0.6, -0.2))}
    boom = Body(Joint("revolute", is_passive=True), points=pin, outline=corners)
    machine = load_machine("lift_table")
    machine = replace(machine, bodies={**machine.bodies, "boom": boom}, outline=corners[:2] + corners[1:2])
    drawn = posture(model := MachineModel(machine), np.array(model.start))
    expected = np.array([[0.0, 0.1], [1.0, 0.2], [0.6, -0.2], [1.1, -0.6]])
    assert drawn["boom"].points == pytest.approx(expected)
    assert {(0.0, 0.1), (1.0, 0.2)} <= set(map(tuple, drawn["ground"].points))


def test_platform_in_space_is_drawn_in_all_views() -> None:
    machine = MachineModel(load_machine("stewart"))
    drawn = posture(machine, np.array(machine.start))
    tops = [drawn[f"{leg} second pin"].points[0] for leg in machine.names]
    assert np.ptp(np.array(tops)[:, 2]) == pytest.approx(0.0, abs=1e-5)
    for view in (OBLIQUE, *THREE_SIDES):
        axes = np.array([*view.axes, view.toward])
        assert axes @ axes.T == pytest.approx(np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1.0)  # not mirrored
        polygons = build_polygons(drawn.values(), view, actuator_colors(machine.names))
        assert polygons.names[0] == "ground"
        assert {"platform", "payload", "leg_6 rod"} <= set(polygons.names)
    order = list(dict.fromkeys(build_polygons(drawn.values(), THREE_SIDES[2], {}).names))
    assert order.index("payload") > order.index("platform") > order.index("leg_1 rod")


@pytest.mark.parametrize("p", OTHER_MACHINES)
def test_the_workspace_has_every_point_that_the_tip_reaches(p: Manipulator) -> None:
    strokes = np.random.default_rng(5).uniform(p.q_LB, p.q_UB, (3000, 3))
    corners = product(*zip(p.q_LB, p.q_UB, strict=True))
    tips = np.array([points(p, q)["tip"] for q in (*strokes.tolist(), *corners)])
    tips = np.column_stack([tips.real, tips.imag])
    workspace = find_workspace(model_of(p))
    area = Path.make_compound_path(*(Path(line, closed=True) for line in workspace.areas(PLANE)))
    pixel = np.ptp(tips, axis=0).max() / 700
    is_inside = [area.contains_points(tips, radius=r) for r in (2.0 * pixel, -2.0 * pixel)]  # outwards is one
    assert np.logical_or(*is_inside).all()
    assert workspace.unreachable == 0.0


@pytest.mark.parametrize("p", OTHER_MACHINES)
def test_the_tip_reaches_every_point_of_the_boundary(p: Manipulator) -> None:
    lines = find_workspace(model_of(p)).areas(PLANE)
    angles = np.array([joint_angles(p, q) for q in (p.q_LB, p.q_UB)])
    lift = np.linspace(angles[0, 0], angles[1, 0], 4001)
    ends = p.lift_length * np.column_stack([np.cos(lift), np.sin(lift)])
    for point in np.concatenate(lines)[::25]:
        boom = point - ends
        reach = np.hypot(*boom.T)
        tilt = np.arctan2(boom[:, 1], boom[:, 0]) - lift
        tilt = tilt - 2.0 * math.pi * np.round((tilt - angles[:, 1].mean()) / (2.0 * math.pi))
        off = np.abs(np.clip(tilt, *angles[:, 1]) - tilt) * reach
        off += np.abs(np.clip(reach, p.reach + p.q_LB[2], p.reach + p.q_UB[2]) - reach)
        assert off.min() < 0.02


def test_workspace_of_one_actuator_is_a_line() -> None:
    machine = MachineModel(load_machine("lift_table"))
    line = find_workspace(machine).line(main_view(2))
    ends = machine.tip(np.array([machine.q_LB, machine.q_UB]))
    assert line[[0, -1]] == pytest.approx(ends)


def test_poses_that_do_not_close_are_left_out() -> None:
    opened = MachineModel(load_machine("hdrm"), {"screw.q_UB[1]": 0.9})  # the triangle opens at 0.72 m
    workspace = find_workspace(opened)
    assert workspace.unreachable == pytest.approx(1.0 - 0.72 / 0.9, abs=0.03)
    assert np.isfinite(np.concatenate(workspace.areas(PLANE))).all()


def test_holes_of_the_workspace_stay_open() -> None:
    """A boom that goes all the way around, but cannot fold, leaves a ring."""
    angle = np.linspace(0.0, 2.0 * math.pi, 60)
    radius = np.linspace(1.0, 1.5, 9)
    tips = np.stack(np.meshgrid(angle, radius, indexing="ij"), axis=-1)
    tips = np.stack([tips[..., 1] * np.cos(tips[..., 0]), tips[..., 1] * np.sin(tips[..., 0])], axis=-1)
    outer, inner = sorted(Workspace(tips, tips).areas(PLANE), key=len, reverse=True)
    for line, expected in ((outer, 1.5), (inner, 1.0)):
        assert np.hypot(*line.T) == pytest.approx(expected, abs=0.01)


def test_tip_without_a_payload_is_the_last_point() -> None:
    points = {"pin": Point((0.4, 0.1)), "end": Point((2.0, 0.0))}
    boom = Body(Joint("revolute", assembly=(0.3,)), m=1.0, points=points)
    hdrm, ends = load_machine("hdrm"), ("ground.foot", "boom.pin")
    lift = replace(hdrm.actuators["lift"], ends=ends, L_0=0.5, start=None, stroke=(0.0, 0.2))
    foot = {"foot": Point((0.3, -0.4))}
    machine = Machine(
        2, {"boom": boom}, foot, {"lift": lift}, parameters=hdrm.parameters, gravity=hdrm.gravity
    )
    assert machine.payload is None
    model = MachineModel(machine)
    tip = model.tip(np.array([model.start]))[0]
    assert tip == pytest.approx([2.0 * math.cos(0.3), 2.0 * math.sin(0.3)])
    with_payload = MachineModel(replace(machine, payload=Payload("boom.end", 5.0)))
    assert with_payload.tip(np.array([model.start]))[0] == pytest.approx(tip)


def test_what_swings_freely_hangs_at_rest() -> None:
    machine = MachineModel(load_machine("crane"))
    q = np.random.default_rng(4).uniform(machine.q_LB, machine.q_UB, (20, 3))
    points = machine.points(q, ["hook", "hook.load"])
    assert points["hook.load"] - points["hook"] == pytest.approx(np.tile([0.0, -0.8], (20, 1)), abs=1e-12)
    drawn = MachineParts(machine).postures(q, np.full(20, 900.0))
    assert drawn[7]["hook"].points[1] == pytest.approx(points["hook.load"][7])
    step = 1e-6 * np.eye(3)
    heavier = machine.holding_forces(q, 1000.0) - machine.holding_forces(q, 900.0)
    heights = np.array([(machine.tip(q + d) - machine.tip(q - d))[:, 1] for d in step]).T / 2e-6
    assert heavier == pytest.approx(100.0 * 9.81 * heights, rel=1e-6, abs=1e-3)


@given(st.integers(0, 10_000), st.integers(3, 60))
def test_convex_line_is_that_of_scipy(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 2))
    corners = convex_line(points)
    expected = points[ConvexHull(points).vertices]  # anticlockwise, too
    first = expected.tolist().index(corners[0].tolist())
    assert corners.tolist() == np.roll(expected, -first, axis=0).tolist()


def test_convex_line_of_points_in_a_row() -> None:
    points = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [1.0, 1.0]])
    assert convex_line(points).tolist() == [[0.0, 0.0], [2.0, 2.0]]
