"""What the inputs do during a step: held, or followed along the straight line of their sources.

Let y and y' be the two newest values of a source, from the times t_y and t_y'. A step from t of
length h then sees

    none    u = y                                                   all through the step
    master  u = y + (t + h/2 - t_y)/(t_y - t_y') (y - y')           all through the step
    fmu     u(s) = y + (s - t_y)/(t_y - t_y') (y - y')              for t <= s <= t + h

`master` uses the line's value in the middle of the step, `fmu` gives the line itself to
`fmi2SetRealInputDerivatives`. A source that has been stepped already makes this an interpolation.
The factor and the offset of a link are applied to what comes out, and the factor to its slope.
For a slave that does several steps at once, y' is the value that it took at its step before, where that
is older: the line goes over all of its long step, and noise in the last short one is not prolonged.

In smooth motion held inputs make states exact to first order in the step, followed ones to second
order. After `master` an output in which an input shows at once is still that of the middle of the
step: exact to first order, and so is what it drives.
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
    """How one slave's inputs are treated."""

    HOLD = 0
    MIDDLE = 1
    LINE = 2


_HOLD, _MIDDLE, _LINE = (int(mode) for mode in Mode)  # comparing numbers is cheaper in the loop


@dataclass
class History:
    """The signals one communication point earlier, and when each slave's signals were.

    `previous` has the shape of the signals; `at` and `before` hold, per slave, the times in s of
    its newest signals and of those in `previous`. `taken` holds, per input of slaves that step more
    rarely than others, the signal that it took last, and `taken_at` that signal's time.
    """

    previous: Vector
    at: Vector
    before: Vector
    taken: Vector
    taken_at: Vector


class Exchange:
    """Passes signals on to the slaves, extrapolated or not, and reads them back.

    A slave that cannot take input derivatives gets the middle of the line instead; discrete
    signals and discrete inputs are always held.
    """

    def __init__(self, network: Network, extrapolation: str = "none") -> None:
        self.network = network
        count, size = len(network.instances), len(network.signals)
        self.owners: Indices = np.zeros(size, dtype=np.intp)
        self.smooth = np.zeros(size, dtype=bool)
        for i, (slave, part) in enumerate(zip(network.instances, network.parts, strict=True)):
            self.owners[part], self.smooth[part] = i, slave.continuous_outputs
        self.modes = [int(_mode(extrapolation, slave.interpolates)) for slave in network.instances]
        self.derivatives: Vector = np.zeros(len(network.inputs))
        taken = len(network.inputs)
        self.history = History(*(np.zeros(n) for n in (size, count, count, taken, taken)))
        self.rare = [False] * count
        """Which slaves take inputs more rarely than others give outputs."""

    @property
    def accuracy(self) -> int:
        """Order in the step of what is exchanged, in smooth motion."""
        behind = any(link.direct and self.modes[link.target] == _MIDDLE for link in self.network.links)
        return 1 if behind or _HOLD in self.modes else 2

    def sample(self, slaves: Collection[int]) -> None:
        """Let these slaves hold their outputs, and know when they took inputs last."""
        for i in slaves:
            self.rare[i], self.smooth[self.network.parts[i]] = True, False

    def begin(self, time: float) -> None:
        """The present signals are those of `time` in s, and there were none before."""
        self.history.previous[:] = self.network.signals
        self.history.at[:] = self.history.before[:] = self.history.taken_at[:] = time
        for taken, sources in zip(self.network.input_parts, self.network.sources, strict=True):
            self.history.taken[taken] = self.network.signals[sources]

    def pass_inputs(self, i: int, time: float, step: float) -> None:
        """Give slave i its inputs for the step from `time` of length `step`, both in s."""
        mode = self.modes[i]
        if mode == _HOLD:
            self.network.pass_inputs(i)
            return
        slave, sources = self.network.instances[i], self.network.sources[i]
        slopes = self.derivatives[self.network.input_parts[i]]
        rates = self._rates_since_taken(i) if self.rare[i] else self._rates(sources)
        slopes[:] = np.where(slave.continuous_inputs, rates, 0.0)
        ahead = time - self.history.at[self.owners[sources]] + (0.5 * step if mode == _MIDDLE else 0.0)
        slave.inputs[:] = self.network.signals[sources] + ahead * slopes
        if self.network.transforms[i]:
            self.network.transform(i)
            slopes *= self.network.factors[i]
        slave.set_inputs()
        if mode == _LINE:
            slave.set_input_derivatives(slopes)

    def shares(self, i: int) -> Vector:
        """How far slave i's inputs at the end of a step follow a change of the signals there."""
        follows = self.network.factors[i].copy()
        if self.modes[i] == _MIDDLE:
            moves = self.smooth[self.network.sources[i]] & self.network.instances[i].continuous_inputs
            follows[moves] *= 0.5
        return follows

    def predict(self, which: Indices, time: float) -> Vector:
        """Where these signals would be at `time` in s if they went on along their lines."""
        ahead = time - self.history.at[self.owners[which]]
        return self.network.signals[which] + ahead * self._rates(which)

    def _rates(self, which: Indices) -> Vector:
        """How fast these signals changed last, per s; 0 for discrete ones and where nothing is known."""
        return self._slopes(which, self.history.previous[which], self.history.before[self.owners[which]])

    def _rates_since_taken(self, i: int) -> Vector:
        """How fast the signals changed that slave i reads since it read them; it reads them now."""
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
        """Slopes from these earlier values, of these times, to the present ones."""
        span = self.history.at[self.owners[which]] - then
        change = self.network.signals[which] - earlier
        rates = np.zeros(len(which))
        return np.divide(change, span, out=rates, where=self.smooth[which] & (span > 0.0))

    def shift(self, i: int, time: float) -> None:
        """Slave i's signals become the earlier ones; new ones of `time` in s will follow."""
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
