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


_HOLD, _MIDDLE, _LINE = (int(mode) for mode in Mode)  # integers compare faster


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
    """Pass signals to the instances, extrapolated or held.

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
        behind = any(link.direct and self.modes[link.target] == _MIDDLE for link in self.network.links)
        return 1 if behind or _HOLD in self.modes else 2

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

    def pass_inputs(self, i: int, time: float, step: float) -> None:
        """Set the inputs of instance i for the step from `time` of length `step`, both in s."""
        mode = self.modes[i]
        if mode == _HOLD:
            self.network.pass_inputs(i)
            return
        instance, sources = self.network.instances[i], self.network.sources[i]
        slopes = self.derivatives[self.network.input_parts[i]]
        rates = self._rates_since_taken(i) if self.rare[i] else self._rates(sources)
        slopes[:] = np.where(instance.continuous_inputs, rates, 0.0)
        ahead = time - self.history.at[self.owners[sources]] + (0.5 * step if mode == _MIDDLE else 0.0)
        instance.inputs[:] = self.network.signals[sources] + ahead * slopes
        if self.network.transforms[i]:
            self.network.transform(i)
            slopes *= self.network.factors[i]
        instance.set_inputs()
        if mode == _LINE:
            instance.set_input_derivatives(slopes)

    def shares(self, i: int) -> Vector:
        """Return how much instance i's inputs change per change of the signals at the end of a step."""
        follows = self.network.factors[i].copy()
        if self.modes[i] == _MIDDLE:
            moves = self.smooth[self.network.sources[i]] & self.network.instances[i].continuous_inputs
            follows[moves] *= 0.5
        return follows

    def predict(self, which: Indices, time: float) -> Vector:
        """Return these signals, extrapolated to `time` in s."""
        ahead = time - self.history.at[self.owners[which]]
        return self.network.signals[which] + ahead * self._rates(which)

    def _rates(self, which: Indices) -> Vector:
        """Return the last slopes of these signals, per s; 0 for discrete or unknown ones."""
        return self._slopes(which, self.history.previous[which], self.history.before[self.owners[which]])

    def _rates_since_taken(self, i: int) -> Vector:
        """Return the slopes of instance i's signals since it last read them, and record the new reading."""
        history, which, part = self.history, self.network.sources[i], self.network.input_parts[i]
        before = history.before[self.owners[which]]
        older = history.taken_at[part] < before
        earlier = np.where(older, history.taken[part], history.previous[which])
        rates = self._slopes(which, earlier, np.where(older, history.taken_at[part], before))
        history.taken[part], history.taken_at[part] = (
            self.network.signals[which],
            history.at[self.owners[which]],
        )
        return rates

    def _slopes(self, which: Indices, earlier: Vector, then: Vector) -> Vector:
        """Return the slopes from earlier values at the times `then` to the present ones."""
        span = self.history.at[self.owners[which]] - then
        change = self.network.signals[which] - earlier
        rates = np.zeros(len(which))
        return np.divide(change, span, out=rates, where=self.smooth[which] & (span > 0.0))

    def shift(self, i: int, time: float) -> None:
        """Move instance i's signals to the history, before it writes those of `time` in s."""
        history, part = self.history, self.network.parts[i]
        history.previous[part] = self.network.signals[part]
        history.before[i] = history.at[i]
        history.at[i] = time


def _mode(extrapolation: str, interpolates: bool) -> Mode:
    match extrapolation:
        case "none":
            return Mode.HOLD
        case "fmu" if interpolates:
            return Mode.LINE
        case _:
            return Mode.MIDDLE
