"""Read variables that the FMUs do not exchange, for the recorders."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..base.arrays import Texts, Vector

if TYPE_CHECKING:  # commands that only list options do not load fmpy
    from fmpy.model_description import ModelVariable

    from ..system.names import NamedVariable
    from .instances.described_instance import DescribedInstance


class Observer:
    """Reads the observed variables of all instances after a step; it changes nothing in them.

    Numbers are read at every point that is recorded. Texts are read only where a row is due, because each one
    costs a call; other rows have NaN instead.

    Attributes:
        values: the observed values as doubles; for a String, the position of the text in `texts`.
        texts: the texts of the run.
        steps_per_row: every `steps_per_row`-th point is due for texts.
    """

    def __init__(
        self,
        instances: Mapping[str, "DescribedInstance"],
        variables: Sequence["NamedVariable"] = (),
        steps_per_row: int = 1,
    ) -> None:
        position = {name: i for i, name in enumerate(instances)}
        # the numbers of an instance are one part of `values`, so the texts come after them
        self.variables = sorted(
            variables, key=lambda v: (position[v.component.name], v.variable.type == "String")
        )
        self.names = [v.full_name for v in self.variables]
        self.values: Vector = np.full(len(self.variables), np.nan)
        self.texts, self.steps_per_row = Texts(), steps_per_row
        self.readers: list[tuple[DescribedInstance, slice]] = []
        """Instances with observed numbers, and their parts of `values`."""
        self.strings: list[tuple[int, DescribedInstance, ModelVariable]] = []
        """Position in `values`, instance and variable of each String."""
        for name, instance in instances.items():
            indices = [i for i, v in enumerate(self.variables) if v.component.name == name]
            texts = [i for i in indices if self.variables[i].variable.type == "String"]
            numbers = [i for i in indices if i not in texts]
            part = slice(numbers[0], numbers[-1] + 1) if numbers else slice(0, 0)
            instance.observe([str(self.variables[i].variable.name) for i in numbers], self.values[part])
            if numbers:
                self.readers.append((instance, part))
            self.strings += [(i, instance, self.variables[i].variable) for i in texts]

    def read(self, due: bool = True) -> None:
        """Read all numbers, and the texts if a row is `due`; InstanceError if an FMU fails."""
        for instance, _ in self.readers:
            instance.get_observed()
        for i, instance, variable in self.strings:
            self.values[i] = self.texts.encode(str(instance.value(variable))) if due else np.nan

    def is_due(self, steps: int) -> bool:
        """Return whether the row after this number of steps is due for texts."""
        return bool(self.strings) and steps % self.steps_per_row == 0

    def find_next_due(self, steps: int) -> int:
        """Return the number of steps at the next row that is due for texts."""
        return (steps // self.steps_per_row + 1) * self.steps_per_row
