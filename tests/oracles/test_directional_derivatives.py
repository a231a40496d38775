"""Directional derivatives of every native FMU against differences of what the FMU itself computes."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from fmpy.fmi2 import FMU2Model, FMU2Slave
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from emla_cosim.fmu.models import MODELS
from fmublock import Block
from tests.support.blocks import FACTS, OWN, WITH_STATES, Point
from tests.support.sessions import Session, continuous_states, refused, set_continuous_states
from tests.support.tiers import examples
from tests.support.toy import Toy

ALL = [*OWN, "Toy"]
STROKES = tuple(f"start.{name}[{i}]" for name in ("x_L", "v_L") for i in (1, 2, 3))
STARTS = ("start.x_L", "start.deflection", "start.x_hat", "start.eta_hat", "x_0", *STROKES)
"""Parameters that states start from."""
SAMPLED = {"inverter.u_max": "inverter.u_available"}
"""Parameters that discrete states start from, and the output that is this state."""


# ---- instances ---------------------------------------------------------------------------------


def layout(model: str) -> Any:
    block: type[Block] = Toy if model == "Toy" else MODELS[model]
    return block.layout()


class At:
    """An instance at a point, in initialization or in continuous time."""

    def __init__(self, session: Session, point: Point, kind: Any, running: bool) -> None:
        self.session, self.point, self.running = session, point, running
        self.slave = session.new("at", kind)
        parts = layout(session.description.modelName)
        self.states = session.states
        self.unknowns = [*session.names("output"), *(f"der({s})" for s in self.states)]
        inputs = [s.name for s in parts.scalars if s.variable in parts.inputs]
        self.parameters = [n for n in session.names("parameter") if n not in point.kinks]
        if running:  # the start values are behind us, the states anywhere
            self.knowns = [*inputs, *self.states]
        else:
            exact = [v.name for v in session.description.modelVariables if v.initial == "exact"]
            self.knowns = [*inputs, *self.parameters, *(s for s in self.states if s in exact)]
        session.initialize(self.slave, running, point.time, **point.values)
        self.values = self.session.get(self.slave, *self.knowns)

    def __enter__(self) -> "At":
        return self

    def __exit__(self, *exception: object) -> None:
        self.session.slaves.remove(self.slave)
        self.slave.freeInstance()

    def outputs(self, variable: str, value: float) -> np.ndarray:
        """The unknowns with one known changed."""
        before = self.values[self.knowns.index(variable)]
        self._write(variable, value)
        outputs = np.array(self.session.get(self.slave, *self.unknowns))
        self._write(variable, before)
        return outputs

    def _write(self, variable: str, value: float) -> None:
        if self.running and variable in self.states:
            x = continuous_states(self.slave, len(self.states))
            x[self.states.index(variable)] = value
            set_continuous_states(self.slave, x)
        else:
            self.slave.setReal(self.session.references([variable]), [value])

    def exact(self, direction: dict[str, float], unknowns: Sequence[str] | None = None) -> np.ndarray:
        r = self.session.references
        derivatives = self.slave.getDirectionalDerivative(
            r(unknowns or self.unknowns), r(list(direction)), list(direction.values())
        )
        return np.array(derivatives)


def central(f: Callable[[float], np.ndarray], x: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Derivative by central differences of sixth order; and the largest |f| met."""
    at = {k: f(x + k * h) for k in (-3, -2, -1, 1, 2, 3)}
    slope = (45.0 * (at[1] - at[-1]) - 9.0 * (at[2] - at[-2]) + (at[3] - at[-3])) / (60.0 * h)
    return slope, np.max(np.abs(list(at.values())), axis=0)


def differences(f: Callable[[float], np.ndarray], x: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """The derivatives on which two step sizes agree best, and |f(x)| / reach."""
    steps = [s * reach for s in (3e-3, 1e-3, 1e-4, 1e-5, 1e-6)]
    slopes, sizes = (np.array(columns) for columns in zip(*(central(f, x, h) for h in steps), strict=True))
    scale = np.min(sizes, axis=0) / reach
    # relative, because steps longer than the waves of a sine would agree on a slope near zero
    changes = np.abs(np.diff(slopes, axis=0)) / (np.abs(slopes[1:]) + 1e-9 * scale + 1e-300)
    best = np.argmin(changes, axis=0)
    return slopes[best + 1, np.arange(len(best))], scale


RELATIVE, OF_SCALE = 1e-8, 1e-9
"""Of the derivative itself, and of |f(x)| / reach, because sums of large terms round."""


MOST = 40
"""By so many knowns at once the unknowns are differentiated; where a block has more, by others each time."""


def check(at: At, data: st.DataObject) -> None:
    terms = np.array([at.point.terms.get(unknown, 0.0) for unknown in at.unknowns])
    stride = math.ceil(len(at.knowns) / MOST)
    for variable in at.knowns[data.draw(st.integers(0, stride - 1)) :: stride]:
        value = at.values[at.knowns.index(variable)]
        reach = at.point.reach.get(variable, abs(value))
        expected, scale = differences(lambda x, variable=variable: at.outputs(variable, x), value, reach)
        scale = np.maximum(scale, terms / reach)
        actual = at.exact({variable: 1.0})
        bad = np.flatnonzero(~(np.abs(actual - expected) <= RELATIVE * np.abs(expected) + OF_SCALE * scale))
        assert not bad.size, [(f"d {at.unknowns[i]} / d {variable}", actual[i], expected[i]) for i in bad]


# ---- tests -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "kind"), [*((m, FMU2Slave) for m in ALL), *((m, FMU2Model) for m in WITH_STATES)]
)
@given(data=st.data())
@examples(2, 25)
def test_derivatives_match_differences(
    sessions: dict[str, Session], model: str, kind: Any, data: st.DataObject
) -> None:
    """In initialization by inputs, parameters and start values; in continuous time by inputs and states."""
    with At(sessions[model], data.draw(FACTS[model].points()), kind, running=kind is FMU2Model) as at:
        check(at, data)


@pytest.mark.parametrize("model", WITH_STATES)
@pytest.mark.parametrize("kind", [FMU2Slave, FMU2Model])
@given(data=st.data())
@examples(1, 10)
def test_parameters_count_alike_in_every_phase(
    sessions: dict[str, Session], model: str, kind: Any, data: st.DataObject
) -> None:
    point = data.draw(FACTS[model].points())
    with (
        At(sessions[model], point, FMU2Slave, running=False) as before,
        At(sessions[model], point, kind, running=True) as after,
    ):
        for parameter in before.parameters:
            if parameter not in STARTS:  # by then their states have values of their own
                unknowns = [name for name in before.unknowns if name != SAMPLED.get(parameter)]
                d = before.exact({parameter: 1.0}, unknowns), after.exact({parameter: 1.0}, unknowns)
                assert np.array_equal(*d), parameter


@pytest.mark.parametrize("model", ALL)
@given(data=st.data())
@examples(1, 10, suppress_health_check=[HealthCheck.large_base_example])  # blocks have large arrays
def test_sum_of_directions_gives_the_sum(
    sessions: dict[str, Session], model: str, data: st.DataObject
) -> None:
    session = sessions[model]
    with At(session, data.draw(FACTS[model].points()), FMU2Slave, running=False) as at:
        reach = {k: at.point.reach.get(k, abs(x)) for k, x in zip(at.knowns, at.values, strict=True)}
        directions = st.fixed_dictionaries({k: st.floats(-r, r) for k, r in reach.items()})
        a, b = data.draw(directions), data.draw(directions)
        total = {k: a[k] + b[k] for k in at.knowns}
        terms = sum(np.abs(at.exact({k: 1.0})) * (abs(a[k]) + abs(b[k])) for k in at.knowns)
        size = terms + np.abs(session.get(at.slave, *at.unknowns))
        assert np.all(np.abs(at.exact(total) - at.exact(a) - at.exact(b)) <= 1e-11 * size)


def test_known_that_a_state_starts_from_moves_the_state(sessions: dict[str, Session]) -> None:
    session = sessions["Toy"]
    point = Point({"x_0": 0.5, "body.mass": 2.0, "spring.k[1]": 3.0})
    with At(session, point, FMU2Slave, running=False) as at:
        derivatives = at.exact({"x_0": 2.0}, ["x", "inverse", "der(v[1])", "der(x)"])
        assert derivatives.tolist() == [2.0, 8.0, -3.0, 0.0]


def test_unknowns_may_be_asked_in_any_order(sessions: dict[str, Session]) -> None:
    with At(sessions["Toy"], Point({"x_0": 0.5}), FMU2Slave, running=False) as at:
        forwards = at.exact({"x_0": 1.0, "v[1]": 3.0})
        assert at.exact({"v[1]": 3.0, "x_0": 1.0}, at.unknowns[::-1]).tolist() == forwards.tolist()[::-1]


# where a formula has 0 / 0 or a sign of zero, but the function is smooth

ZEROS = [
    ("EmlaPlant", {}, "u_q", {"inverter.u_q": 1.0, "inverter.u_d": 0.0, "der(i_q)": 1.0 / 2.4e-3}),
    ("EmlaPlant", {}, "u_d", {"inverter.u_q": 0.0, "inverter.u_d": 1.0, "der(i_d)": 1.0 / 2.4e-3}),
    ("EmlaPlant", {}, "inverter.u_max", {"inverter.u_q": 0.0, "der(i_q)": 0.0, "P_el": 0.0}),
    # the innovation is zero; H = H_0 at y = 0
    ("EmlaObserver", {"y": 0.0, "start.x_hat": 0.0}, "y", {"y_bar": 1.0, "f": 400.0 / 200.0}),
    # k = 1500 and P_1 = 0; A_2 = 1.5 * 8 * 0.15 / 35.26
    ("RsbaController", {}, "x_hat", {"P[1]": 1.0, "P[2]": 1500.0}),
    ("RsbaController", {"limit_acceleration": True}, "x_hat", {"P[1]": 1.0, "P[2]": 1500.0}),
    ("RsbaController", {"limit_acceleration": True}, "x_d", {"P[1]": -1.0, "P[2]": -1500.0}),
    # half the linear range of the approach: the square root that is not taken is zero
    (
        "RsbaController",
        {"limit_acceleration": True, "x_hat": 2.0**-10, "limit.a_max": 2.0 * 1500.0**2 * 2.0**-10},
        "x_hat",
        {"P[1]": 1.0, "P[2]": 1500.0},
    ),
    (
        "RsbaController",
        {"limit_current": True, "limit_voltage": True},
        "i_q",
        {"P[3]": 1.0, "u_q": -500.0 * 2.4e-3 + 0.14, "saturated": 0.0},
    ),
]


@pytest.mark.parametrize("kind", [FMU2Slave, FMU2Model])
@pytest.mark.parametrize(("model", "values", "variable", "expected"), ZEROS)
def test_derivatives_are_right_at_zeros(
    sessions: dict[str, Session],
    model: str,
    values: dict[str, Any],
    variable: str,
    expected: dict[str, float],
    kind: Any,
) -> None:
    with At(sessions[model], Point(values), kind, running=kind is FMU2Model) as at:
        assert np.isfinite(at.exact({variable: 1.0})).all()
        derivatives = at.exact({variable: 1.0}, list(expected))
        assert derivatives == pytest.approx(list(expected.values()), rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    ("unknown", "variable", "complaint"),
    [
        ("force", "force", "toy: force is not an output, state or derivative to differentiate."),
        ("body.mass", "force", "toy: body.mass is not an output, state or derivative to differentiate."),
        ("random", "force", "toy: random is not an output, state or derivative to differentiate."),
        ("count", "force", "toy: count is of type Integer."),
        ("x", "power", "toy: power is not an input, parameter or state to differentiate by."),
        ("x", "der(x)", "toy: der(x) is not an input, parameter or state to differentiate by."),
        ("x", "random", "toy: random is not an input, parameter or state to differentiate by."),
        ("x", "x", "toy: x is not an input, parameter or state to differentiate by."),
        ("x", "count", "toy: count is of type Integer."),
        ("x", "damped", "toy: damped is of type Boolean."),
    ],
)
def test_invalid_knowns_and_unknowns_are_refused(
    toy: Session, unknown: str, variable: str, complaint: str
) -> None:
    slave = toy.instance(running=False)
    with refused():
        slave.getDirectionalDerivative(toy.references([unknown]), toy.references([variable]), [1.0])
    assert toy.log.lines("toy") == [complaint]
    assert slave.getDirectionalDerivative(toy.references(["x"]), toy.references(["x_0"]), [1.0]) == [1.0]


def test_knowns_with_seed_zero_can_have_any_type(toy: Session) -> None:
    """OMSimulator passes all dependencies of an unknown, and 0 for all but one."""
    slave = toy.instance(running=False)
    unrelated = toy.references(["count", "damped", "random", "power"])
    assert slave.getDirectionalDerivative(
        toy.references(["x"]), [*unrelated, *toy.references(["x_0"])], [0.0, -0.0, 0.0, 0.0, 1.0]
    ) == [1.0]
    with refused():
        slave.getDirectionalDerivative(toy.references(["x"]), [10_000], [0.0])


def test_other_references_and_phases_are_refused(toy: Session) -> None:
    slave, uninitialized = toy.instance(), toy.new()
    x, force = toy.references(["x"]), toy.references(["force"])
    for instance, unknown, by in (
        (slave, [10_000], force),
        (slave, x, [2**32 - 1]),
        (uninitialized, x, force),
    ):
        with refused():
            instance.getDirectionalDerivative(unknown, by, [1.0])
    assert toy.log.lines("toy") == [
        "toy: there is no variable with value reference 10000.",
        "toy: there is no variable with value reference 4294967295.",
        "toy: cannot get directional derivatives in phase instantiated.",
    ]
    assert slave.getDirectionalDerivative(x, x, [1.0]) == [1.0]  # after initialization x is a known
