"""B-splines: the block against SciPy, and invalid splines."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from fmublock import BlockError
from machine_fmu import Trajectory, trajectory_block
from machine_fmu.spline import Spline, TrajectoryError, default_spline, spline_of, trajectory_parameters
from machine_fmu.spline_window import COEFFICIENTS, KNOTS
from machine_fmu.trajectory import JOINTS
from tests.support.in_process import started

OUTPUTS = [f"{name}[{i}]" for name in ("x_d", "v_d", "a_d") for i in (1, 2, 3)]


def evaluate_block(spline: Spline, time: float) -> np.ndarray:
    """Positions, speeds and accelerations of the block at a time: three rows."""
    block = started(Trajectory, trajectory_parameters(spline), time)
    return np.array(block.get([block.layout.reference(n) for n in OUTPUTS])).reshape(3, 3)


def a_spline(degree: int, inner: list[float], seed: int = 1) -> Spline:
    knots = [0.5] * (degree + 1) + inner + [9.5] * (degree + 1)
    draw = np.random.default_rng(seed)
    size = len(knots) - degree - 1
    return Spline(degree, knots, {joint: draw.uniform(0.1, 0.9, size).tolist() for joint in JOINTS})


@given(
    st.integers(1, 5),
    st.lists(st.floats(0.6, 9.4), max_size=30),
    st.integers(0, 30),
    st.booleans(),
    st.floats(0.5, 9.5),
)
@settings(max_examples=200)
def test_block_is_scipys_spline(
    degree: int, positions: list[float], which: int, twice: bool, time: float
) -> None:
    """Between knots of any degree and number, some twice, and at them."""
    inner = sorted([*positions, *(positions[:1] if twice else [])])
    spline = a_spline(degree, inner)
    if which < len(inner):
        time = inner[which]
    table = np.column_stack([spline.coefficients[joint] for joint in JOINTS])
    curve = BSpline(np.array(spline.knots), table, degree)
    actual = evaluate_block(spline, time)
    for order in range(3):
        expected = curve(time, nu=order) if order <= degree else np.zeros(3)
        spans = np.diff(np.unique(spline.knots)).min()
        assert actual[order] == pytest.approx(expected, rel=1e-9, abs=1e-9 / min(spans, 1.0) ** order)


@given(st.integers(1, 5), st.lists(st.sampled_from([0.7, 2.0, 2.0 + 1e-3, 5.5, 9.0]), max_size=20))
def test_all_derivatives_match_scipys_spline(degree: int, inner: list[float]) -> None:
    """Also at knots, with up to as many equal ones as a spline can have."""
    inner = [knot for knot in sorted(set(inner)) for _ in range(min(inner.count(knot), degree + 1))]
    spline = a_spline(degree, inner)
    times = np.array([*np.linspace(0.5, 9.5, 50), *inner])
    table = np.column_stack([spline.coefficients[joint] for joint in JOINTS])
    curve = BSpline(np.array(spline.knots), table, degree)
    for order in range(degree + 1):
        expected = curve(times, nu=order)
        assert spline.evaluated(times, order) == pytest.approx(
            expected, rel=1e-9, abs=1e-12 * np.abs(expected).max()
        )
    assert not spline.evaluated(times, degree + 1).any()


def test_beyond_its_ends_it_holds_still() -> None:
    spline = a_spline(5, [3.0, 4.0])
    for time, end in ((0.0, 0), (0.5 - 1e-6, 0), (9.5 + 1e-6, -1), (1e6, -1)):
        actual = evaluate_block(spline, time)
        assert actual[0].tolist() == [spline.coefficients[joint][end] for joint in JOINTS]
        assert not actual[1:].any()
    for time in (0.5, 9.5, 9.5 + 5e-10):  # what a tool that sums up its time calls the end
        assert evaluate_block(spline, time)[1].all()


# ---- invalid splines ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"knot[9]": 40.0}, r"knot\[10\] must not come before knot\[9\]"),
        ({"knot[54]": -1.0}, r"knot\[54\] must come after knot\[1\]"),
        ({"knot[4]": 3.0}, r"knot\[4\] must be knot\[1\] with a degree of 3 or more"),
        ({"degree": 6}, "degree = 6 is outside its range, 1 to 5"),
    ],
)
def test_block_refuses_invalid_knots(values: dict[str, Any], words: str) -> None:
    with pytest.raises(BlockError, match=words):
        started(Trajectory, values)


def test_block_takes_as_much_as_it_has_room_for() -> None:
    inner = np.linspace(0.6, 9.4, COEFFICIENTS - 6)
    spline = a_spline(5, inner.tolist())
    assert len(trajectory_parameters(spline)) == 1 + KNOTS + 3 * COEFFICIENTS
    assert evaluate_block(spline, 9.3)[0] == pytest.approx(spline.evaluated([9.3])[0], rel=1e-12)
    with pytest.raises(TrajectoryError, match=r"49 coefficients per joint; .* has room for 48"):
        trajectory_parameters(a_spline(5, [*inner, 9.45]))


def changed(**entries: Any) -> dict[str, Any]:
    return {
        "degree": 3,
        "knots": [0, 0, 0, 0, 1, 2, 2, 2, 2],
        "coefficients": {joint: [0.1, 0.2, 0.3, 0.4, 0.5] for joint in JOINTS},
        **entries,
    }


def coefficients(**entries: Any) -> dict[str, Any]:
    return changed(coefficients={**changed()["coefficients"], **entries})


BAD: list[tuple[object, str]] = [
    ([], "must be a JSON object with degree, knots and coefficients"),
    ({"degree": 3}, "it lacks 'knots'"),
    (changed(degree=7), "the degree 7 must be one of 1 to 5"),
    (changed(degree=True), "the degree True must be a whole number"),
    (changed(degree=3.0), "the degree 3.0 must be a whole number"),
    (changed(knots=7), "the knots are 7; they must be a list of numbers"),
    (changed(knots="0123456789"), "they must be a list of numbers"),
    (changed(knots=[0, 0, 0, 0, 1, 1, 1]), "there are 7 knots; degree 3 needs at least 8"),
    (changed(knots=[0, 0, 0, 0, 3, 2, 2, 2, 2]), r"knot 6, 2 s, is before the previous knot"),
    (changed(knots=[0, 0, 0, 0, 0, 0, 0, 0, 0]), "all knots are at 0 s; the last one must come later"),
    (changed(knots=[0, 0, 0, 1, 1, 2, 2, 2, 2]), "the first 4 knots are not the same"),
    (changed(knots=[0, 0, 0, 0, 1, 1, 2, 2, 2]), "the last 4 knots are not the same"),
    (changed(knots=[0, 0, 0, 0, 1, 2, 2, 2, float("inf")]), "number 9 of the knots is inf"),
    (changed(coefficients=[1.0]), "the coefficients must be lists of numbers by joint"),
    (changed(coefficients={}), "there are no coefficients; a trajectory has a list of them for each joint"),
    (coefficients(tilt=[0.1] * 4), "there are 4 coefficients of tilt; 9 knots and degree 3 need 5"),
    (coefficients(tilt=[0.1] * 4 + [float("nan")]), "number 5 of the coefficients of tilt is nan"),
    (coefficients(lift=[0.1] * 4 + [10**400]), "number 5 of the coefficients of lift is 1000"),
    (coefficients(lift=[0.1] * 4 + ["0.1"]), "number 5 of the coefficients of lift is '0.1'"),
    (coefficients(lift=[0.1] * 4 + [None]), "is None; it must be a finite number"),
]


@pytest.mark.parametrize(("document", "words"), BAD)
def test_invalid_trajectories_give_one_message(document: object, words: str) -> None:
    with pytest.raises(TrajectoryError, match=words) as caught:
        spline_of(document)
    assert str(caught.value).endswith(".")
    assert len(str(caught.value)) < 250


def test_joints_of_any_machine() -> None:
    spline = Spline(1, [0.0, 0.0, 2.0, 2.0], {"luff": [0.1, 0.3], "fold": [0.5, 0.4]})
    trajectory = type("CraneTrajectory", (trajectory_block(spline.joints, {"fold": (0.2, 0.2)}),), {})
    block = started(trajectory, trajectory_parameters(spline), 1.0)
    assert block["x_d[1]"] == pytest.approx(0.2)
    assert block["v_d[2]"] == pytest.approx(-0.05)
    resting = started(trajectory, {}, 1.0)
    assert [resting[name] for name in ("x_d[1]", "x_d[2]", "v_d[2]")] == pytest.approx([0.0, 0.2, 0.0])
    reordered = spline.ordered(["fold", "luff"])
    assert reordered.evaluated([1.0]) == pytest.approx(np.array([[0.45, 0.2]]))
    with pytest.raises(TrajectoryError, match=r"are of .'luff', 'fold'.; they must be of fold, tilt"):
        spline.ordered(["fold", "tilt"])


def test_other_entries_of_a_file_do_not_matter() -> None:
    assert spline_of(changed(author="somebody")) == spline_of(changed())


def test_default_keeps_to_the_papers_ends() -> None:
    """Table II, the telescope's end speed clipped to its bound."""
    spline = default_spline()
    assert (spline.start, spline.end) == (0.0, 37.7)
    ends = [[0.244, 0.389, 0.499], [0.270, 0.442, 0.348]]
    speeds = [[0.0016, 0.0, -0.0024], [0.0607, -0.0808, -0.210]]
    assert spline.evaluated([0.0, 37.7]) == pytest.approx(np.array(ends), abs=1e-9)
    assert spline.evaluated([0.0, 37.7], 1) == pytest.approx(np.array(speeds), abs=1e-7)
