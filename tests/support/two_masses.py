"""Two masses, coupled by a spring or fixed to each other, as linear slaves."""

import numpy as np

from tests.support.linear import LinearSlave, Wire

Part = tuple[list[LinearSlave], list[Wire]]
STIFFNESS, DAMPING, MASS = 400.0, 2.0, 1.0


def actuator() -> LinearSlave:
    """A mass on a spring: takes a force, gives displacement, speed and acceleration."""
    k, c = STIFFNESS / MASS, DAMPING / MASS
    D = [[0.0], [0.0], [1.0 / MASS]]
    return LinearSlave("actuator", [[0, 1], [-k, -c]], [0, 1 / MASS], [[1, 0], [0, 1], [-k, -c]], D, [0.1, 0])


def elastic_load() -> Part:
    """A second mass hung on the first with a spring and a damper: F of x and v."""
    k, c, m = 100.0, 4.0, 0.5
    load = LinearSlave(
        "load", [[0, 1], [-k / m, -c / m]], [[0, 0], [k / m, c / m]], [k, c], [[-k, -c]], [0, 0]
    )
    return [actuator(), load], [(0, 0, 1, 0), (0, 1, 1, 1), (1, 0, 0, 0)]


def rigid_load(mass: float) -> Part:
    """A second mass that is fixed to the first: F = -m a."""
    return [actuator(), LinearSlave("load", [], [], [], [[-mass]], [])], [(0, 2, 1, 0), (1, 0, 0, 0)]


def rigid_solution(mass: float, time: np.ndarray) -> np.ndarray:
    """Displacement of both masses as one: (m_1 + m_2) x'' + c x' + k x = 0."""
    total_mass = MASS + mass
    decay, omega = (
        0.5 * DAMPING / total_mass,
        np.sqrt(STIFFNESS / total_mass - (0.5 * DAMPING / total_mass) ** 2),
    )
    return 0.1 * np.exp(-decay * time) * (np.cos(omega * time) + decay / omega * np.sin(omega * time))
