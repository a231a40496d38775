"""Facts about the toy block of the tests."""

from hypothesis import strategies as st

from tests.support.blocks.facts import BlockFacts, Draw, Point, magnitudes, signs


@st.composite
def toy_points(draw: Draw) -> Point:
    values = {
        "shape": draw(st.integers(1, 2)),
        "damped": draw(st.booleans()),
        "count": draw(st.integers(1, 9)),
        "seed": draw(st.integers(1, 2147483646)),
        "solver.internal_step": 5e-5,
        **magnitudes(draw, {"body.mass": (0.2, 9.0), "spring.k[1]": (0.1, 10.0), "spring.k[2]": (0.1, 10.0)}),
        **signs(draw, {"x_0": (0.05, 0.6), "v[1]": (0.1, 3.0), "v[2]": (0.1, 3.0), "force": (0.1, 10.0)}),
    }
    return Point(values, draw(st.floats(0.0, 3.0)))


FACTS = {
    "Toy": BlockFacts(
        start={"shape": 2, "count": 5, "seed": 99, "x_0": 0.1},
        inputs={"force": 1.0},
        smooth={"force": 0.5, "shape": 2, "x_0": 0.1},
        points=toy_points,
        exchange=(1.0, 0.8),
    )
}
