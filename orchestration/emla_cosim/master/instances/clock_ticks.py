"""The ticks of all clocks of an instance: their numbers, and which triggered clocks have to tick."""

import ctypes
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...fmu.clocks import CLOCK, clocks_of, is_triggered_input


class ClockTicks:
    """The number of ticks of each clock since the start.

    A connection between clocks carries this number, so that no tick is lost if several ones come in a step.

    Args:
        variables: All variables of the FMU.
        inputs: Variables of the input vector, with the triggered clocks that are connected.
    """

    def __init__(self, variables: Mapping[str, ModelVariable], inputs: Sequence[ModelVariable]) -> None:
        self.clocks = [v for v in variables.values() if v.type == CLOCK]
        self.counts: Vector = np.zeros(len(self.clocks))
        self._references = np.array([v.valueReference for v in self.clocks], dtype=np.uint32)
        self._places = {v.name: i for i, v in enumerate(self.clocks)}
        asked = list(dict.fromkeys(int(v.valueReference) for v in self.clocks if v.causality != "input"))
        self._asked = (ctypes.c_uint32 * len(asked))(*asked)
        self._active = (ctypes.c_bool * len(asked))()
        self._driven = [
            (i, int(v.valueReference), self._places[v.name])
            for i, v in enumerate(inputs)
            if is_triggered_input(v)
        ]
        """Of each triggered clock: its places in the input vector and among the clocks, and its reference."""
        self._names = {int(v.valueReference): str(v.name) for v in self.clocks}
        self._needed = {
            int(v.valueReference): set(clocks_of(v))
            for v in self.clocks
            if v.causality == "input" and v.clocks
        }

    def use_memory(self, memory: Vector) -> None:
        """Keep the numbers in this memory, shape (clocks,)."""
        self.counts = memory

    def places(self, variables: Sequence[ModelVariable]) -> NDArray[np.intp]:
        """Return the positions of variables among the clocks; -1 for others."""
        return np.array([self._places.get(v.name, -1) for v in variables], dtype=np.intp)

    def name(self, clock: int) -> str:
        """Return the name of a clock by its value reference."""
        return self._names[clock]

    def pending(self, inputs: Vector) -> dict[int, float]:
        """Return how often triggered clocks still have to tick, by value reference.

        Args:
            inputs: Input vector, with the numbers of ticks of the clocks that drive them.
        """
        missing = (
            (clock, float(np.rint(inputs[i] - self.counts[place]))) for i, clock, place in self._driven
        )
        return {clock: times for clock, times in missing if times > 0.0}

    def find_output_ticks(self, fmu: Any) -> list[int]:
        """Return the value references of the output and local clocks that tick, in event mode."""
        if not len(self._asked):
            return []
        fmu.fmi3GetClock(fmu.component, self._asked, len(self._asked), self._active)
        return [clock for clock, ticks in zip(self._asked, self._active, strict=True) if ticks]

    def can_tick(self, clock: int, ticking: Collection[int]) -> bool:
        """Return whether an input clock can tick together with those that do."""
        return clock not in self._needed or not self._needed[clock].isdisjoint(ticking)

    def describe_needed(self, clock: int) -> str:
        """Return the names of the clocks with one of which a clock can tick only."""
        return " or ".join(self._names.get(c, f"clock {c}") for c in sorted(self._needed[clock]))

    def count(self, clocks: Collection[int]) -> None:
        """Count a tick of each of these clocks, by value reference."""
        self.counts[np.isin(self._references, list(clocks))] += 1.0
