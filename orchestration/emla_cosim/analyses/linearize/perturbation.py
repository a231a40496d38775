"""Perturb a running system at an analysis point, and return how signals change because of it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError, suggest_names
from ...master.instances.described_instance import DescribedInstance
from ...master.instances.integrated_instance import IntegratedInstance
from ...master.integrated_group import IntegratedGroup
from ...master.network import Network
from ...master.stepping.checkpoint import Snapshot
from ...master.stepping.step_size_control import FixedSteps
from ...master.stepping.stepping_base import ROUNDING
from ...run.simulation import Simulation
from ...study.joint import name_current_path, name_position_loop
from ...system.model import System


@dataclass(frozen=True)
class AnalysisPoint:
    """A pair of signals whose frequency response is measured.

    Attributes:
        label: Name in tables and pictures.
        input: Full name of the input to perturb.
        output: Full name of the output to read; empty to read the input itself, with what drives it.
        is_loop: Whether a loop is opened here.
    """

    label: str
    input: str
    output: str
    is_loop: bool = False


@dataclass(frozen=True)
class ResolvedPoint:
    """An analysis point as positions in a network.

    Attributes:
        instance: Position of the FMU instance with the input.
        input: Position of the input in its vector.
        nominal: Nominal value of the input, 1 if it has none.
        output: Position of the output in the signals; None to read the input itself.
    """

    instance: int
    input: int
    nominal: float
    output: int | None


def find_instance(network: Network, component: str) -> tuple[DescribedInstance, int, dict[str, int]]:
    """Return the instance of a component in a network, alone or in a group that is integrated together.

    Returns:
        The instance of its own FMU, the position of the instance or group in the network, and the positions
        of its inputs in the vector of that, by name.
    """
    for i, instance in enumerate(network.instances):
        members = instance.members if isinstance(instance, IntegratedInstance) else [instance]
        for m, member in enumerate(members):
            if member.name == component:
                assert isinstance(member, DescribedInstance)
                ends = [(m, k) for k in range(len(member.read))]
                if isinstance(instance, IntegratedGroup):
                    ends = instance.free
                return member, i, {member.read[k].name: n for n, (at, k) in enumerate(ends) if at == m}
    raise ValueError(component)


def parse_opening(system: System, text: str) -> AnalysisPoint:
    """Return the analysis point at which a text opens a loop.

    Args:
        system: The system.
        text: A connection `a.output->b.input`; a path inside of a component, `a.input->a.output`, on which
            the input is added to the output without delay; or a joint, for its measured position.

    Raises:
        CommandError: The text is none of these.
    """
    joints = _list_joints_with_observer(system)
    if "->" not in text and text not in joints:
        hint = f", or a joint: {suggest_names(text, joints)}" if joints else "."
        raise CommandError(f"'{text}' is not a connection; write a.output->b.input{hint}", name=text)
    path = text if "->" in text else name_position_loop(text)
    source, _, target = (part.strip() for part in path.partition("->"))
    if not (source and target):
        raise CommandError(f"'{text}' is not a connection; write a.output->b.input.", name=text)
    (first, start), (second, end) = system.split(source), system.split(target)
    ends = (first.name, first.alias(start).variable), (second.name, second.alias(end).variable)
    driver = next((x for x in system.into(second.name) if x.ends[1] == ends[1]), None)
    label = f"{source} -> {target}"
    if driver is not None and driver.ends == ends:
        return AnalysisPoint(label, target, "", is_loop=True)
    if first.name == second.name:
        return AnalysisPoint(label, source, target, is_loop=True)
    if driver is not None:
        hint = f"{driver.source}.{driver.output} drives {target}."
    else:
        wires = [f"{x.source}.{x.output}->{x.target}.{x.input}" for x in system.connections]
        hint = suggest_names(f"{source}->{target}", wires, most=6) if wires else "nothing is connected."
    raise CommandError(f"there is no connection {label}: {hint}", name=text)


def choose_openings(system: System) -> list[str]:
    """Return where loops are opened by default: at the current reference of each joint."""
    return [name_current_path(joint) for joint in _list_joints_with_observer(system)]


def _list_joints_with_observer(system: System) -> list[str]:
    return [c.branch for c in system.components if c.name == f"{c.branch}.observer"]


def resolve_point(system: System, network: Network, point: AnalysisPoint) -> ResolvedPoint:
    """Return the positions of an analysis point.

    Args:
        system: The prepared system.
        network: Its network.
        point: The analysis point.

    Raises:
        CommandError: The input is not a connected input, or one of the signals does not exist or is not Real.
    """
    component, variable = system.split(point.input)
    instance, position, inputs = find_instance(network, component.name)
    read = {v.name: v for v in instance.read}
    input_name = component.alias(variable).variable
    if input_name not in read:
        hint = suggest_names(variable, read)
        raise CommandError(f"{point.input} is not an input; {hint}", name=point.input)
    if read[input_name].type != "Real":
        raise CommandError(
            f"{point.input} is {read[input_name].type}; a frequency response needs a Real.", name=point.input
        )
    if input_name not in inputs:
        raise CommandError(
            f"{point.input} is connected inside of components that are integrated together; set "
            "--no-together, or compute state matrices.",
            name=point.input,
        )
    at, nominal = (position, inputs[input_name]), abs(float(read[input_name].nominal or 1.0))
    if not point.output:
        return ResolvedPoint(*at, nominal, None)
    component_of_output, variable = system.split(point.output)
    output = component_of_output.alias(variable).variable
    output_name = f"{component_of_output.name}.{output}"
    if output_name not in network.names:
        raise CommandError(
            f"{point.output} is not a Real output; {suggest_names(point.output, network.names)}",
            name=point.output,
        )
    if point.is_loop and not instance.file.interface.direct.among({output}, input_name):
        raise CommandError(
            f"{point.output} does not depend on {point.input} without delay, so no loop can be opened there.",
            name=point.output,
        )
    return ResolvedPoint(*at, nominal, network.names.index(output_name))


class Perturbation:
    """Repeats a stretch of a run, with and without a pulse on an input.

    Both repetitions begin from the same state, with the same random numbers, so noise cancels in their
    difference. The state is restored where all FMUs can do that; otherwise the run is repeated from its
    start.

    A sample is a step, or the step multiple of the components that sample. Other components do several
    steps then, and pulses last as long as a sample.

    Attributes:
        at: Time of the operating point in s.
        count: Number of samples of the stretch.
        step: Sample time in s.
        rolls_back: Whether the state is restored.
    """

    def __init__(
        self, simulation: Simulation, at: float, duration: float, options: Mapping[str, Any] | None = None
    ) -> None:
        """Run up to the operating point.

        Args:
            simulation: The prepared system.
            at: Time of the operating point in s; it is moved back to a sample.
            duration: Length of the stretch in s.
            options: Options of the runs that differ from those of the simulation. Default: none.

        Raises:
            CommandError: The steps have no fixed length, or components do not sample at the same times.
            RunError: The run fails before the operating point.
        """
        self._simulation: Simulation = simulation
        self._options: dict[str, Any] = {**(options or {}), "estimate_coupling": False}
        simulation.start(recorders=[], **self._options)
        stepping = simulation.stepping
        algorithm = stepping.algorithm
        samplers = [c.name for c in simulation.system.components if c.samples]
        multiples = {
            int(multiple)
            for instance, multiple in zip(algorithm.network.instances, algorithm.multiples, strict=True)
            if multiple > 1 or instance.name in samplers
        }
        if not isinstance(stepping, FixedSteps) or len(multiples) > 1:
            raise CommandError(
                "a frequency response needs fixed steps, and one step multiple for all components that "
                "sample; leave out step-size control and other step multiples."
            )
        times = stepping.times
        self._steps = next(iter(multiples), 1)
        self.step = self._steps * times.step
        self.count = round(duration / self.step)
        # back to a sample: a pulse between samples of a controller would not be read
        samples = math.floor((at - times.start) / self.step + ROUNDING)
        self.at = times.point(samples * self._steps)
        self._run_to_operating_point()
        # one FMU that cannot be set back would continue from another time than the rest
        self.rolls_back = all(s.rolls_back for s in algorithm.network.instances)
        self._snapshot = Snapshot(algorithm) if self.rolls_back else None
        if self._snapshot is not None:
            stepping.allow_way_back()
            self._snapshot.save()
        self._is_advanced = False
        self._undisturbed: dict[ResolvedPoint, Vector] = {}

    def close(self) -> None:
        """Free the saved state."""
        if self._snapshot is not None:
            self._snapshot.close()

    @property
    def duration(self) -> float:
        """Length of the stretch in s."""
        return self.count * self.step

    def resolve(self, point: AnalysisPoint) -> ResolvedPoint:
        """Return the positions of an analysis point; CommandError if it does not exist, or is not Real."""
        return resolve_point(self._simulation.system, self._stepping.algorithm.network, point)

    def unit(self, point: AnalysisPoint) -> str:
        """Return the unit of a response: that of the output per unit of the input."""
        units = []
        for name in (point.output, point.input):
            component, variable = self._simulation.system.split(name)
            instance, *_ = find_instance(self._stepping.algorithm.network, component.name)
            units.append(instance.file.interface.unit(component.alias(variable).variable))
        return "/".join(
            "1" if unit is None else f"({unit})" if "/" in str(unit) else str(unit) for unit in units
        )

    def scale(self, point: ResolvedPoint) -> float:
        """Return the size of an input: its largest value in the stretch, at least its nominal value."""
        values = self.find_undisturbed(replace(point, output=None))
        return max(float(np.abs(values).max()), point.nominal)

    def find_undisturbed(self, point: ResolvedPoint) -> Vector:
        """Return the signal at a point without a pulse, shape (count,). Raise RunError if a step fails."""
        # one undisturbed run serves all pulses at a point
        if point not in self._undisturbed:
            self._undisturbed[point] = self._run_with_pulse(point, 0.0, 0)
        return self._undisturbed[point]

    def respond(self, point: ResolvedPoint, amplitude: float, at: int = 0) -> Vector:
        """Return the change of the signal at an analysis point by a pulse that lasts one sample.

        Args:
            point: Input to perturb, and signal to read.
            amplitude: Height of the pulse in the unit of the input.
            at: Sample of the pulse.

        Returns:
            Change during each sample for an input; after each sample for an output. Shape (count,).

        Raises:
            RunError: A step fails.
        """
        undisturbed = self.find_undisturbed(point)
        return self._run_with_pulse(point, amplitude, at) - undisturbed

    def _run_to_operating_point(self) -> None:
        self._simulation.advance(self.at)
        check_reached(self._simulation, self.at)

    def _run_with_pulse(self, point: ResolvedPoint, amplitude: float, at: int) -> Vector:
        """Return the signal at a point during the stretch, with a pulse of this height at sample `at`."""
        if self._snapshot is not None:
            self._snapshot.restore()
        elif self._is_advanced:
            self._simulation.start(recorders=[], **self._options)
            self._run_to_operating_point()
        self._is_advanced = True
        stepping, values = self._stepping, np.empty(self.count)
        network = stepping.algorithm.network
        waits = stepping.algorithm.multiples[point.instance] > 1
        read = np.empty(self._steps)
        for k in range(self.count):
            for j in range(self._steps):
                stepping.repeat_step(point.instance, point.input, amplitude if k == at else 0.0)
                read[j] = network.instances[point.instance].inputs[point.input]
            if point.output is not None:
                values[k] = network.signals[point.output]
            else:  # a component that waits reads its inputs in the last of these steps
                values[k] = read[-1] if waits else read.mean()
        return values

    @property
    def _stepping(self) -> FixedSteps:
        stepping = self._simulation.stepping
        assert isinstance(stepping, FixedSteps)  # as checked at the start
        return stepping


def check_reached(simulation: Simulation, at: float) -> None:
    """Raise RunError if a run was ended before its operating point at a time in s, with the reason."""
    if simulation.time < at - 1e-9 * max(1.0, abs(at)):
        ended = simulation.so_far().early_end
        why = "" if ended is None else f" {ended}"
        raise RunError(f"the run did not reach the operating point at t = {at:g} s.{why}")
