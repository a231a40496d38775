"""Sizes of signals, to which differences are compared."""

import numpy as np

from ...base.arrays import Indices, Vector
from ..network import Network

NOMINAL_SHARE = 0.01
"""Fraction of a variable's nominal value that is added to the size of its signal."""

TINY = np.finfo(float).tiny
"""Smallest size, so that a division by a size is safe."""


class Scale:
    """The size of every signal: its largest absolute value so far, plus a hundredth of its nominal value.

    So a force that passes through zero keeps the size of a typical force.
    """

    def __init__(self, network: Network) -> None:
        nominals = [instance.nominals for instance in network.instances]
        self.floor: Vector = np.fmax(NOMINAL_SHARE * np.concatenate([np.empty(0), *nominals]), TINY)
        self.largest: Vector = np.zeros(len(network.signals))

    def sizes(self, which: Indices) -> Vector:
        """Return the sizes of these signals."""
        return self.largest[which] + self.floor[which]

    def relative(self, difference: Vector, which: Indices) -> Vector:
        """Return absolute differences of these signals, divided by their sizes."""
        return np.abs(difference) / self.sizes(which)
