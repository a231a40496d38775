"""Tubes: against a brute force one and against pyfunnel's, and what is inside of them."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emla_cosim.base.errors import CommandError
from emla_cosim.base.tolerances import (
    Comparison,
    Tolerance,
    Tube,
    compare_signal,
    describe_departure,
    find_tolerance,
    read_tolerances,
    select_outside,
)
from emla_cosim.base.values import convert_value
from fmu_verify.references.reference_files import ReferenceTable

EXACT = Tolerance(relative=1e-3, time=0.0)

values = st.lists(st.floats(-10.0, 10.0).map(lambda x: round(x, 3)), min_size=2, max_size=12)


def against(values: np.ndarray, reference: np.ndarray, tolerance: Tolerance, step: float = 0.1) -> Comparison:
    time = step * np.arange(len(values))
    return compare_signal("y", "m", time, values, step * np.arange(len(reference)), reference, tolerance)


@given(values=values, width=st.floats(0.0, 3.0), gaps=st.lists(st.integers(1, 5), min_size=12, max_size=12))
def test_edges_are_the_extremes_of_the_reference_within_the_time(
    values: list[float], width: float, gaps: list[int]
) -> None:
    """Dense sampling, an independent way, is never outside, and reaches the edges."""
    time, reference = np.cumsum(gaps[: len(values)]).astype(float), np.array(values)
    at = np.linspace(time[0] - 1.0, time[-1] + 1.0, 23)
    lower, upper = Tube(0.0, width).edges(at, time, reference)
    steepest = np.abs(np.diff(reference) / np.diff(time)).max()
    for k, t in enumerate(at):
        near = np.linspace(t - width, t + width, 2001)
        sampled = np.interp(near, time, reference)
        slack = steepest * width / 1000.0 + 1e-12
        assert lower[k] - 1e-12 <= sampled.min() <= lower[k] + slack
        assert upper[k] - slack <= sampled.max() <= upper[k] + 1e-12


@pytest.mark.skipif(sys.platform != "linux", reason="The extra 'test' has pyfunnel for Linux only.")
@pytest.mark.parametrize(("dt", "dy"), [(0.02, 0.01), (0.0125, 1e-4), (0.06, 0.2)])
def test_edges_are_those_of_pyfunnel(dt: float, dy: float, tmp_path: Path) -> None:
    pyfunnel = pytest.importorskip("pyfunnel", reason="pyfunnel has a package for x86_64 only.")
    time = np.linspace(0.0, 1.0, 81)
    reference = np.sin(7.0 * time) + 0.2 * np.sin(3.0 * time)
    pyfunnel.compareAndReport(
        time, reference, time, reference, outputDirectory=str(tmp_path), atolx=dt, atoly=dy
    )
    edges = Tube(dy, dt).edges(time, time, reference)
    inside = (time > dt) & (time < 1.0 - dt)  # what is beyond the ends is a matter of taste
    for name, edge in zip(("lower", "upper"), (edges[0] - dy, edges[1] + dy), strict=True):
        edges_of_pyfunnel = np.genfromtxt(tmp_path / f"{name}Bound.csv", delimiter=",", skip_header=1)
        edge_of_pyfunnel = np.interp(time, edges_of_pyfunnel[:, 0], edges_of_pyfunnel[:, 1])
        assert edge_of_pyfunnel[inside] == pytest.approx(edge[inside], abs=1e-12)


def test_jump_may_come_earlier_or_later() -> None:
    time, reference = np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 0.0, 1.0, 1.0])
    at = np.linspace(0.0, 2.0, 41)
    for shift, inside in ((0.09, True), (-0.09, True), (0.16, False), (-0.16, False)):
        late = (at >= 1.0 + shift).astype(float)
        comparison = compare_signal("y", "", at, late, time, reference, Tolerance(time=0.1))
        assert comparison.inside == inside


@given(values=values, shift=st.floats(-0.05, 0.05))
def test_shift_within_the_tube_stays_inside(values: list[float], shift: float) -> None:
    reference = np.array(values)
    time = 0.1 * np.arange(len(reference))
    shifted = np.interp(time - shift, time, reference)
    assert against(shifted, reference, Tolerance(time=0.051)).inside


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_width_of_the_tube(factor: float) -> None:
    reference = np.sin(np.linspace(0.0, 6.0, 61))
    wrong = reference.copy()
    wrong[40] += factor * 1e-3 * np.ptp(reference)
    comparison = against(wrong, reference, EXACT)
    assert comparison.inside == (factor < 1.0)
    assert comparison.worst == pytest.approx(factor * 1e-3 * np.ptp(reference))
    assert comparison.worst_at == pytest.approx(4.0)
    assert comparison.left_at == (None if factor < 1.0 else pytest.approx(4.0))
    assert factor < 1.0 or describe_departure(comparison).startswith(
        "y left its tube at t = 4 s; it is off by up"
    )


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_outside(wrong: float) -> None:
    reference = np.linspace(0.0, 1.0, 11)
    values = reference.copy()
    values[7] = wrong
    comparison = against(values, reference, Tolerance(relative=1e6))
    assert comparison.left_at == pytest.approx(0.7)
    assert comparison.worst == np.inf


def test_gaps_of_the_reference_and_times_without_it_are_not_compared() -> None:
    reference = np.linspace(0.0, 1.0, 11)
    gap = reference.copy()
    gap[3:5] = np.nan
    assert against(reference, gap, EXACT).inside
    assert against(reference[:4], reference, EXACT).inside
    assert against(np.append(reference, 99.0), reference, EXACT).inside


@pytest.mark.parametrize(
    ("constant", "off", "inside"), [(5.0, 4e-3, True), (5.0, 6e-3, False), (0.0, 1e-13, True)]
)
@pytest.mark.parametrize("points", [5, 1])
def test_constant_signal_is_relative_to_its_value(
    constant: float, off: float, inside: bool, points: int
) -> None:
    reference = np.full(points, constant)
    assert against(reference + off, reference, EXACT).inside == inside


def test_first_departure_comes_first() -> None:
    reference = np.zeros(11)
    departures = []
    for k in (7, 2, 5):
        values = reference.copy()
        values[k] = 1.0
        departures.append(against(values, reference, EXACT))
    departures.append(against(reference, reference, EXACT))
    assert [c.left_at for c in select_outside(departures)] == pytest.approx([0.2, 0.5, 0.7])


def test_later_tolerances_override_earlier_ones() -> None:
    tolerances = read_tolerances(["1e-4", "a.*=time:0,absolute:1e-9", "a.x=1e-6"])
    assert find_tolerance("b", tolerances) == Tolerance(1e-4)
    assert find_tolerance("a.y", tolerances) == Tolerance(1e-4, 1e-9, 0.0)
    assert find_tolerance("a.x", tolerances) == Tolerance(1e-6, 1e-9, 0.0)
    assert find_tolerance("z", {}) == Tolerance()


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["", "x=", "=1", "x=relativ:1", "x=1,,", "q", "x=1e-3;time:0"], r"cannot be read\. Write NUMBER"),
        (["-1", "x=nan", "inf", "x=time:-1"], "must be 0 or a positive number"),
    ],
)
def test_invalid_tolerances(texts: list[str], message: str) -> None:
    for text in texts:
        with pytest.raises(CommandError, match=message):
            read_tolerances([text])


def test_tolerances_of_a_file() -> None:
    tolerances = convert_value(
        {"tolerance": {"x": 1e-5, "y": {"time": 0.0}}}, ReferenceTable, "'f'"
    ).tolerance
    assert tolerances == {"x": Tolerance(1e-5), "y": Tolerance(time=0.0)}
    with pytest.raises(CommandError, match=r"'x' in \[tolerance\] of 'f' has the unknown entry 'tme'"):
        convert_value({"tolerance": {"x": {"tme": 0.0}}}, ReferenceTable, "'f'")
