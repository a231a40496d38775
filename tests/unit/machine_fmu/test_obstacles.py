"""Distances from obstacles by brute force, and obstacles that are wrong."""

from typing import Any

import numpy as np
import pytest

from emla_cosim.analyses.trajectory.problem import load_problem, paper_problem
from emla_cosim.base.errors import CommandError
from machine_fmu.optimisation.contradictions import find_contradictions
from machine_fmu.optimisation.obstacles import Obstacle, Separation
from machine_fmu.optimisation.surroundings import Axis

TRIANGLE = ((0.0, 0.0), (1.0, 0.2), (0.3, 0.9))
FORMS: list[dict[str, Any]] = [
    {"centre": (0.3, 0.4), "radius": 0.25},
    {"low": (0.2, 0.1), "high": (0.7, 0.9)},
    {"corners": TRIANGLE},
    {"centre": (0.3, 0.4, 0.5), "radius": 0.25},
    {"low": (0.2, 0.1, 0.3), "high": (0.7, 0.9, 0.6)},
]


def measure_distances(form: dict[str, Any], points: np.ndarray) -> np.ndarray:
    """The distance of points from a form, by its definition."""
    if "radius" in form:
        return np.maximum(np.linalg.norm(points - form["centre"], axis=1) - form["radius"], 0.0)
    if "low" in form:
        return np.linalg.norm(points - np.clip(points, form["low"], form["high"]), axis=1)
    corners = np.array(form["corners"])
    parts = np.linspace(0.0, 1.0, 50)
    inside = [s * (a + t * (b - a)) + (1 - s) * c for a, b, c in [corners] for s in parts for t in parts]
    return np.array([np.linalg.norm(np.array(inside) - p, axis=1).min() for p in points])


@pytest.mark.parametrize("form", FORMS)
def test_distances_of_segments(form: dict[str, Any]) -> None:
    obstacle = Obstacle(**form)
    draw = np.random.default_rng(1)
    a, b = draw.uniform(-0.5, 1.5, (2, 12, obstacle.dimensions))
    actual, nearest_points = obstacle.distances(a, b)
    for i in range(len(a)):
        line = a[i] + np.linspace(0.0, 1.0, 200)[:, None] * (b[i] - a[i])
        nearest = measure_distances(form, line).min()
        assert actual[i] == pytest.approx(nearest, abs=0.02)
        assert measure_distances(form, nearest_points[i][None])[0] == pytest.approx(actual[i], abs=0.02)


@pytest.mark.parametrize("form", FORMS)
def test_separating_directions_exist_for_what_is_apart(form: dict[str, Any]) -> None:
    obstacle = Obstacle(**form)
    n = obstacle.dimensions
    a, b = np.full((1, n), 1.3), np.array([[1.3, *[0.2] * (n - 1)]])
    direction = obstacle.find_separating_directions(a, b)
    distances, size = Separation(Axis("", "", ""), 0).function(obstacle)(a[0], b[0], direction[0])
    exact = obstacle.distances(a, b)[0][0]
    assert float(size) == pytest.approx(1.0)
    assert 0.8 * exact <= float(np.min(distances)) <= exact + 1e-9


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ({}, "an obstacle has no form; it must have centre and radius, low and high, or corners"),
        ({"centre": [1.0, 2.0]}, "an obstacle has centre; it must have"),
        ({"name": "post", "centre": [1.0, 2.0], "radius": -1.0}, "radius of the obstacle 'post' is -1"),
        ({"corners": [[0, 0], [1, 0], [0.2, 0.2], [0, 1]]}, "of a convex polygon, in order"),
        ({"corners": [[0, 0], [1, 0]]}, "must be three or more positions"),
        ({"low": [0, 0, 0], "high": [1, 1, 1]}, "must have the coordinates x, y"),
        ({"centre": [1.0, 2.0], "radius": 1.0, "colour": 3}, "unknown entry 'colour'"),
    ],
)
def test_invalid_obstacles_are_refused(form: dict[str, Any], words: str) -> None:
    with pytest.raises(CommandError) as error:
        load_problem({"obstacles": [form]})
    assert words in str(error.value)


def test_ends_and_way_points_that_are_too_near_are_refused() -> None:
    post = {"name": "post", "centre": [3.5, -1.0], "radius": 0.05}
    messages = find_contradictions(paper_problem(v_E=(0.0,) * 3, obstacles=[post]))
    assert any(
        "q_S puts 'inner_boom' 0.0" in text and "from the obstacle 'post'" in text for text in messages
    )
    via = {"tip": [2.6, -0.4]}
    post = {"name": "post", "low": [2.5, -0.3], "high": [2.7, -0.2]}
    messages = find_contradictions(paper_problem(v_E=(0.0,) * 3, via=[via], obstacles=[post]))
    assert any(
        text.startswith("via[1].tip = 2.6,-0.4 m is 0.1 m from the obstacle 'post'") for text in messages
    )
