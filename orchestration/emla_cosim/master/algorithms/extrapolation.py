"""Set inputs during a step: known, held, or extrapolated along a straight line through their sources.

Data from files are known in advance, so nothing is held: see `Known`. All other signals are not.

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
from numpy.typing import NDArray

from ...base.arrays import Indices, Vector
from ...base.errors import RunError
from ..instances.fmu_instance import FmuInstance
from ..network import Link, Network

TRIAL = 1e-3
"""Change of an input, relative to its size, that shows whether outputs follow it."""

EXTRAPOLATIONS = ("none", "master", "fmu")
"""Names of the ways to treat inputs during a step."""


class Mode(IntEnum):
    """How the inputs of one instance change during a step."""

    HOLD = 0
    MIDDLE = 1
    LINE = 2


class Known(IntEnum):
    """What an input reads of a signal that is known in advance, in a step of length h from t.

    A jump inside the step has the effect of its time: the line is the mean then.
    """

    NOT_KNOWN = 0
    SAMPLE = 1
    """The value at t + h: a digital controller samples then, and so does a variable with a clock."""
    BEGIN = 2
    """The value at t: a discrete variable keeps it during the step."""
    LINE = 3
    """The straight line from t to t + h."""
    MEAN = 4
    """The mean of the step: the FMU does not interpolate."""


KNOWN_TEXTS = {
    Known.SAMPLE: "sampled",
    Known.BEGIN: "value at the start of the step",
    Known.LINE: "line",
    Known.MEAN: "mean of the step",
}
"""What a known input reads, in the record of a run."""


@dataclass
class History:
    """Earlier values of the signals, and their times.

    Args:
        previous: Signals one communication point earlier.
        at: Per instance, the time in s of its newest signals.
        before: Per instance, the time in s of its signals in `previous`.
        last_read: Per input of instances with a step multiple, the signal that it read last.
        last_read_at: The times in s of these signals.
    """

    previous: Vector
    at: Vector
    before: Vector
    last_read: Vector
    last_read_at: Vector


class Exchange:
    """How signals pass to the instances: extrapolated or held.

    With `fmu`, an instance without support for input derivatives gets the value in the middle of the line.
    Known signals do not depend on the extrapolation.
    Discrete signals and discrete inputs are always held.
    """

    def __init__(self, network: Network, extrapolation: str = "none") -> None:
        self.network = network
        count, size = len(network.instances), len(network.signals)
        self.owners: Indices = np.zeros(size, dtype=np.intp)
        self.smooth = np.zeros(size, dtype=bool)
        for i, (instance, part) in enumerate(zip(network.instances, network.parts, strict=True)):
            self.owners[part], self.smooth[part] = i, instance.continuous_outputs
        self.modes = [
            int(_choose_mode(extrapolation, instance.interpolates)) for instance in network.instances
        ]
        self.derivatives: Vector = np.zeros(len(network.inputs))
        input_count = len(network.inputs)
        self.history = History(*(np.zeros(n) for n in (size, count, count, input_count, input_count)))
        self.readings: list[Indices] = [np.zeros(len(x.inputs), dtype=np.intp) for x in network.instances]
        """Per instance, what its inputs read, as numbers of `Known`."""
        self.follows = np.zeros(count, dtype=np.int32)
        """Per instance, whether its outputs follow known inputs that are set after a step."""
        self.rare = [False] * count
        """Per instance, whether it reads its inputs more rarely than each step."""

    @property
    def accuracy(self) -> int:
        """Order of accuracy of the exchange with respect to the step size, in smooth motion."""
        has_known_inputs = any((kinds != Known.NOT_KNOWN).any() for kinds in self.readings)
        if not has_known_inputs and Mode.HOLD in self.modes:
            return 1
        return 1 if any(map(self._is_first_order, self.network.links)) else 2

    @property
    def holds(self) -> bool:
        """Whether an input holds a continuous signal over steps because it is not known in advance."""
        network = self.network
        return any(
            self.modes[x.target] == Mode.HOLD and self.smooth[network.signal(x)]
            for x in network.links
            if self.readings[x.target][x.input] == Known.NOT_KNOWN
            and network.instances[x.target].continuous_inputs[x.input]
        )

    def reads_middle_value(self, link: Link) -> bool:
        """Return whether an input has the value of the middle of a step, or the mean, throughout the step."""
        reading = self.readings[link.target][link.input]
        is_in_middle = self.modes[link.target] == Mode.MIDDLE
        return reading == Known.MEAN or (reading == Known.NOT_KNOWN and is_in_middle)

    def _is_first_order(self, link: Link) -> bool:
        """Return whether a link is accurate to first order only."""
        is_known = self.readings[link.target][link.input] != Known.NOT_KNOWN
        is_held = not is_known and self.modes[link.target] == Mode.HOLD
        return is_held or (link.direct and self.reads_middle_value(link))

    def use_known_sources(self, tables: Collection[int], rare: Collection[int]) -> None:
        """Read the signals of these instances as known in advance; they step before all others.

        Args:
            tables: Positions of these instances.
            rare: Positions of instances that do several steps at once.
        """
        samplers = {*self.network.samplers, *rare, *(i for i, is_rare in enumerate(self.rare) if is_rare)}
        for link in self.network.links:
            if link.source in tables:
                reading = Known.SAMPLE if link.target in samplers else self._choose_reading(link)
                self.readings[link.target][link.input] = reading

    def _choose_reading(self, link: Link) -> Known:
        """Return what an input that does not sample reads of a known signal."""
        source, target = self.network.instances[link.source], self.network.instances[link.target]
        if target.clocked_inputs[link.input]:
            return Known.SAMPLE
        if not target.continuous_inputs[link.input] or not len(source.span_references):
            return Known.BEGIN
        return Known.LINE if target.interpolates else Known.MEAN

    def reads_known_signal(self, i: int) -> bool:
        """Return whether instance i reads a signal that is known in advance."""
        return bool((self.readings[i] != Known.NOT_KNOWN).any())

    def has_slopes(self, i: int) -> bool:
        """Return whether instance i gets derivatives of its inputs."""
        return self.modes[i] == Mode.LINE or bool((self.readings[i] == Known.LINE).any())

    def find_readers_of_means(self) -> set[int]:
        """Return the instances with outputs that depend directly on the mean of a known signal."""
        means = [x for x in self.network.links if self.readings[x.target][x.input] == Known.MEAN]
        return {x.target for x in means if x.direct or x.shows}

    def detect_following_instances(self) -> None:
        """Set `follows`: which FMUs compute their outputs anew after known inputs were set.

        Some keep the outputs of their step, and FMI 2.0 lets them refuse to be read. So this is tried on a
        copy of the state.
        """
        for i in self.find_readers_of_means():
            instance = self.network.instances[i]
            self.follows[i] = instance.rolls_back and _has_following_outputs(
                instance, self.readings[i] == Known.MEAN
            )

    def describe_known_inputs(self) -> dict[str, str]:
        """Return what each input with a known signal reads, by the name of its connection."""
        return {
            link.name: KNOWN_TEXTS[Known(reading)]
            for link in self.network.links
            if (reading := self.readings[link.target][link.input]) != Known.NOT_KNOWN
        }

    def mark_sampled(self, instances: Collection[int]) -> None:
        """Treat these instances as sampled: others hold their outputs, and lines span their long steps."""
        for i in instances:
            self.rare[i], self.smooth[self.network.parts[i]] = True, False

    def begin(self, time: float) -> None:
        """Start a new history with the present signals at `time` in s."""
        self.history.previous[:] = self.network.signals
        self.history.at[:] = self.history.before[:] = self.history.last_read_at[:] = time
        for part, sources in zip(self.network.input_parts, self.network.sources, strict=True):
            self.history.last_read[part] = self.network.signals[sources]

    def compute_shares(self, i: int) -> Vector:
        """Return how much instance i's inputs change per change of the signals at the end of a step."""
        follows = self.network.factors[i].copy()
        if self.modes[i] == Mode.MIDDLE:
            moves = self.smooth[self.network.sources[i]] & self.network.instances[i].continuous_inputs
            # the value in the middle of the step takes half of the change at its end
            follows[moves] *= 0.5
        return follows


def _has_following_outputs(instance: FmuInstance, is_known_input: NDArray[np.bool_]) -> bool:
    """Return whether outputs change with these inputs although no step is done; all is then as before."""
    state, inputs, outputs = instance.save(), instance.inputs.copy(), instance.outputs.copy()
    try:
        for sign in (1.0, -1.0):  # one of the values may be out of range
            instance.inputs[is_known_input] += sign * TRIAL * (1.0 + np.abs(inputs[is_known_input]))
            try:
                instance.set_inputs()
                instance.get_outputs()
                return not np.array_equal(outputs, instance.outputs)
            except RunError:
                continue
            finally:
                instance.inputs[:], instance.outputs[:] = inputs, outputs
                instance.restore(state)
        return False
    finally:
        instance.forget(state)


def _choose_mode(extrapolation: str, can_interpolate: bool) -> Mode:
    """Return how the inputs of an instance change during a step."""
    if extrapolation == "none":
        return Mode.HOLD
    # an FMU that cannot interpolate gets the value that its input has on average in the step
    return Mode.LINE if extrapolation == "fmu" and can_interpolate else Mode.MIDDLE
