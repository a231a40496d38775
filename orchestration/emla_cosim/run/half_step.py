"""The same run with half the step of what is continuous, to judge how much of a result the step makes.

Components that sample keep their sampling times: they do twice as many steps at once. What differs then is
the error of the coupling, of which half the step removes the part 1 - 2^-p with the order p of the exchange.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..base.errors import CosimError
from ..master.algorithms.algorithm import Algorithm
from ..master.instances.described_instance import DescribedInstance
from ..master.instances.event_mode_instance import EventModeInstance
from ..master.network import Network
from .coupling_summary import find_late_samples
from .options import read_options
from .registered import SEEDS
from .run_setup import plan_run
from .simulation import Simulation

_PARTS = tuple(n * 10**k for k in range(3) for n in (2, 5, 10))
"""Numbers of parts of a step to suggest: 2, 5, 10, ..., 1000."""

_MOST_NAMES = 3
"""Most components that sample that a suggestion names: those of a joint."""


class NotHalvedError(CosimError):
    """Half the step would change more than the error of the coupling; the message has no full stop."""


@dataclass(frozen=True)
class HalfStep:
    """A run with half the step of another one.

    Attributes:
        options: options of this run that differ from those of the other one.
        step: communication step of the other run in s.
        samplers: step multiples of the components that sample in the other run.
        order: order of accuracy of the exchange in the other run.
        is_held: whether inputs were held during its steps.
    """

    options: Mapping[str, Any]
    step: float
    samplers: Mapping[str, int]
    order: int
    is_held: bool

    def suggest(self, change: float) -> str:
        """Return which options to set so that half the step changes little enough.

        Args:
            change: what half the step changed, as a multiple of what it may change.
        """
        # the error of an exchange of order p falls with the p-th power of the step
        parts = next((n for n in _PARTS if float(n) ** self.order >= change), None)
        if parts is None:
            smaller = f"choose a --step-size far below {self.step / _PARTS[-1]:g}"
        else:
            smaller = f"set --step-size {self.step / parts:g}{self._format_multiples(parts)}"
        # a sampled controller would see lines in place of samples
        return f"{smaller} or --extrapolation fmu" if self.is_held and not self.samplers else smaller

    def _format_multiples(self, parts: int) -> str:
        """Return the options, as text, that keep the sampling times of samplers in steps of 1 / `parts`."""
        if len(self.samplers) > _MOST_NAMES:
            sampler = next(iter(self.samplers))
            return (
                f" and {parts} times the step multiples of the {len(self.samplers)} components that sample, "
                f"such as --step-multiple {sampler}={parts * self.samplers[sampler]}"
            )
        return "".join(f" --step-multiple {name}={parts * n}" for name, n in self.samplers.items())


def halve_step(simulation: Simulation, options: Mapping[str, Any]) -> HalfStep:
    """Start a run, and return how to repeat it with half the step of what is continuous.

    Args:
        simulation: the simulation; its present run ends.
        options: options of the run.

    Raises:
        NotHalvedError: the repetition would differ in more than the error of the coupling.
        CommandError: an option does not fit.
        RunError: an FMU fails during initialization.
    """
    plan = plan_run(simulation.options.merged(read_options(options)), simulation.name)
    if not plan.control.is_regular:
        raise NotHalvedError("the step size is controlled")
    if isinstance(plan.options.algorithm, Algorithm):
        raise NotHalvedError("the algorithm is an object; choose one by its name")
    # links and step multiples are known once the algorithm is set up
    simulation.start(recorders=[], **options)
    algorithm, system = simulation.stepping.algorithm, simulation.system
    declared = [component.name for component in system.components if component.samples]
    samplers = {**dict.fromkeys(declared, 1), **algorithm.step_multiples}
    if (reason := _explain_change(algorithm, samplers)) is not None:
        raise NotHalvedError(reason)
    parameters = simulation.so_far().parameters
    # random numbers that are drawn in each step differ with twice as many steps
    seeds = (seed for find in SEEDS for seed in find(parameters))
    if random := next((seed for seed in seeds if system.split(seed)[0].name not in samplers), None):
        raise NotHalvedError(f"{system.split(random)[0].name} draws random numbers in each step ({random})")
    step = plan.times.step
    # rows at the same times as before, so that both runs can be compared
    halved: dict[str, Any] = {"step_size": 0.5 * step, "output_interval": plan.steps_per_row * step}
    if samplers:
        halved["step_multiples"] = {sampler: 2 * n for sampler, n in samplers.items()}
    return HalfStep(halved, step, samplers, algorithm.accuracy, algorithm.exchange.holds)


def _explain_change(algorithm: Algorithm, samplers: Mapping[str, int]) -> str | None:
    """Return why components that sample would not keep their behavior; None if they would."""
    network, names = algorithm.network, [instance.name for instance in algorithm.network.instances]
    for i, (name, multiple) in enumerate(zip(names, algorithm.multiples, strict=True)):
        if multiple != algorithm.step_multiples.get(name, 1):
            return f"the algorithm does {multiple} steps of {name} at once"
        if name in samplers and any(i in group.members for group in algorithm.groups):
            return (
                f"{name} samples, but the algorithm solves it with the others; set --step-multiple {name}=1"
            )
    for late in find_late_samples(algorithm, samplers):
        return f"{late.reader} samples {late.signal} one step late, and half the step would change this delay"
    for i in dict.fromkeys(link.target for link in network.links):
        if i not in network.followers and names[i] not in samplers and _can_sample(network, i):
            return (
                f"it is not known whether {names[i]}, which has discrete variables, samples in each step; "
                f"if it does, set --step-multiple {names[i]}=1"
            )
    return None


def _can_sample(network: Network, i: int) -> bool:
    """Return whether an instance may compute at communication points only, by its model description.

    Clocks and events of FMI 3.0 have their own times. With continuous states, discrete variables may be those
    of events.
    """
    instance = network.instances[i]
    if not isinstance(instance, DescribedInstance) or isinstance(instance, EventModeInstance):
        return False
    read_outputs = {link.output for link in network.links if link.source == i}
    if any(instance.written[k].type == "Real" and not instance.continuous_outputs[k] for k in read_outputs):
        return True
    description = instance.file.description
    has_discrete_reals = any(
        v.type == "Real" and v.variability == "discrete" for v in description.modelVariables
    )
    return has_discrete_reals and not description.numberOfContinuousStates
