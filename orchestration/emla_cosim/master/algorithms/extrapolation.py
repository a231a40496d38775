"""Set inputs during a step: held, or extrapolated along a straight line through their sources.

Let y and y' be the two newest values of a source, from the times t_y and t_y'. A step from t of
length h then reads

    none    u = y                                                   all through the step
    master  u = y + (t + h/2 - t_y)/(t_y - t_y') (y - y')           all through the step
    fmu     u(s) = y + (s - t_y)/(t_y - t_y') (y - y')              for t <= s <= t + h

`master` uses the value of the line in the middle of the step; `fmu` passes the line itself to
`fmi2SetRealInputDerivatives`. If the source has already done the step, this is an interpolation.
The factor and the offset of a link apply to the result, and the factor to its slope. If an instance does
several steps at once, y' is the value from its previous step if that is older. Then the line spans its whole
long step, and noise in the last short step is not amplified.

In smooth motion, states are accurate to first order in the step with held inputs, and to second order
with a line. With `master`, an output that depends directly on an input is still that of the middle of the
step: it is accurate to first order, and so is everything that it drives.
"""

from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from ...base.arrays import Indices, Vector
from ..network import Network

EXTRAPOLATIONS = ("none", "master", "fmu")
"""Names of the ways to treat inputs during a step."""


class Mode(IntEnum):
    """How the inputs of one instance change during a step."""

    HOLD = 0
    MIDDLE = 1
    LINE = 2


@dataclass
class History:
    """Earlier values of the signals, and their times.

    Args:
        previous: Signals one communication point earlier.
        at: Per instance, the time in s of its newest signals.
        before: Per instance, the time in s of its signals in `previous`.
        taken: Per input of instances with a step multiple, the signal that it read last.
        taken_at: The times in s of these signals.
    """

    previous: Vector
    at: Vector
    before: Vector
    taken: Vector
    taken_at: Vector


class Exchange:
    """How signals pass to the instances: extrapolated or held.

    With `fmu`, an instance without support for input derivatives gets the value in the middle of the line.
    Discrete signals and discrete inputs are always held.
    """

    def __init__(self, network: Network, extrapolation: str = "none") -> None:
        self.network = network
        count, size = len(network.instances), len(network.signals)
        self.owners: Indices = np.zeros(size, dtype=np.intp)
        self.smooth = np.zeros(size, dtype=bool)
        for i, (instance, part) in enumerate(zip(network.instances, network.parts, strict=True)):
            self.owners[part], self.smooth[part] = i, instance.continuous_outputs
        self.modes = [int(_mode(extrapolation, instance.interpolates)) for instance in network.instances]
        self.derivatives: Vector = np.zeros(len(network.inputs))
        taken = len(network.inputs)
        self.history = History(*(np.zeros(n) for n in (size, count, count, taken, taken)))
        self.rare = [False] * count
        """Per instance, whether it reads its inputs more rarely than each step."""

    @property
    def accuracy(self) -> int:
        """Order of accuracy of the exchange with respect to the step size, in smooth motion."""
        behind = any(link.direct and self.modes[link.target] == Mode.MIDDLE for link in self.network.links)
        return 1 if behind or Mode.HOLD in self.modes else 2

    def sample(self, instances: Collection[int]) -> None:
        """Treat these instances as sampled: others hold their outputs, and lines span their long steps."""
        for i in instances:
            self.rare[i], self.smooth[self.network.parts[i]] = True, False

    def begin(self, time: float) -> None:
        """Start a new history with the present signals at `time` in s."""
        self.history.previous[:] = self.network.signals
        self.history.at[:] = self.history.before[:] = self.history.taken_at[:] = time
        for taken, sources in zip(self.network.input_parts, self.network.sources, strict=True):
            self.history.taken[taken] = self.network.signals[sources]

    def shares(self, i: int) -> Vector:
        """Return how much instance i's inputs change per change of the signals at the end of a step."""
        follows = self.network.factors[i].copy()
        if self.modes[i] == Mode.MIDDLE:
            moves = self.smooth[self.network.sources[i]] & self.network.instances[i].continuous_inputs
            follows[moves] *= 0.5
        return follows


def _mode(extrapolation: str, interpolates: bool) -> Mode:
    match extrapolation:
        case "none":
            return Mode.HOLD
        case "fmu" if interpolates:
            return Mode.LINE
        case _:
            return Mode.MIDDLE
