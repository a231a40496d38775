"""Rules of error control for jumps and for signals that do not add up, each on a system that needs it.

Without its rule, a run ends because no step is short enough, or takes far more steps.
"""

import numpy as np
import pytest

from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.error_control import ErrorControl
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.linear import LinearSlave, connected
from tests.support.simulated import begun, recorded
from tests.support.slaves import FakeSlave

GAIN = 20.0
"""Of the lag, in 1/s."""


def controlled(
    network: Network,
    name: str,
    tolerance: float,
    first: float,
    events: tuple[float, ...] = (),
    sampled: bool = False,
) -> ErrorControl:
    times = make_communication_points(1.0, first)
    algorithm = begun(network, ALGORITHMS[name]("fmu"), times)
    return ErrorControl(algorithm, times, tolerance, events=events, sampled=sampled)


def lag() -> LinearSlave:
    return LinearSlave("lag", [[-GAIN]], [[GAIN]], [[1.0]], [[0.0]], [0.0])


def source(at: float) -> LinearSlave:
    """Return a source of 0, and of 1 from this time on."""
    slave = LinearSlave("source", [[0.0]], np.empty((1, 0)), [[1.0]], np.empty((1, 0)), [0.0])
    slave._advance = lambda u, x, time, step: [1.0 if time + step >= at else 0.0]
    return slave


def test_signal_may_jump_once() -> None:
    """An FMU that passes its input on one step later jumps in one of the two ways only, in any step."""
    delay = FakeSlave("delay", 1, [0.0, 0.0], lambda u, x, t, h: [x[1], u[0]], lambda u, x: [x[0]])
    network = Network([source(0.3), delay, lag()], [Link(0, 0, 1, 0, False), Link(1, 0, 2, 0, False)])
    rows = recorded(controlled(network, "jacobi", 1e-4, 1e-3, (0.3,)))
    expected = 1.0 - np.exp(-GAIN * np.maximum(rows[:, 0] - 0.3, 0.0))
    assert np.abs(rows[:, 3] - expected).max() < 0.1  # half a step later
    assert rows[-1, 3] == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("at", [0.3, 0.3123])
def test_steps_over_known_jumps_keep_small_tolerances(at: float) -> None:
    """A line over the jump has an error in proportion to the step, which is as short as it gets."""
    stepping = controlled(connected([source(at), lag()], [(0, 0, 1, 0)]), "gauss-seidel", 1e-7, 1e-3, (at,))
    rows = recorded(stepping)
    assert np.abs(rows[:, 2] - (1.0 - np.exp(-GAIN * np.maximum(rows[:, 0] - at, 0.0)))).max() < 1e-6


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_jumps_at_unknown_times_take_few_steps(tolerance: float) -> None:
    """Five of them; the error of the lag is proportional to the step, as is what a step is allowed."""
    part = source(0.0)
    part._advance = lambda u, x, time, step: [float((time + step) % 0.37 < 0.185)]
    stepping = controlled(connected([part, lag()], [(0, 0, 1, 0)]), "jacobi", tolerance, 1e-3)
    recorded(stepping)
    assert stepping.report()["error_per_unit_step"]
    assert stepping.control.accepted + stepping.control.rejected < 300


def test_errors_of_late_direct_outputs_do_not_add_up() -> None:
    """Steps are in proportion to the root of the tolerance, not to the tolerance."""
    swing = LinearSlave(
        "swing", [[0.0, 3.0], [-3.0, 0.0]], np.empty((2, 0)), [[1.0, 0.0]], np.empty((1, 0)), [0.0, 1.0]
    )
    follower = LinearSlave("follower", [[-1.0]], [[0.0]], [[0.0]], [[2.0]], [0.0])
    network = connected([swing, follower, lag()], [(0, 0, 1, 0), (1, 0, 2, 0)])
    stepping = controlled(network, "jacobi", 1e-3, 1e-3)
    rows = recorded(stepping)
    assert np.abs(rows[:, 2] - 2.0 * np.sin(3.0 * rows[:, 0])).max() < 1e-3
    assert stepping.steps < 300
    assert stepping.remarks() == []


def plant(flag: bool) -> Network:
    """A plant with an unread output, a flag that chatters or a constant, and a reader of its position."""
    outputs = (lambda u, x: [x[0], x[1]]) if flag else (lambda u, x: [x[0], 1.0])
    advance = lambda u, x, t, h: [1.0 - (1.0 - x[0]) * np.exp(-h), -x[1]]  # noqa: E731
    reader = FakeSlave("reader", 1, [0.0], lambda u, x, t, h: x + h * u)
    return Network([FakeSlave("plant", 0, [0.0, 1.0], advance, outputs), reader], [Link(0, 0, 1, 0, False)])


def test_unread_chattering_flag_does_not_end_the_run() -> None:
    """Nor does it keep steps short: after ten jumps it is not controlled any more."""
    stepping = controlled(plant(flag=True), "gauss-seidel", 1e-2, 1e-2)
    rows = recorded(stepping)
    assert stepping.steps < 200
    assert np.abs(rows[:, 1] - (1.0 - np.exp(-rows[:, 0]))).max() < 1e-2


def test_unread_flags_of_sampled_components_have_no_influence() -> None:
    calm, chattering = (
        controlled(plant(flag), "gauss-seidel", 1e-2, 1e-2, sampled=True) for flag in (False, True)
    )
    assert recorded(calm)[:, 0].tolist() == recorded(chattering)[:, 0].tolist()
