"""Compute consistent initial values: along the connections, and by Newton's method in loops."""

import numpy as np

from ...base.arrays import Indices, Vector
from ...base.errors import RunError, join_names
from ..network import Link, Network
from .newton import Newton, NoSolutionError, Scale


def initialize(network: Network, start_time: float, stop_time: float | None) -> None:
    """Initialize all instances; signals then hold the initial outputs.

    Instances get their inputs in the order in which initial values depend on each other. Loops are
    solved, with the start values of the inputs as first guess. Strings and Binary values are
    exchanged until they stay the same. Values are exchanged once more after initialization mode.

    Args:
        network: Instances with start values.
        start_time: In s.
        stop_time: In s; None if the run has no fixed end.

    Raises:
        RunError: No solution of a loop was found, or a value is not finite.
        InstanceError: A call of an FMU failed.
    """
    for instance in network.instances:
        instance.enter_initialization(start_time, stop_time)
    for i in range(len(network.instances)):
        network.assume_inputs(i)  # start values replace signals that are not known yet
    solve_initial_values(network, Scale(network))
    _exchange_opaque_values(network)
    for i in range(len(network.instances)):  # inputs that no initial value depends on
        network.pass_inputs(i)
    for instance in network.instances:
        instance.exit_initialization()
    for instance in network.instances:
        instance.get_outputs()
    network.observer.read()  # FMI 2.0.4, 4.2.4: after a set without a step, an FMU may refuse to be read
    for i in network.order:
        network.pass_inputs(i)
    network.check_finite(start_time)


def solve_initial_values(network: Network, scale: Scale) -> None:
    """Exchange values between instances in initialization mode until all are consistent.

    Raises:
        RunError: No solution of a loop was found.
        InstanceError: A call of an FMU failed.
    """
    for group, coupling_variables in find_initial_groups(network):
        _solve_group(network, group, coupling_variables, scale)


def _exchange_opaque_values(network: Network) -> None:
    """Exchange Strings and Binary values, and the numbers that may depend on them, until none changes.

    Raises:
        RunError: Values still change when each has passed all instances.
    """
    for _ in range(len(network.instances) + 1 if network.opaque_links else 0):
        if not network.pass_opaque_values():
            return
        solve_initial_values(network, Scale(network))
    if network.opaque_links and network.pass_opaque_values():
        names = join_names([f"{x.target.name}.{x.input.name}" for x in network.opaque_links])
        raise RunError(
            f"the initial values of {names} do not settle: they still change. Remove a connection."
        )


def find_initial_groups(network: Network) -> list[tuple[list[int], Indices]]:
    """Return the groups that are initialized together, in order, and their coupling variables.

    An instance outside of loops is a group without coupling variables.
    """
    groups = network.groups(_is_initial)
    return [(group, network.find_coupling_variables(group, _is_initial)) for group in groups]


def _is_initial(link: Link) -> bool:
    return link.initial


def _solve_group(network: Network, group: list[int], coupled: Indices, scale: Scale) -> None:
    """Exchange values within a group until they are consistent."""

    def sweep() -> None:
        for i in group:
            network.pass_inputs(i)
            network.instances[i].get_outputs()

    if not len(coupled):
        sweep()
        return

    def pass_through_group(guess: Vector) -> Vector:
        """Return the coupled signals after one pass; the solution is a fixed point."""
        network.signals[coupled] = guess
        sweep()
        return network.signals[coupled]

    def list_sizes(values: Vector) -> Vector:
        return np.abs(values) + scale.floor[coupled]  # not the largest so far: earlier guesses can be huge

    try:
        solution = Newton(pass_through_group, list_sizes).solve(network.signals[coupled])
        # more accurate than the answer, whose rounding errors the loop amplifies
        network.signals[coupled] = solution
    except NoSolutionError as failure:
        raise RunError(_explain_no_solution(network, group, coupled, failure)) from failure


def _explain_no_solution(
    network: Network, group: list[int], coupled: np.ndarray, failure: NoSolutionError
) -> str:
    """Return the message on a loop whose initial values do not agree."""
    loop = network.loop_name(group)
    if failure.singular.any():
        names = join_names([network.names[s] for s in coupled[failure.singular]])
        gap = failure.gap[failure.singular]
        return (
            f"the initial values of the loop {loop} have no solution: the gain around the loop is 1 "
            f"for {names}, so a difference of {np.abs(gap).max():.3g} always remains. "
            "Change a parameter of the loop, or remove a connection."
        )
    nonfinite = [network.names[s] for s in coupled[~np.isfinite(failure.gap)]]
    changing = [network.names[s] for s in coupled[failure.gap != 0.0]]
    problem = (
        f"{join_names(nonfinite)} became infinite or NaN"
        if nonfinite
        else f"{join_names(changing)} still change"
    )
    return (
        f"the initial values of the loop {loop} do not settle in {failure.calls} exchanges: {problem}. "
        "Set start values of its inputs nearer to the solution, or remove a connection."
    )
