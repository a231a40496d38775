"""Random states of the machines that come with the study."""

import random
from dataclasses import dataclass

from emla_cosim.study.machines.schema import load_machine
from machine_fmu import Closure, Dynamics, Machine, Mechanism, assemble, find_closure, reach_pose
from machine_fmu.pose import Pose, direction


@dataclass(frozen=True)
class MachineState:
    """Strokes, passive coordinates, and speeds, accelerations and forces of all variables."""

    strokes: list[float]
    passive: list[float]
    v: list[float]
    a: list[float]
    force: list[float]

    @property
    def variables(self) -> list[float]:
        """Strokes and passive coordinates."""
        return [*self.strokes, *self.passive]


@dataclass(frozen=True)
class Case:
    """A machine with all that its states need."""

    name: str
    machine: Machine
    closure: Closure
    mechanism: Mechanism

    @classmethod
    def of(cls, name: str) -> "Case":
        """Return the case of a machine that comes with the study."""
        return cls.of_machine(name, load_machine(name))

    @classmethod
    def of_machine(cls, name: str, machine: Machine) -> "Case":
        """Return the case of a machine."""
        return cls(name, machine, find_closure(machine), assemble(machine))

    def states(self, count: int, seed: int = 1) -> list[MachineState]:
        """Return random states: strokes within their ends, or poses of the platform."""
        draw = random.Random(seed)
        states = []
        for _ in range(count):
            strokes = self._strokes(draw)
            passive = [draw.uniform(-2.0, 1.0) for _ in self.mechanism.passive]
            n = len(strokes) + len(passive)
            v, a = ([draw.uniform(-x, x) for _ in range(n)] for x in (0.3, 5.0))
            force = [
                draw.uniform(-5e4, 5e4) if i < len(strokes) else draw.uniform(-300, 300) for i in range(n)
            ]
            states.append(MachineState(strokes, passive, v, a, force))
        return states

    def dynamics(self, state: MachineState) -> Dynamics:
        """Return the dynamics in a state."""
        lengths = {**self.closure.lengths}
        for bar, stroke in zip(self.mechanism.actuators, state.strokes, strict=True):
            lengths[bar.name] = bar.length + stroke
        guess = dict(enumerate(reach_pose(self.mechanism, self.closure, lengths)))
        return Dynamics(self.mechanism, self.closure, state.strokes, state.passive, guess)

    def _strokes(self, draw: random.Random) -> list[float]:
        if self.name != "stewart":
            ends = ([self.machine.value(x) for x in a.stroke] for a in self.machine.actuators.values())
            return [draw.uniform(low, high) for low, high in ends]
        shift = [draw.uniform(-0.12, 0.12), draw.uniform(-0.12, 0.12), 2.0 + draw.uniform(-0.2, 0.2)]
        angles = [draw.uniform(-0.1, 0.1) for _ in range(3)]
        pose = Pose(self.mechanism).with_numbers(dict(enumerate([*shift, *angles])))
        return [direction(pose, bar).length - bar.length for bar in self.mechanism.bars]
