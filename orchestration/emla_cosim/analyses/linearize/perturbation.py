"""Perturb one input of a running system, and return how signals change because of it."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from ...master.stepping.checkpoint import Snapshot
from ...master.stepping.fixed_steps import FixedSteps
from ...master.stepping.stepping_base import ROUNDING
from ...run.simulation import Simulation
from .analysis_points import AnalysisPoint, ResolvedPoint, find_instance, resolve_point


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
        self._advance()
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
        values = self.undisturbed(replace(point, output=None))
        return max(float(np.abs(values).max()), point.nominal)

    def undisturbed(self, point: ResolvedPoint) -> Vector:
        """Return the signal at a point without a pulse, shape (count,). Raise RunError if a step fails."""
        # one undisturbed run serves all pulses at a point
        if point not in self._undisturbed:
            self._undisturbed[point] = self._repeat(point, 0.0, 0)
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
        undisturbed = self.undisturbed(point)
        return self._repeat(point, amplitude, at) - undisturbed

    def _advance(self) -> None:
        self._simulation.advance(self.at)
        check_reached(self._simulation, self.at)

    def _repeat(self, point: ResolvedPoint, amplitude: float, at: int) -> Vector:
        if self._snapshot is not None:
            self._snapshot.restore()
        elif self._is_advanced:
            self._simulation.start(recorders=[], **self._options)
            self._advance()
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
