"""How large a difference of signals is, measured by the signals themselves."""

import numpy as np

from ...base.arrays import Indices, Vector
from ..network import Network

NOMINAL_SHARE = 0.01
"""Part of a variable's nominal value that counts where the signal itself is smaller."""

TINY = np.finfo(float).tiny
"""No size is smaller, so that one can divide by it."""


class Scale:
    """The size of every signal: the largest value seen so far, plus a hundredth of its nominal.

    So a force that passes through zero is still judged as a force of its usual size.
    """

    def __init__(self, network: Network) -> None:
        self._signals = network.signals
        nominals = [slave.nominals for slave in network.instances]
        self.floor: Vector = np.fmax(NOMINAL_SHARE * np.concatenate([np.empty(0), *nominals]), TINY)
        self.largest: Vector = np.zeros(len(network.signals))

    def see(self) -> None:
        """Take the present signals into account."""
        sizes = np.abs(self._signals)
        np.fmax(self.largest, sizes, out=self.largest, where=np.isfinite(sizes))

    def sizes(self, which: Indices) -> Vector:
        """The sizes of these signals."""
        return self.largest[which] + self.floor[which]

    def relative(self, difference: Vector, which: Indices) -> Vector:
        """Absolute differences of these signals, relative to the signals' sizes."""
        return np.abs(difference) / self.sizes(which)
