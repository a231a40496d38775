"""The table of a load along the stroke, against SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from emla_fmu.stroke_load import HELD, LINEAR, POINTS, SMOOTH, force_at


@given(
    widths=st.lists(st.floats(1e-3, 0.5), min_size=1, max_size=POINTS - 1),
    forces=st.lists(st.integers(-5, 5), min_size=POINTS, max_size=POINTS),
)
def test_forces_match_scipy_at_points_between_and_beyond(widths: list[float], forces: list[int]) -> None:
    position = np.cumsum([0.1, *widths])
    force = 1e3 * np.array(forces[: len(position)], dtype=float)
    table = [[*x.tolist(), *[float(x[-1])] * (POINTS - len(x))] for x in (position, force)]
    between = position[:-1] + 0.3 * np.diff(position)
    for x in (*position, *between, position[0] - 0.2, position[-1] + 0.2):
        inside = float(np.clip(x, position[0], position[-1]))
        expected = {
            HELD: force[np.searchsorted(position, inside, side="right") - 1],
            LINEAR: np.interp(inside, position, force),
            SMOOTH: PchipInterpolator(position, force)(inside),
        }
        for kind, value in expected.items():
            assert force_at(float(x), *table, kind) == pytest.approx(value, abs=1e-8)
