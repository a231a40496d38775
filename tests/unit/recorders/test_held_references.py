"""References of discrete variables hold between their rows; others are straight lines."""

import numpy as np
import pytest

from emla_cosim.base.tolerances import Tolerance, compare_signal

TIMES = np.arange(11) * 0.1
STAIRS = np.floor(TIMES / 0.5 + 1e-9)
REFERENCE = np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 2.0])


@pytest.mark.parametrize(("values", "is_held", "agrees"), [
    (STAIRS, True, True),
    (STAIRS, False, False),
    (2.0 * TIMES, False, True),
    (2.0 * TIMES, True, False),
    (np.roll(STAIRS, 2), True, False),  # two steps late
])  # fmt: skip
def test_references_hold_or_are_linear(values: np.ndarray, is_held: bool, agrees: bool) -> None:
    actual = compare_signal("n", "", TIMES, values, *REFERENCE, Tolerance(), is_held)
    assert (actual.left_at is None) == agrees


def test_doubled_rows_of_a_held_reference_change_nothing() -> None:
    doubled = np.array([0.0, 0.5, 0.5, 1.0, 1.0]), np.array([0.0, 0.0, 1.0, 1.0, 2.0])
    for reference in (REFERENCE, doubled):
        assert compare_signal("n", "", TIMES, STAIRS, *reference, Tolerance(), True).left_at is None
