"""What a run says about the exchange between its components: record, figures, and remarks on its error."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ..base.errors import join_names
from ..master.algorithms.algorithm import Algorithm
from ..master.algorithms.continuous_connections import ContinuousConnection, list_continuous_connections
from ..master.algorithms.extrapolation import Mode
from ..master.coupling.estimate import DIFFERENCES, CouplingError, CouplingEstimate
from ..master.grouping import Sampling
from ..master.stepping.step_size_control import FixedSteps
from ..master.stepping.stepping_base import Stepping

LARGEST_ERROR = 0.01
"""Estimated error, as a fraction of a signal's range, above which a remark is added."""

AIM = 0.005
"""Error at which a recommended step aims."""

LARGEST_SHOWN = 10.0
"""Largest error that is written as a number."""

SMALLEST_SHOWN = 1e-5
"""Smallest error that is written as a number."""

DIVERGES = 1.0
"""Error from which on an explicit exchange in a loop may be unstable at any step."""

SWITCHED_OFF = "it is switched off"
NO_CONNECTIONS = "no connection joins two components of which neither samples"
ERROR_CONTROL = "error control has an estimate of its own"
UNFINISHED = "the run has not reached its end"
EARLIER_RUN = "an earlier run of this simulation has an estimate"
"""Expected reasons for no estimate."""

_USES = {
    (Mode.HOLD, True): "held",
    (Mode.HOLD, False): "held",
    (Mode.MIDDLE, True): "extrapolated to the middle of the step",
    (Mode.MIDDLE, False): "interpolated in the middle of the step",
    (Mode.LINE, True): "extrapolated",
    (Mode.LINE, False): "interpolated",
}
"""How an input changes during a step, by its mode and whether its source is late."""


class LateSample(NamedTuple):
    """What a component that samples reads one step late: names of output, input and component."""

    signal: str
    input: str
    reader: str


@dataclass(frozen=True)
class CouplingSummary:
    """The continuous connections of a run, and the estimate of their error.

    Attributes:
        algorithm: The algorithm of the run, after `setup`.
        step: The step size in s.
        connections: Connections between components that compute in continuous time.
        not_estimated: Why the error is not estimated; empty if it is.
        delayed: Connections outside of continuous loops that delay a value by a step, which the estimate
            does not show: those that are not late in the order of the network, those from a component in
            continuous time. Values that a sampling component holds until its next sample are not delayed.
        is_fixed: Whether all steps have the same size.
    """

    algorithm: Algorithm
    step: float
    connections: Sequence[ContinuousConnection] = field(default=())
    not_estimated: str = ""
    delayed: Sequence[str] = ()
    is_fixed: bool = True

    @classmethod
    def of(
        cls, algorithm: Algorithm, stepping: Stepping, sampling: Sampling, is_requested: bool
    ) -> "CouplingSummary":
        """Return the summary before the first step; the stepping then saves what an estimate needs.

        Args:
            algorithm: The algorithm, after `setup`.
            stepping: What does its steps.
            sampling: Which components sample.
            is_requested: Whether the error is to be estimated.
        """
        instances = algorithm.network.instances
        samplers, unknown = (
            {s.name: i for i, s in enumerate(instances) if not names.isdisjoint(s.components)}
            for names in (sampling.samplers, sampling.unknown)
        )
        connections = list_continuous_connections(algorithm, samplers)
        doubtful = sorted({n for x in connections for n in (x.source, x.target)} & set(unknown))
        reason = ""
        if not is_requested:
            reason = SWITCHED_OFF
        elif not connections:
            reason = NO_CONNECTIONS
        elif doubtful:
            reason = (
                f"the model description of {join_names(doubtful)} does not show whether it samples: it has "
                "neither continuous states nor discrete variables"
            )
        elif not isinstance(stepping, FixedSteps):
            reason = ERROR_CONTROL
        else:
            rare = {i for i, is_rare in enumerate(algorithm.exchange.rare) if is_rare}
            multiples = {i for i, n in enumerate(algorithm.multiples) if n > 1}
            signals = sorted({x.signal for x in connections})
            positions = {*samplers.values(), *unknown.values()} | rare | multiples
            stepping.estimate = CouplingEstimate(algorithm, stepping.loop, stepping.times, signals, positions)
        delayed = _list_delayed(algorithm, connections, samplers)
        is_fixed = isinstance(stepping, FixedSteps)
        return cls(algorithm, stepping.times.step, connections, reason, delayed, is_fixed)

    def without_estimate(self) -> CouplingError:
        """Return the result of a run whose error is not estimated."""
        return CouplingError(not_estimated=self.not_estimated or UNFINISHED)

    def record(self, error: CouplingError) -> dict[str, Any]:
        """Return what run.json has of the exchange."""
        record: dict[str, Any] = {
            "order": self.algorithm.accuracy,
            "connections": {x.name: _USES[Mode(x.mode), x.is_late] for x in self.connections},
        }
        if self.delayed:
            size = f" ({self.step:g} s)" if self.is_fixed else ""
            record["delay"] = f"One step{size} late: {_name_first(self.delayed)}"
        record |= self._describe(error)
        if error.not_estimated:
            return record | {"not_estimated": error.not_estimated}
        worst = self._find_worst(error)
        return record | {
            "estimated_error": error.errors[worst.signal],
            "worst_connection": worst.name,
            "repeated": error.repeated,
            "repeated_steps": error.repeated_steps,
        }

    def figures(self, error: CouplingError | None) -> dict[str, dict[str, float]]:
        """Return the estimated error by connection: NaN before the estimate, empty if there will be none."""
        if self.not_estimated or (error is not None and error.not_estimated):
            return {}
        errors: Mapping[int, float] = {} if error is None else error.errors
        return {x.name: {"estimated_error": errors.get(x.signal, math.nan)} for x in self.connections}

    def remarks(self, error: CouplingError) -> list[str]:
        """Return remarks for users to read before the figures."""
        remarks = []
        middle = sorted({x.target for x in self.connections if x.mode == Mode.MIDDLE})
        if self.algorithm.extrapolation == "fmu" and middle:
            remarks.append(
                f"--extrapolation fmu: {join_names(middle)} cannot interpolate inputs, so each step has the "
                "value in the middle of the line."
            )
        if error.is_fault:
            remarks.append(f"The coupling error is not estimated: {error.not_estimated.rstrip('.')}.")
        elif (remark := self._describe(error).get("remark")) is not None:
            remarks.append(remark)
        return remarks

    def _describe(self, error: CouplingError) -> dict[str, str]:
        """Return the `remark` on a large error, or a `summary` for the terminal; empty without any."""
        if not error.errors:
            summary = self._explain_missing(error.not_estimated)
            return {} if summary is None else {"summary": summary}
        worst, order = self._find_worst(error), self.algorithm.accuracy
        size, signal = error.errors[worst.signal], self.algorithm.network.names[worst.signal]
        percent, is_difference = _format_percent(size), error.repeated == DIFFERENCES
        if size <= LARGEST_ERROR and is_difference:
            return {"summary": f"Within a step, inputs miss {signal} by roughly {percent} of its range"}
        if size <= LARGEST_ERROR:
            return {
                "summary": f"Estimated coupling error: {percent} of the range of {signal} (order {order})"
            }
        use = f"{worst.name} is {_USES[Mode(worst.mode), worst.is_late]} during each step"
        if is_difference:
            text = (
                f"Coupling error: within a step, inputs miss {signal} by roughly {percent} of its range "
                f"({use}). Whether such errors add up is not known, because FMUs cannot repeat steps."
            )
        else:
            # half the step leaves the part 0.5^order of the error
            half, about = (
                _format_percent(size * (1.0 - 0.5**order)),
                "about " if size <= LARGEST_SHOWN else "",
            )
            text = (
                f"Coupling error: {about}{percent} of the range of {signal}; half the step would change it "
                f"by {half} ({use}, order {order})."
            )
        return {"remark": f"{text} {self._advise(size)}"}

    def _explain_missing(self, reason: str) -> str | None:
        """Return one line on an error that is not estimated; None if a user expects the reason."""
        if reason in (NO_CONNECTIONS, ERROR_CONTROL, EARLIER_RUN, UNFINISHED):
            return None
        late = [x.name for x in self.connections if x.is_late and x.mode == Mode.HOLD]
        if reason == SWITCHED_OFF and not late:
            return None
        delay_text = f"; one step late: {_name_first(late)}" if late else ""
        return f"Coupling error not estimated: {reason}{delay_text}"

    def _advise(self, size: float) -> str:
        """Return what reduces an error of this size."""
        algorithm, instances = self.algorithm, {s.name: s for s in self.algorithm.network.instances}
        is_loop = any(x.is_in_loop for x in self.connections)
        if size >= DIVERGES and is_loop and not algorithm.groups:
            if all(s.rolls_back for s in instances.values()):
                return "The loop may be unstable with any step. Use --algorithm strong."
            return "The loop may be unstable with any step, and its FMUs cannot repeat steps as strong needs."
        # an error of order p falls with the p-th power of the step
        step = _round_step(self.step * (AIM / size) ** (1.0 / algorithm.accuracy))
        held_targets = {x.target for x in self.connections if x.mode != Mode.LINE}
        if algorithm.extrapolation != "fmu" and any(instances[name].interpolates for name in held_targets):
            return f"Use --extrapolation fmu, or a step of {step} s."
        return f"Use a step of {step} s."

    def _find_worst(self, error: CouplingError) -> ContinuousConnection:
        """Return a connection of the signal with the largest error, a late one if there is one."""
        return max(self.connections, key=lambda x: (error.errors[x.signal], x.is_late))


def find_late_samples(algorithm: Algorithm, samplers: Collection[str]) -> Iterator[LateSample]:
    """Yield what components that sample read one step late from those that do not sample.

    What a component that samples writes is not late: it holds its value until its next sample.

    Args:
        algorithm: The algorithm, after `setup`.
        samplers: Names of the components that sample.
    """
    network, names = algorithm.network, [instance.name for instance in algorithm.network.instances]
    late = {id(link) for link in algorithm.late_links()}
    # an instance that follows another one passes on values: their source is further back
    followed_links = {link.target: link for link in network.links if link.target in network.followers}
    for link in network.links:
        path = [link]
        while path[0].source in followed_links:
            path.insert(0, followed_links[path[0].source])
        is_read = names[link.target] in samplers and names[path[0].source] not in samplers
        if is_read and any(id(part) in late for part in path):
            signal = network.names[network.signal(path[0])]
            yield LateSample(signal, link.name.partition(" -> ")[2], names[link.target])


def _list_delayed(
    algorithm: Algorithm, connections: Sequence[ContinuousConnection], samplers: Collection[str]
) -> list[str]:
    """Return the names of `CouplingSummary.delayed`."""
    network = algorithm.network
    multiples = zip(network.instances, algorithm.multiples, strict=True)
    readers = {*samplers, *(instance.name for instance, n in multiples if n > 1)}
    in_order = {id(link) for link in network.find_feedback_links()}
    held_links = [x for x in algorithm.late_links() if algorithm.exchange.modes[x.target] == Mode.HOLD]
    names = [
        *(link.name for link in held_links if id(link) not in in_order),
        *(x.name for x in connections if x.is_late and x.mode == Mode.HOLD),
        *(f"{late.signal} -> {late.input}" for late in find_late_samples(algorithm, readers)),
    ]
    estimated = {x.name for x in connections if x.is_in_loop}
    return [name for name in dict.fromkeys(names) if name not in estimated]


def _name_first(names: Sequence[str]) -> str:
    """Return the first connection, and how many more there are."""
    return f"{names[0]} and {len(names) - 1} more, in run.json" if len(names) > 1 else names[0]


def _format_percent(share: float) -> str:
    if share < SMALLEST_SHOWN:
        return f"less than {100.0 * SMALLEST_SHOWN:g} %"
    if share > LARGEST_SHOWN:
        return f"more than {100.0 * LARGEST_SHOWN:.0f} %"
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"{100.0 * share:.0f} %"


def _round_step(step: float) -> str:
    """Return a step in s, rounded down to 1, 2 or 5 times a power of ten."""
    # 5e-5 rather than 5e-05, to be copied into a command
    power = 10.0 ** math.floor(math.log10(step))
    return f"{max(n for n in (1, 2, 5) if n * power <= step * (1.0 + 1e-9)) * power:.0e}".replace("e-0", "e-")
