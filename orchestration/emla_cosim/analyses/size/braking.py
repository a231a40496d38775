"""Energy that flows back from a motor: what the DC link stores, and what the brake resistor takes."""

import numpy as np

from ...base.arrays import Vector


def brake_power(time: Vector, power: Vector, capacity: float) -> Vector:
    """Return the power in W of the brake resistor in each interval of a cycle that repeats.

    Energy from the motor first charges the DC link. When this is full, the resistor takes the rest. The motor
    takes its energy first from the DC link, then from the supply.

    Args:
        time: Times in s, shape (rows,).
        power: Electrical power into the motor in W, shape (rows,).
        capacity: Energy in J that the DC link stores until the resistor turns on.

    Returns:
        Mean power in W of each interval, shape (rows - 1,).
    """
    steps = np.diff(time)
    energy = -0.5 * (power[1:] + power[:-1]) * steps
    if capacity <= 0.0:
        taken = np.maximum(energy, 0.0)
    else:
        stored, taken = 0.0, np.zeros_like(energy)
        for _ in range(2):  # the second time, the link starts as it ended
            burnt = []
            for more in energy.tolist():
                stored = max(stored + more, 0.0)
                burnt.append(max(stored - capacity, 0.0))
                stored = min(stored, capacity)
            taken = np.array(burnt)
    return np.divide(taken, steps, out=np.zeros_like(taken), where=steps > 0.0)
