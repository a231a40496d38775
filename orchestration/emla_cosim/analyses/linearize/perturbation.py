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
from .places import Place, ResolvedPlace, find_described, resolve_place


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
        samples = math.floor((at - times.start) / self.step + ROUNDING)
        self.at = times.point(samples * self._steps)
        self._reach()
        self.rolls_back = all(s.rolls_back for s in algorithm.network.instances)
        self._snapshot = Snapshot(algorithm) if self.rolls_back else None
        if self._snapshot is not None:
            stepping.allow_way_back()
            self._snapshot.take()
        self._moved = False
        self._undisturbed: dict[ResolvedPlace, Vector] = {}

    def close(self) -> None:
        """Free the saved state."""
        if self._snapshot is not None:
            self._snapshot.close()

    @property
    def duration(self) -> float:
        """Length of the stretch in s."""
        return self.count * self.step

    def resolve(self, place: Place) -> ResolvedPlace:
        """Return the positions of a place; CommandError if it does not exist, or is not Real."""
        return resolve_place(self._simulation.system, self._stepping.algorithm.network, place)

    def unit(self, place: Place) -> str:
        """Return the unit of a response: that of the output per unit of the input."""
        units = []
        for name in (place.output, place.input):
            component, variable = self._simulation.system.split(name)
            instance, *_ = find_described(self._stepping.algorithm.network, component.name)
            units.append(instance.file.interface.unit(component.alias(variable).variable))
        return "/".join(
            "1" if unit is None else f"({unit})" if "/" in str(unit) else str(unit) for unit in units
        )

    def scale(self, place: ResolvedPlace) -> float:
        """Return the size of an input: its largest value in the stretch, at least its nominal value."""
        values = self.undisturbed(replace(place, output=None))
        return max(float(np.abs(values).max()), place.nominal)

    def undisturbed(self, place: ResolvedPlace) -> Vector:
        """Return the signal at a place without a pulse, shape (count,). Raise RunError if a step fails."""
        if place not in self._undisturbed:
            self._undisturbed[place] = self._repeat(place, 0.0, 0)
        return self._undisturbed[place]

    def respond(self, place: ResolvedPlace, amplitude: float, at: int = 0) -> Vector:
        """Return the change of the signal at a place by a pulse that lasts one sample.

        Args:
            place: Input to perturb, and signal to read.
            amplitude: Height of the pulse in the unit of the input.
            at: Sample of the pulse.

        Returns:
            Change during each sample for an input; after each sample for an output. Shape (count,).

        Raises:
            RunError: A step fails.
        """
        before = self.undisturbed(place)
        return self._repeat(place, amplitude, at) - before

    def _reach(self) -> None:
        self._simulation.advance(self.at)
        check_reached(self._simulation, self.at)

    def _repeat(self, place: ResolvedPlace, amplitude: float, at: int) -> Vector:
        if self._snapshot is not None:
            self._snapshot.restore()
        elif self._moved:
            self._simulation.start(recorders=[], **self._options)
            self._reach()
        self._moved = True
        stepping, values = self._stepping, np.empty(self.count)
        network = stepping.algorithm.network
        waits = stepping.algorithm.multiples[place.instance] > 1
        read = np.empty(self._steps)
        for k in range(self.count):
            for j in range(self._steps):
                stepping.repeat_step(place.instance, place.input, amplitude if k == at else 0.0)
                read[j] = network.instances[place.instance].inputs[place.input]
            if place.output is not None:
                values[k] = network.signals[place.output]
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
